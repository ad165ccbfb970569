//! Poses from correspondences beside OpenCV and PoseLib: errors and time by number of points, shape, noise and outliers.
//!
//! The peers are run live, by `pnp.py`, on the same sets; those that cannot be imported are said to be missing. Ours and
//! theirs take turns: ours, the peers, ours again, the faster of each case's two or more runs counting. A Python call
//! costs the peers a few µs that ours does not have.

use super::{Arguments, Report, Row};
use anyhow::{Context, Result, ensure};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use texreg::camera::{Camera, Intrinsics};
use texreg::lie::{Pose, so3};
use texreg::posit::{self, Correspondence};

use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};

/// One set of correspondences and the pose it was made with.
struct Case {
    truth: Pose,
    correspondences: Vec<Correspondence>,
}

/// Sets of one kind.
struct Cell {
    n: usize,
    planar: bool,
    noise: f64,
    outliers: f64,
    cases: Vec<Case>,
}

impl Cell {
    fn name(&self) -> String {
        let shape = if self.planar { "planar" } else { "solid" };
        let wrong = if self.robust() { format!(" {:.0} % wrong", 100.0 * self.outliers) } else { String::new() };
        format!("{} {shape} {} px{wrong}", self.n, self.noise)
    }

    fn robust(&self) -> bool {
        self.outliers > 0.0
    }

    /// What the robust methods are told.
    fn threshold(&self) -> f64 {
        (4.0 * self.noise).max(2.0)
    }
}

/// An estimate, or none, and how long it took in µs.
type Outcome = (Option<Pose>, f64);

/// Runs the benchmark.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let recorded = arguments.peers.as_ref().map(|p| p.join("data/pnp")).filter(|p| p.join("cases.csv").exists());
    let mut cells = match &recorded {
        Some(folder) => read(folder)?,
        None => generate(),
    };
    if arguments.quick {
        cells.retain(|c| c.noise == 1.0 && [4, 6, 10, 50, 200].contains(&c.n) && c.outliers != 0.1);
    }
    for cell in &mut cells {
        cell.cases.truncate(if arguments.quick { 30 } else { 100 });
    }

    let mut ours = solve(&cells);
    let peers = Peers::run(arguments, &cells)?;
    for (first, second) in ours.iter_mut().zip(solve(&cells)) {
        for (a, b) in first.iter_mut().zip(second) {
            a.1 = a.1.min(b.1);
        }
    }

    let mut rows = Vec::new();
    let mut tallies = [Tally::default(); FIGURES.len()];
    for (i, cell) in cells.iter().enumerate() {
        let mine = Samples::new(cell, &ours[i]);
        let theirs: Vec<(&str, Samples)> = peers.outcomes(i).map(|(name, o)| (name, Samples::new(cell, o))).collect();
        for (k, figure) in FIGURES.iter().enumerate() {
            let name = format!("{}, {}", cell.name(), figure.name);
            let value = figure.of(&mine);
            let best = theirs
                .iter()
                .filter(|(name, _)| !figure.timed() || TIMED.contains(name))
                .min_by(|a, b| figure.of(&a.1).total_cmp(&figure.of(&b.1)));
            let Some((peer, samples)) = best else {
                rows.push(Row::alone(name, value, figure.unit));
                continue;
            };
            let row = Row::beside(name, value, figure.of(samples), *peer, figure.unit);
            // Exact data leave nothing but rounding to compare.
            if cell.noise == 0.0 && !figure.timed() {
                rows.push(row);
                continue;
            }
            // To three digits: minima of one and the same error differ beyond that.
            let row = row.goal(1.001);
            tallies[k].add(&row, !figure.timed() && worse_for_sure(figure, &mine, samples));
            rows.push(row);
        }
    }
    let mut report = Report::new("pnp", rows);
    report.notes = FIGURES.iter().zip(&tallies).filter_map(|(figure, tally)| tally.note(figure.name)).collect();
    report.notes.extend(peers.methods.iter().map(|(name, theirs)| duel(name, &cells, &ours, theirs)));
    report.notes.push(match &recorded {
        Some(folder) => format!("sets: {}", folder.display()),
        None => "sets: generated here, seed 1".into(),
    });
    // Goals against peers that are not there are not met.
    report.met &= peers.notes.iter().all(|note| !note.starts_with("missing"));
    report.notes.extend(peers.notes);
    Ok(report)
}

/// Whose time counts as PoseLib's: its LM from a given start, its RANSAC as it comes.
const TIMED: [&str; 2] = ["PoseLib LM from SQPnP", "PoseLib"];

/// One of the figures of a cell.
struct Figure {
    name: &'static str,
    unit: &'static str,
    series: usize,
    percent: f64,
}

