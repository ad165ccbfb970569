//! Mutual information on a million samples, beside ITK's Mattes metric, a plain pass over the same arrays, and scikit-learn.
//!
//! ITK's metric warps a picture, interpolates it linearly, fills the histogram, and sums the derivatives by six parameters of an
//! affine map. "As ITK does" does the same with our density; its other rows start from the samples' values. Times are the least of runs
//! taken in turn. ITK's bins are the same on both sides (32), ours 16 × 32.

use super::{Arguments, Report, Row, python};
use anyhow::{Context, Result, bail, ensure};
use rand::{Rng, SeedableRng, rngs::StdRng};
use rayon::prelude::*;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout};
use std::time::Instant;
use texreg::mi::{
    ConditionalEntropy, Correlation, CorrelationRatio, Density, EntropyCorrelation, Histogram, Metric,
    MutualInformation, NormalizedMutualInformation, Parzen, Samples,
};

const SCRIPT: &str = include_str!("mi_peer.py");

/// The pictures are squares of this many pixels a side: a million samples.
const SIDE: usize = 1000;
const COUNT: usize = SIDE * SIDE;

const DENSITY: Parzen = Parzen { model_bins: 16, photo_bins: 32 };

/// The affine map of the peer's script.
const AFFINE: [f32; 6] = [1.001, 0.002, -0.002, 0.999, 0.7, -0.4];

/// Samples taken by one task of the plain pass.
const CHUNK: usize = 1 << 14;

/// Runs the benchmark.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let runs = if arguments.quick { 10 } else { 40 };
    let (fixed, moving) = pictures();
    let model: Vec<u16> = fixed.iter().map(|v| (v * 15.999) as u16).collect();
    let samples = Samples { model: &model, photo: &moving };
    let threads = rayon::current_num_threads();
    let mut rows = Vec::new();
    let mut notes = Vec::new();

    let information = || {
        let joint = DENSITY.estimate(&samples);
        let scores = DENSITY.scores(&samples, &MutualInformation.derivative(&joint));
        (MutualInformation.value(&joint), scores)
    };
    let alone = |threads: usize| -> Result<_> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        Ok(pool.install(information))
    };
    ensure!(alone(1)? == alone(threads.max(3))?, "the result depends on the number of threads");
    notes.push("value and scores are the same to the last bit on 1 thread and on more".to_string());

    let (ours, limit) = alternately(runs, information, || plain_pass(&model, &moving));
    rows.push(Row::beside("value and scores", ours, limit, format!("plain pass, {threads} threads"), "ms").goal(3.0));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let (ours, limit) =
        alternately(runs, || pool.install(information), || pool.install(|| plain_pass(&model, &moving)));
    rows.push(Row::beside("value and scores", ours, limit, "plain pass, 1 thread", "ms").goal(3.0));

    let cells = cells(&model, &moving);
    let name = "floor: four numbers added to a cell a sample, 1 thread";
    rows.push(Row::alone(name, least(runs, || added(&cells)), "ms"));
    let name = "floor: one number read from a cell a sample, 1 thread";
    rows.push(Row::alone(name, least(runs, || read(&cells)), "ms"));

    let metrics: [(&str, Box<dyn Metric>); 6] = [
        ("nmi", Box::new(NormalizedMutualInformation)),
        ("ecc", Box::new(EntropyCorrelation)),
        ("ce", Box::new(ConditionalEntropy)),
        ("cr", Box::new(CorrelationRatio)),
        ("ncc", Box::new(Correlation { model: (0..16).map(f64::from).collect() })),
        ("mi", Box::new(MutualInformation)),
    ];
    for (name, metric) in &metrics {
        let evaluate = || {
            let joint = DENSITY.estimate(&samples);
            (metric.value(&joint), DENSITY.scores(&samples, &metric.derivative(&joint)))
        };
        rows.push(Row::alone(format!("{name}: value and scores"), least(runs, evaluate), "ms"));
    }

    let histogram = Histogram { model_bins: 16, photo_bins: 32 };
    let hard = MutualInformation.value(&histogram.estimate(&samples));
    match &arguments.peers {
        Some(peers) => match Peer::start(peers, &fixed, &moving, &model) {
            Ok(mut peer) => {
                match peer.sklearn {
                    Some(theirs) => {
                        let difference = (hard - theirs).abs();
                        rows.push(Row::alone("hard bins, off scikit-learn's value by", difference, "nats").goal(1e-9));
                    }
                    None => notes.push("scikit-learn: missing".to_string()),
                }
                let mut warp = Warp::default();
                let (mut ours, mut theirs, mut all) = (f64::INFINITY, f64::INFINITY, f64::INFINITY);
                for _ in 0..runs {
                    theirs = theirs.min(peer.evaluate()?);
                    ours = ours.min(time(information));
                    all = all.min(time(|| warp.evaluate(&model, &moving)));
                }
                let name = format!("ITK Mattes, {} points, 2 threads", peer.points);
                let per_point = theirs * COUNT as f64 / peer.points;
                rows.push(Row::beside("value and scores", ours, per_point, &name, "ms").goal(0.1));
                rows.push(Row::beside("the same with warp and six derivatives", all, per_point, &name, "ms").goal(0.1));
                notes.push(format!(
                    "MI in nats: ours {:.4}, ITK {:.4} (other bins)",
                    warp.evaluate(&model, &moving).0,
                    peer.value
                ));
            }
            Err(error) => notes.push(format!("ITK: missing: {error:#}")),
        },
        None => notes.push("ITK, scikit-learn: missing (--peers)".to_string()),
    }
    let mut report = Report::new("mi", rows);
    report.notes = notes;
    Ok(report)
}

