//! Accuracy and capture range over cases with known cameras: where a registration ends from each kind of start.
//!
//! A case is a folder with `model.ply`, photos, `truth.json`, and `initial.json` or `correspondences.json`. Displacements are
//! means over the visible surface points of the truth, in pixels of the photo.
//!
//! `deceived` counts ends that are off by more than 0.6 % of the photo's diagonal though the verdict is good, `doubted` those within
//! 0.2 % though it is not.
//!
//! `starts.json`, where a case has it, lists starts and where MeshLab's mutual information filter ended from each, as means over
//! all vertices; those starts are scored the same way, and the last column says how often we end at least as near.

use super::{Arguments, Report, Row};
use anyhow::{Context, Result};
use nalgebra::{Matrix3, Rotation3, UnitVector3, Vector3};
use rand::{Rng, SeedableRng, rngs::StdRng};
use serde::Deserialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;
use texreg::camera::View;
use texreg::driver::{
    FocalSource, Model, Options, Outcome, Photo, Refine, Registration, Status, TruePhoto, read_truth, score,
};
use texreg::formats::{read_cameras, read_pairs};
use texreg::lie::Pose;
use texreg::surface::Mesh;

/// One registration and how it went.
struct Run {
    kind: String,
    start: f64,
    end: f64,
    /// 0.2 % of the photo's diagonal.
    tolerance: f64,
    evaluations: usize,
    milliseconds: f64,
    /// Whether the verdict is good.
    believed: bool,
    /// The standard deviation of the surface in the photo, as the outcome states it.
    stated: Option<f64>,
    /// Where MeshLab's filter ended from the same start.
    peer: Option<f64>,
}

/// Displacements that differ by less are a draw.
const DRAW: f64 = 0.05;

impl Run {
    /// Whether the end is within 0.2 % of the photo's diagonal.
    fn is_right(&self) -> bool {
        self.end < self.tolerance
    }

    /// Whether the end is off by more than three times that.
    fn is_lost(&self) -> bool {
        self.end > 3.0 * self.tolerance
    }

    fn holds_its_own(&self) -> Option<bool> {
        Some(self.end <= self.peer? + DRAW)
    }
}

/// Runs every case and prints one line for each and each kind of start.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    println!(
        "{:18} {:12} {:>4} {:>8} {:>8} {:>8} {:>6} {:>6} {:>6} {:>6} {:>7} {:>8} {:>8}",
        "case",
        "start",
        "runs",
        "from px",
        "to px",
        "worst",
        "<1 px",
        "<4 px",
        "<0.2%",
        "evals",
        "ms",
        "deceived",
        "doubted"
    );
    let mut all = Vec::new();
    for folder in case_folders(arguments)? {
        let runs = run_case(&folder, arguments).with_context(|| folder.display().to_string())?;
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for (kind, group) in by_kind(&runs) {
            print_group(&name, kind, &group);
        }
        all.extend(runs);
    }
    let mut rows = Vec::new();
    for (kind, group) in by_kind(&all) {
        print_group("all", kind, &group);
        rows.push(Row::alone(format!("lost from {kind}"), 100.0 * share(&group, |run| !run.is_right()), "%"));
        let deceived = share(&group, |run| run.is_lost() && run.believed);
        rows.push(Row::alone(format!("lost though believed from {kind}"), 100.0 * deceived, "%"));
        let found: Vec<&Run> = group.iter().copied().filter(|run| !run.is_lost() && run.stated.is_some()).collect();
        if !found.is_empty() {
            let ratio = |run: &Run| run.end / run.stated.unwrap_or(f64::NAN);
            rows.push(Row::alone(format!("error over what is stated, median from {kind}"), median(&found, ratio), ""));
            let most = found.iter().map(|run| ratio(run)).fold(0.0, f64::max);
            rows.push(Row::alone(format!("error over what is stated, most from {kind}"), most, ""));
        }
        if group.iter().any(|run| run.peer.is_some()) {
            let worse = share(&group, |run| run.holds_its_own() == Some(false));
            rows.push(Row::alone(format!("worse than MeshLab's filter from {kind}"), 100.0 * worse, "%"));
        }
    }
    Ok(Report::new("accuracy", rows))
}