const FIGURES: [Figure; 5] = [
    Figure { name: "rotation median", unit: "°", series: 0, percent: 50.0 },
    Figure { name: "rotation 95 %", unit: "°", series: 0, percent: 95.0 },
    Figure { name: "translation median", unit: "%", series: 1, percent: 50.0 },
    Figure { name: "translation 95 %", unit: "%", series: 1, percent: 95.0 },
    Figure { name: "time median", unit: "µs", series: 2, percent: 50.0 },
];

impl Figure {
    fn timed(&self) -> bool {
        self.series == 2
    }

    fn of(&self, samples: &Samples) -> f64 {
        percentile(samples.0[self.series].clone(), self.percent)
    }
}

/// Rotation errors (degrees), translation errors (percent) and times (µs), case by case. Failures are infinite errors.
struct Samples([Vec<f64>; 3]);

impl Samples {
    fn new(cell: &Cell, outcomes: &[Outcome]) -> Self {
        let mut series = [const { Vec::new() }; 3];
        for (case, (pose, time)) in cell.cases.iter().zip(outcomes) {
            let truth = &case.truth;
            let (rotation, translation) = pose.map_or((f64::INFINITY, f64::INFINITY), |pose| {
                let chord = (pose.rotation.matrix() - truth.rotation.matrix()).norm() / 8f64.sqrt();
                let shift = (pose.translation - truth.translation).norm() / truth.translation.norm();
                (2.0 * chord.min(1.0).asin().to_degrees(), 100.0 * shift)
            });
            series[0].push(rotation);
            series[1].push(translation);
            series[2].push(*time);
        }
        Self(series)
    }
}

/// Whether a figure is worse than the peer's in 97.5 % of 400 redrawings of the cases (paired bootstrap).
fn worse_for_sure(figure: &Figure, ours: &Samples, theirs: &Samples) -> bool {
    let (ours, theirs) = (&ours.0[figure.series], &theirs.0[figure.series]);
    let mut random = StdRng::seed_from_u64(2);
    let worse = (0..400).filter(|_| {
        let (a, b) = ours.iter().map(|_| random.random_range(0..ours.len())).map(|i| (ours[i], theirs[i])).unzip();
        percentile(a, figure.percent) > 1.001 * percentile(b, figure.percent)
    });
    worse.count() >= 390
}

/// Case by case, over all cells with noise: how often ours is nearer the truth than a peer's. Errors equal to three digits
/// are no duel; a failure loses.
fn duel(name: &str, cells: &[Cell], ours: &[Vec<Outcome>], theirs: &[Vec<Outcome>]) -> String {
    let mut shares = [(0, 0); 2];
    for ((cell, ours), theirs) in cells.iter().zip(ours).zip(theirs) {
        if cell.noise == 0.0 || theirs.is_empty() {
            continue;
        }
        let (ours, theirs) = (Samples::new(cell, ours), Samples::new(cell, theirs));
        for (k, (won, fought)) in shares.iter_mut().enumerate() {
            for (a, b) in ours.0[k].iter().zip(&theirs.0[k]) {
                if *a < 0.999 * b || *b < 0.999 * a {
                    *won += usize::from(a < b);
                    *fought += 1;
                }
            }
        }
    }
    let share = |(won, fought): (usize, usize)| format!("{:.1} % of {fought}", 100.0 * won as f64 / fought as f64);
    let [rotation, translation] = shares.map(share);
    format!("nearer the truth than {name}, where they differ: rotation {rotation}, translation {translation}")
}

/// How one figure fared over all cells.
#[derive(Clone, Copy, Default)]
struct Tally {
    cells: usize,
    met: usize,
    surely_worse: usize,
    log_ratio: f64,
}

impl Tally {
    fn add(&mut self, row: &Row, surely_worse: bool) {
        self.cells += 1;
        self.met += usize::from(row.met());
        self.surely_worse += usize::from(surely_worse);
        self.log_ratio += row.ratio.map_or(0.0, f64::ln);
    }

    fn note(&self, figure: &str) -> Option<String> {
        let mean = (self.log_ratio / self.cells as f64).exp();
        (self.cells > 0).then(|| {
            format!(
                "{figure}: no worse than the best peer in {} of {} cells, surely worse (paired bootstrap, 97.5 %) in {}, \
                 geometric mean of the ratios {mean:.3}",
                self.met, self.cells, self.surely_worse
            )
        })
    }
}

/// The p-th percentile, linearly interpolated; infinite values sort last.
fn percentile(mut values: Vec<f64>, p: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = p / 100.0 * (values.len() - 1) as f64;
    let (low, high) = (values[at.floor() as usize], values[at.ceil() as usize]);
    if low == high { low } else { low + (high - low) * at.fract() }
}

fn camera() -> Camera {
    Camera {
        width: 1024,
        height: 768,
        intrinsics: Intrinsics::new(1000.0, 512.0, 384.0),
        distortion: Default::default(),
    }
}