/// A picture and another that depends on it, with noise.
fn pictures() -> (Vec<f32>, Vec<f32>) {
    let mut random = StdRng::seed_from_u64(1);
    let at = |i: usize| {
        let (x, y) = ((i % SIDE) as f32, (i / SIDE) as f32);
        0.5 + 0.3 * (0.021 * x).sin() * (0.017 * y).cos() + 0.19 * (0.004 * (x + 1.7 * y)).sin()
    };
    let fixed: Vec<f32> = (0..COUNT).map(at).collect();
    let moving =
        fixed.iter().map(|v| (1.3 * (v - 0.55).abs() + random.random_range(0.0..0.2)).clamp(0.0, 1.0)).collect();
    (fixed, moving)
}

/// Reads both arrays and writes one number a sample.
fn plain_pass(model: &[u16], photo: &[f32]) -> Vec<f32> {
    let mut out = vec![0.0; photo.len()];
    (model.par_chunks(CHUNK), photo.par_chunks(CHUNK), out.par_chunks_mut(CHUNK)).into_par_iter().for_each(
        |(model, photo, out)| {
            for ((&u, &v), out) in model.iter().zip(photo).zip(out) {
                *out = v * f32::from(u);
            }
        },
    );
    out
}

/// The cell of each sample: its model bin, and the interval between two bins of the photo.
fn cells(model: &[u16], photo: &[f32]) -> Vec<u32> {
    let intervals = DENSITY.photo_bins as u32 - 3;
    let interval = |v: f32| ((v * intervals as f32) as u32).min(intervals - 1);
    model.iter().zip(photo).map(|(&u, &v)| u32::from(u) * intervals + interval(v)).collect()
}

/// What a table of moments cannot do without, with nothing computed: the sums of known cells grow.
fn added(cells: &[u32]) -> Vec<[f32; 4]> {
    let mut table = vec![[0.0; 4]; DENSITY.model_bins * DENSITY.photo_bins];
    let terms = std::hint::black_box([1.0, 0.5, 0.25, 0.125]);
    for &cell in cells {
        let sums = &mut table[cell as usize];
        *sums = std::array::from_fn(|k| sums[k] + terms[k]);
    }
    table
}

/// What scores cannot do without: a number of each sample's cell.
fn read(cells: &[u32]) -> Vec<f32> {
    let table = std::hint::black_box(vec![0.5; DENSITY.model_bins * DENSITY.photo_bins]);
    cells.iter().map(|&cell| table[cell as usize]).collect()
}

/// ITK's work with our density. Like ITK's, its buffers are kept from one evaluation to the next.
#[derive(Default)]
struct Warp {
    values: Vec<f32>,
    slopes: Vec<[f32; 2]>,
}