fn print_group(case: &str, kind: &str, runs: &[&Run]) {
    print!(
        "{case:18} {kind:12} {:4} {:8.1} {:8.2} {:8.1} {:5.0}% {:5.0}% {:5.0}% {:6.0} {:7.0} {:7.0}% {:7.0}%",
        runs.len(),
        median(runs, |run| run.start),
        median(runs, |run| run.end),
        runs.iter().map(|run| run.end).fold(0.0, f64::max),
        100.0 * share(runs, |run| run.end < 1.0),
        100.0 * share(runs, |run| run.end < 4.0),
        100.0 * share(runs, Run::is_right),
        median(runs, |run| run.evaluations as f64),
        median(runs, |run| run.milliseconds),
        100.0 * share(runs, |run| run.is_lost() && run.believed),
        100.0 * share(runs, |run| run.is_right() && !run.believed),
    );
    if runs.iter().any(|run| run.peer.is_some()) {
        let peer = median(runs, |run| run.peer.unwrap_or(f64::INFINITY));
        print!("  MeshLab {peer:.2}, no worse {:.0}%", 100.0 * share(runs, |run| run.holds_its_own() == Some(true)));
    }
    println!();
}

fn run_case(folder: &Path, arguments: &Arguments) -> Result<Vec<Run>> {
    let truth = read_truth(&folder.join("truth.json"))?;
    let mesh = texreg::surface::load(folder.join("model.ply"))?;
    let initial = folder.join("initial.json");
    let initial = if initial.exists() { Some(read_cameras(&initial)?) } else { None };
    let pairs = folder.join("correspondences.json");
    let pairs = if pairs.exists() { read_pairs(&pairs)? } else { Vec::new() };
    let starts = folder.join("starts.json");
    let starts =
        if starts.exists() { serde_json::from_slice::<Starts>(&std::fs::read(&starts)?)?.starts } else { Vec::new() };
    let mut runs = Vec::new();
    let model = Model::new(&mesh, &arguments.signal)?;
    let options = Options { metric: arguments.metric, channel: arguments.channel, ..Options::default() };
    let rough = Options { focal_from: FocalSource::Guessed, ..options };
    let focal = Options { refine: Refine { focal: true, ..Refine::default() }, ..rough };
    let all = Options { refine: Refine { focal: true, principal: true, distortion: true }, ..rough };
    for true_photo in &truth.photos {
        let photo = Photo::load(folder.join(&true_photo.file))?;
        let fixed = Registration::new(&model, &photo, &options);
        let focal = Registration::new(&model, &photo, &focal);
        let all = Registration::new(&model, &photo, &all);
        let wanted = |kind: &str| arguments.only.as_ref().is_none_or(|only| kind.starts_with(only.as_str()));
        let mut record = |kind: &str, registration: &Registration, start: View| {
            if wanted(kind) {
                runs.push(register(kind, registration, true_photo, truth.diagonal, &start));
            }
        };
        record("truth", &fixed, true_photo.view);
        if let Some(entry) = initial.as_ref().and_then(|file| file.entry(&true_photo.file)) {
            record("initial", &fixed, View { camera: true_photo.view.camera, pose: entry.pose });
            record("nominal", &all, entry.view([photo.width, photo.height]));
            record("focal", &focal, entry.view([photo.width, photo.height]));
        }
        if let Some(entry) = pairs.iter().find(|entry| entry.file == true_photo.file) {
            let camera = true_photo.view.camera;
            if let Ok(solution) = texreg::posit::pose(&entry.points, &camera, &Default::default()) {
                record("pairs", &fixed, solution.view);
            }
        }
        if starts.iter().any(|start| start.camera.file == true_photo.file) {
            let vertices = (0..mesh.positions.len()).map(|i| mesh.point(i)).collect();
            let over_vertices = TruePhoto { visible: vertices, ..true_photo.clone() };
            let of_photo = starts
                .iter()
                .filter(|start| start.camera.file == true_photo.file && wanted(&format!("starts {}", start.level)));
            for start in of_photo.take(if arguments.quick { 10 } else { usize::MAX }) {
                let view = View { camera: true_photo.view.camera, pose: start.camera.pose() };
                let kind = format!("starts {}", start.level);
                let run = register(&kind, &fixed, &over_vertices, truth.diagonal, &view);
                runs.push(Run { peer: Some(start.meshlab_px), ..run });
            }
        }
        if wanted("search") {
            runs.push(find(&fixed, true_photo, truth.diagonal));
        }
        let mut record = |kind: &str, registration: &Registration, start: View| {
            if wanted(kind) {
                runs.push(register(kind, registration, true_photo, truth.diagonal, &start));
            }
        };
        let seeds = if arguments.quick { 2 } else { 10 };
        for level in [2.0, 5.0, 10.0] {
            for seed in 0..seeds {
                let start = perturbed(&mesh, &true_photo.view, level, seed);
                record(&format!("{level}°/{level} %"), &fixed, start);
            }
        }
    }
    Ok(runs)
}