/// Our poses, cell by cell and case by case.
fn solve(cells: &[Cell]) -> Vec<Vec<Outcome>> {
    let camera = camera();
    let one = |cell: &Cell, case: &Case| {
        let options =
            posit::Options { threshold: cell.robust().then(|| cell.threshold()), ..posit::Options::default() };
        let mut best = f64::INFINITY;
        let mut pose = None;
        for _ in 0..2 {
            let begin = Instant::now();
            let solution = posit::pose(&case.correspondences, &camera, &options);
            best = best.min(begin.elapsed().as_secs_f64() * 1e6);
            pose = solution.ok().map(|s| s.view.pose);
        }
        (pose, best)
    };
    cells.iter().map(|cell| cell.cases.iter().map(|case| one(cell, case)).collect()).collect()
}

/// What the peers found.
#[derive(Default)]
struct Peers {
    /// Name, and outcomes cell by cell; empty for cells that are none of its business.
    methods: Vec<(String, Vec<Vec<Outcome>>)>,
    notes: Vec<String>,
}

impl Peers {
    fn run(arguments: &Arguments, cells: &[Cell]) -> Result<Self> {
        let python = arguments.peers.as_ref().map(|p| p.join("venv/bin/python")).filter(|p| p.exists());
        let python = python.unwrap_or_else(|| PathBuf::from("python3"));
        let folder = tempfile::tempdir()?;
        let script = folder.path().join("pnp.py");
        fs::write(&script, include_str!("pnp.py"))?;
        let mut cases = Vec::new();
        let mut points = Vec::new();
        for cell in cells {
            for case in &cell.cases {
                cases.extend([
                    cell.n as f64,
                    f64::from(u8::from(cell.planar)),
                    cell.threshold(),
                    f64::from(u8::from(cell.robust())),
                ]);
                for c in &case.correspondences {
                    points.extend([c.point.x, c.point.y, c.point.z, c.pixel.x, c.pixel.y]);
                }
            }
        }
        write(&folder.path().join("cases.f64"), &cases)?;
        write(&folder.path().join("points.f64"), &points)?;
        let repeats = if arguments.quick { "2" } else { "3" };
        let output = match Command::new(&python).arg(&script).arg(folder.path()).arg(repeats).output() {
            Ok(output) if output.status.success() => output,
            Ok(output) => {
                let reason = String::from_utf8_lossy(&output.stderr);
                let reason = reason.lines().last().unwrap_or("no message").to_string();
                return Ok(Self { notes: vec![format!("missing: OpenCV, PoseLib ({reason})")], ..Self::default() });
            }
            Err(error) => {
                let reason = format!("missing: OpenCV, PoseLib ({}: {error})", python.display());
                return Ok(Self { notes: vec![reason], ..Self::default() });
            }
        };
        let stdout = String::from_utf8(output.stdout)?;
        let tagged = |tag: &str| -> Vec<String> {
            stdout.lines().filter_map(|l| Some(l.strip_prefix(tag)?.trim().to_string())).collect()
        };
        let mut notes: Vec<String> = tagged("missing").into_iter().map(|name| format!("missing: {name}")).collect();
        notes.extend(tagged("version").into_iter().map(|version| format!("peer: {version}")));
        let names = tagged("method");
        let bytes = fs::read(folder.path().join("results.f64"))?;
        let numbers: Vec<f64> =
            bytes.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().expect("chunks of eight"))).collect();
        let count: usize = cells.iter().map(|c| c.cases.len()).sum();
        ensure!(numbers.len() == count * names.len() * 13, "the peers' results are incomplete");
        let methods = names.iter().enumerate().map(|(method, name)| {
            let mut case = 0;
            let outcomes = cells.iter().map(|cell| {
                let outcomes: Vec<Outcome> = (0..cell.cases.len())
                    .map(|i| outcome(&numbers[((case + i) * names.len() + method) * 13..][..13]))
                    .collect();
                case += cell.cases.len();
                // All times missing: the method does not apply to the cell.
                if outcomes.iter().all(|o| o.1.is_nan()) { Vec::new() } else { outcomes }
            });
            (name.clone(), outcomes.collect())
        });
        Ok(Self { methods: methods.collect(), notes })
    }

    /// The methods that apply to a cell.
    fn outcomes(&self, cell: usize) -> impl Iterator<Item = (&str, &[Outcome])> {
        self.methods.iter().map(move |(name, cells)| (name.as_str(), &cells[cell][..])).filter(|(_, o)| !o.is_empty())
    }
}