impl Warp {
    /// Warp, linear interpolation, density, and the derivatives by the six parameters of the map.
    fn evaluate(&mut self, model: &[u16], moving: &[f32]) -> (f64, [f64; 6]) {
        let [a, b, c, d, tx, ty] = AFFINE;
        let Self { values, slopes } = self;
        values.resize(COUNT, f32::NAN);
        slopes.resize(COUNT, [0.0; 2]);
        values.par_chunks_mut(SIDE).zip(slopes.par_chunks_mut(SIDE)).enumerate().for_each(|(y, (values, slopes))| {
            for (x, (value, slope)) in values.iter_mut().zip(slopes).enumerate() {
                let (u, v) = (a * x as f32 + b * y as f32 + tx, c * x as f32 + d * y as f32 + ty);
                let (column, row) = (u as i32 as usize, v as i32 as usize);
                if u >= 0.0 && v >= 0.0 && column + 1 < SIDE && row + 1 < SIDE {
                    let (s, t) = (u - column as f32, v - row as f32);
                    let above = &moving[row * SIDE + column..][..2];
                    let below = &moving[(row + 1) * SIDE + column..][..2];
                    let (high, low) = (above[0] + s * (above[1] - above[0]), below[0] + s * (below[1] - below[0]));
                    *value = high + t * (low - high);
                    *slope = [(1.0 - t) * (above[1] - above[0]) + t * (below[1] - below[0]), low - high];
                }
            }
        });
        let samples = Samples { model, photo: values };
        let joint = DENSITY.estimate(&samples);
        let scores = DENSITY.scores(&samples, &MutualInformation.derivative(&joint));
        let parts: Vec<[f64; 6]> = scores
            .par_chunks(SIDE)
            .zip(slopes.par_chunks(SIDE))
            .enumerate()
            .map(|(y, (scores, slopes))| {
                let mut sum = [0.0f32; 4];
                for (x, (score, slope)) in scores.iter().zip(slopes).enumerate() {
                    let (gx, gy) = (score * slope[0], score * slope[1]);
                    sum.iter_mut().zip([gx, gy, gx * x as f32, gy * x as f32]).for_each(|(sum, term)| *sum += term);
                }
                let [gx, gy, gx_x, gy_x] = sum.map(f64::from);
                [gx_x, gx * y as f64, gy_x, gy * y as f64, gx, gy]
            })
            .collect();
        let gradient = std::array::from_fn(|k| parts.iter().map(|part| part[k]).sum::<f64>() / COUNT as f64);
        (MutualInformation.value(&joint), gradient)
    }
}

/// The milliseconds of one call.
fn time<T>(mut call: impl FnMut() -> T) -> f64 {
    let began = Instant::now();
    std::hint::black_box(call());
    began.elapsed().as_secs_f64() * 1e3
}

fn least<T>(runs: usize, mut call: impl FnMut() -> T) -> f64 {
    (0..runs).map(|_| time(&mut call)).fold(f64::INFINITY, f64::min)
}

/// The least milliseconds of two calls taken in turn.
fn alternately<A, B>(runs: usize, mut first: impl FnMut() -> A, mut second: impl FnMut() -> B) -> (f64, f64) {
    let pairs = (0..runs).map(|_| (time(&mut first), time(&mut second)));
    pairs.fold((f64::INFINITY, f64::INFINITY), |least, pair| (least.0.min(pair.0), least.1.min(pair.1)))
}

/// A running peer.
struct Peer {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    sklearn: Option<f64>,
    points: f64,
    value: f64,
    _scratch: tempfile::TempDir,
}

impl Peer {
    fn start(folder: &Path, fixed: &[f32], moving: &[f32], model: &[u16]) -> Result<Self> {
        let scratch = tempfile::tempdir()?;
        let file = |name: &str, bytes: Vec<u8>| -> Result<_> {
            let path = scratch.path().join(name);
            std::fs::write(&path, bytes)?;
            Ok(path)
        };
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let bins: Vec<u16> = moving.iter().map(|v| ((v * 32.0) as u16).min(31)).collect();
        let labels = |values: &[u16]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        let script = file("mi_peer.py", SCRIPT.into())?;
        let mut process = python(folder)
            .arg(script)
            .args([file("fixed", floats(fixed))?, file("moving", floats(moving))?])
            .args([SIDE.to_string(), SIDE.to_string(), "32".into(), "2".into()])
            .args([file("rows", labels(model))?, file("columns", labels(&bins))?])
            .spawn()?;
        let input = process.stdin.take().context("no input")?;
        let output = BufReader::new(process.stdout.take().context("no output")?);
        let mut peer = Self { process, input, output, sklearn: None, points: 0.0, value: 0.0, _scratch: scratch };
        peer.sklearn = peer.answer("sklearn")?[0].parse().ok();
        let ready = peer.answer("ready")?;
        (peer.points, peer.value) = (ready[0].parse()?, ready[1].parse()?);
        Ok(peer)
    }

    /// The words after a keyword, without what libraries print before.
    fn answer(&mut self, keyword: &str) -> Result<Vec<String>> {
        loop {
            let mut line = String::new();
            if self.output.read_line(&mut line)? == 0 {
                bail!("it ended early; is it installed?");
            }
            let mut words = line.split_whitespace().map(str::to_string);
            if words.next().as_deref() == Some(keyword) {
                return Ok(words.collect());
            }
        }
    }

    /// One value with its gradient; the milliseconds it took.
    fn evaluate(&mut self) -> Result<f64> {
        writeln!(self.input)?;
        let mut line = String::new();
        ensure!(self.output.read_line(&mut line)? > 0, "the peer ended early");
        Ok(line.trim().parse()?)
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended by itself, which is as good.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