fn register(kind: &str, registration: &Registration, photo: &TruePhoto, diagonal: f64, start: &View) -> Run {
    let started = Instant::now();
    let outcome = registration.run(start, &mut |_| ControlFlow::Continue(()));
    judge(kind, outcome.as_ref().ok(), started, photo, diagonal, start)
}

/// A search with nothing but the true camera.
fn find(registration: &Registration, photo: &TruePhoto, diagonal: f64) -> Run {
    let mut first = None;
    let started = Instant::now();
    let outcome = registration.search(&photo.view.camera, &mut |event| {
        first.get_or_insert(event.view);
        ControlFlow::Continue(())
    });
    judge("search", outcome.as_ref().ok(), started, photo, diagonal, &first.unwrap_or(photo.view))
}

fn judge(
    kind: &str,
    outcome: Option<&Outcome>,
    started: Instant,
    photo: &TruePhoto,
    diagonal: f64,
    start: &View,
) -> Run {
    let milliseconds = started.elapsed().as_secs_f64() * 1e3;
    let camera = photo.view.camera;
    let distance = |view: &View| score(photo, diagonal, view).mean_px;
    Run {
        kind: kind.to_string(),
        start: distance(start),
        end: distance(outcome.map_or(start, |outcome| &outcome.view)),
        tolerance: 0.002 * f64::from(camera.width).hypot(f64::from(camera.height)),
        evaluations: outcome.map_or(0, Outcome::evaluations),
        milliseconds,
        believed: outcome.is_some_and(|outcome| outcome.status == Status::Registered),
        stated: outcome.and_then(|outcome| Some(outcome.uncertainty.as_ref()?.pixels)),
        peer: None,
    }
}

/// `starts.json`.
#[derive(Deserialize)]
struct Starts {
    starts: Vec<Start>,
}

/// A start, and where MeshLab's filter ended from it.
#[derive(Deserialize)]
struct Start {
    level: String,
    camera: StartCamera,
    meshlab_px: f64,
}

#[derive(Deserialize)]
#[allow(non_snake_case)]
struct StartCamera {
    file: String,
    R: [[f64; 3]; 3],
    T: [f64; 3],
}

impl StartCamera {
    fn pose(&self) -> Pose {
        let matrix = Matrix3::from_fn(|row, column| self.R[row][column]);
        Pose::new(Rotation3::from_matrix(&matrix), self.T.into())
    }
}

/// The model turned by `level` degrees about its centre and the camera moved by `level` percent of the bounding box's
/// diagonal, both in a random direction.
pub(crate) fn perturbed(mesh: &Mesh, view: &View, level: f64, seed: u64) -> View {
    let mut random = StdRng::seed_from_u64(seed);
    let mut direction = || -> UnitVector3<f64> {
        let place = Vector3::from_fn(|_, _| random.random_range(-1.0..1.0f64));
        UnitVector3::new_normalize(place)
    };
    let turn = Rotation3::from_axis_angle(&direction(), level.to_radians());
    let shift = direction().into_inner() * (0.01 * level * mesh.diagonal());
    let centre = mesh.centre().coords;
    let rotation = view.pose.rotation * turn;
    let translation = view.pose.rotation * (centre - turn * centre) + view.pose.translation + shift;
    View { camera: view.camera, pose: Pose::new(rotation, translation) }
}

/// The folders below `--cases` (or the fixtures) that hold a model and its truth.
pub(crate) fn case_folders(arguments: &Arguments) -> Result<Vec<PathBuf>> {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures");
    let root = arguments.cases.clone().unwrap_or(fixtures);
    let is_case = |folder: &Path| folder.join("model.ply").exists() && folder.join("truth.json").exists();
    if is_case(&root) {
        return Ok(vec![root]);
    }
    let entries = std::fs::read_dir(&root).with_context(|| root.display().to_string())?;
    let mut folders: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|p| is_case(p)).collect();
    folders.sort();
    Ok(folders)
}

fn by_kind(runs: &[Run]) -> Vec<(&str, Vec<&Run>)> {
    let mut groups: Vec<(&str, Vec<&Run>)> = Vec::new();
    for run in runs {
        match groups.iter_mut().find(|(kind, _)| *kind == run.kind) {
            Some((_, group)) => group.push(run),
            None => groups.push((&run.kind, vec![run])),
        }
    }
    groups
}

fn median(runs: &[&Run], value: impl Fn(&Run) -> f64) -> f64 {
    let mut values: Vec<f64> = runs.iter().map(|run| value(run)).collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn share(runs: &[&Run], holds: impl Fn(&Run) -> bool) -> f64 {
    runs.iter().filter(|run| holds(run)).count() as f64 / runs.len() as f64
}