fn outcome(numbers: &[f64]) -> Outcome {
    let rotation = Matrix3::from_row_slice(&numbers[..9]);
    let translation = Vector3::from_column_slice(&numbers[9..12]);
    let pose = Pose::new(Rotation3::from_matrix_unchecked(rotation), translation);
    (pose.is_finite().then_some(pose), numbers[12])
}

fn write(path: &Path, numbers: &[f64]) -> Result<()> {
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    Ok(fs::write(path, bytes)?)
}

/// The sets recorded in `cases.csv` and `points.csv`.
fn read(folder: &Path) -> Result<Vec<Cell>> {
    let table = |name: &str| -> Result<Vec<Vec<f64>>> {
        let path = folder.join(name);
        let text = fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        text.lines().skip(1).map(|l| l.split(',').map(|x| Ok(x.parse()?)).collect()).collect()
    };
    let mut points = table("points.csv")?.into_iter().peekable();
    let mut cells: Vec<Cell> = Vec::new();
    for row in table("cases.csv")? {
        ensure!(row.len() == 17, "cases.csv: {} columns, not 17", row.len());
        let mut correspondences = Vec::new();
        while let Some(p) = points.next_if(|p| p[0] == row[0]) {
            ensure!(p.len() >= 6, "points.csv: {} columns, not 7", p.len());
            correspondences.push(Correspondence::new(Point3::new(p[1], p[2], p[3]), Point2::new(p[4], p[5])));
        }
        let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_row_slice(&row[5..14]));
        let truth = Pose::new(rotation, Vector3::from_column_slice(&row[14..17]));
        let kind = (row[1] as usize, row[2] == 1.0, row[3], row[4]);
        if cells.last().is_none_or(|c| (c.n, c.planar, c.noise, c.outliers) != kind) {
            let (n, planar, noise, outliers) = kind;
            cells.push(Cell { n, planar, noise, outliers, cases: Vec::new() });
        }
        if let Some(cell) = cells.last_mut() {
            cell.cases.push(Case { truth, correspondences });
        }
    }
    Ok(cells)
}

/// Sets like the recorded ones: points in [−1, 1]³ (or its middle plane, tilted by at most 75°) seen from 4 to 10 away, with
/// normal noise, wrong pixels spread evenly over the photo.
fn generate() -> Vec<Cell> {
    let mut random = StdRng::seed_from_u64(1);
    let sizes = [4, 5, 6, 8, 10, 20, 50, 100, 200];
    let mut kinds = Vec::new();
    for n in sizes {
        for planar in [false, true] {
            kinds.extend([0.0, 0.5, 1.0, 2.0, 5.0].map(|noise| (n, planar, noise, 0.0)));
        }
    }
    for n in sizes.into_iter().filter(|n| *n >= 10) {
        for planar in [false, true] {
            kinds.extend([0.1, 0.3, 0.5].map(|outliers| (n, planar, 1.0, outliers)));
        }
    }
    let mut cell = |(n, planar, noise, outliers)| Cell {
        n,
        planar,
        noise,
        outliers,
        cases: (0..100).map(|_| case(&mut random, n, planar, noise, outliers)).collect(),
    };
    kinds.into_iter().map(&mut cell).collect()
}

fn case(random: &mut StdRng, n: usize, planar: bool, noise: f64, outliers: f64) -> Case {
    let camera = camera();
    let rotation = loop {
        let axis = Vector3::from_fn(|_, _| normal(random));
        let rotation = so3::exp(&(axis.normalize() * random.random_range(0.0..std::f64::consts::PI)));
        if !planar || rotation.matrix().m33.abs() > 75f64.to_radians().cos() {
            break rotation;
        }
    };
    let depth = random.random_range(4.0..10.0);
    let mut aside = || random.random_range(-0.15..0.15) * depth;
    let truth = Pose::new(rotation, Vector3::new(aside(), aside(), depth));
    let mut correspondences: Vec<Correspondence> = Vec::with_capacity(n);
    while correspondences.len() < n {
        let mut coordinate = || random.random_range(-1.0..1.0);
        let point = Point3::new(coordinate(), coordinate(), if planar { 0.0 } else { coordinate() });
        if let Some(pixel) = camera.project(&truth.transform_point(&point)).filter(|p| camera.contains(p)) {
            let pixel = Point2::new(pixel.x + noise * normal(random), pixel.y + noise * normal(random));
            correspondences.push(Correspondence::new(point, pixel));
        }
    }
    let wrong = (outliers * n as f64).round() as usize;
    for correspondence in &mut correspondences[..wrong] {
        correspondence.pixel = Point2::new(random.random_range(0.0..1024.0), random.random_range(0.0..768.0));
    }
    Case { truth, correspondences }
}

/// A normal deviate (Box & Muller 1958).
fn normal(random: &mut StdRng) -> f64 {
    let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
    (-2.0 * u.ln()).sqrt() * (2.0 * std::f64::consts::PI * v).cos()
}
