//! Accuracy and capture range over cases with known cameras: where a registration ends from each kind of start.
//!
//! A case is a folder with `model.ply`, photos, `truth.json`, and `initial.json` or `correspondences.json`. Displacements are
//! means over the visible surface points of the truth, in pixels of the photo.

use super::{Arguments, Report, Row};
use anyhow::{Context, Result};
use nalgebra::{Rotation3, UnitVector3, Vector3};
use rand::{Rng, SeedableRng, rngs::StdRng};
use std::path::{Path, PathBuf};
use std::time::Instant;
use texreg::camera::View;
use texreg::driver::{Model, Options, Photo, Refine, Registration, Truth, read_cameras, read_pairs, read_truth, score};
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
}

/// Runs every case and prints one line for each and each kind of start.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let seeds = if arguments.quick { 2 } else { 10 };
    println!(
        "{:18} {:10} {:>4} {:>8} {:>8} {:>8} {:>6} {:>6} {:>6} {:>6} {:>7}",
        "case", "start", "runs", "from px", "to px", "worst", "<1 px", "<4 px", "<0.2%", "evals", "ms"
    );
    let mut all = Vec::new();
    for folder in case_folders(arguments)? {
        let runs = run_case(&folder, seeds).with_context(|| folder.display().to_string())?;
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        for (kind, group) in by_kind(&runs) {
            print_group(&name, kind, &group);
        }
        all.extend(runs);
    }
    let mut rows = Vec::new();
    for (kind, group) in by_kind(&all) {
        print_group("all", kind, &group);
        rows.push(Row::alone(format!("lost from {kind}"), 100.0 * share(&group, |run| run.end >= run.tolerance), "%"));
    }
    Ok(Report::new("accuracy", rows))
}

fn print_group(case: &str, kind: &str, runs: &[&Run]) {
    println!(
        "{case:18} {kind:10} {:4} {:8.1} {:8.2} {:8.1} {:5.0}% {:5.0}% {:5.0}% {:6.0} {:7.0}",
        runs.len(),
        median(runs, |run| run.start),
        median(runs, |run| run.end),
        runs.iter().map(|run| run.end).fold(0.0, f64::max),
        100.0 * share(runs, |run| run.end < 1.0),
        100.0 * share(runs, |run| run.end < 4.0),
        100.0 * share(runs, |run| run.end < run.tolerance),
        median(runs, |run| run.evaluations as f64),
        median(runs, |run| run.milliseconds),
    );
}

fn run_case(folder: &Path, seeds: u64) -> Result<Vec<Run>> {
    let truth = read_truth(&folder.join("truth.json"))?;
    let mesh = texreg::surface::load(folder.join("model.ply"))?;
    let initial = folder.join("initial.json");
    let initial = if initial.exists() { Some(read_cameras(&initial)?) } else { None };
    let pairs = folder.join("correspondences.json");
    let pairs = if pairs.exists() { read_pairs(&pairs)? } else { Vec::new() };
    let mut runs = Vec::new();
    let model = Model::new(&mesh, &[])?;
    let options = Options::default();
    let refining = Options { refine: Refine { focal: true, ..Refine::default() }, ..Options::default() };
    for (index, true_photo) in truth.photos.iter().enumerate() {
        let photo = Photo::load(folder.join(&true_photo.file))?;
        let fixed = Registration::new(&model, &photo, &options);
        let refining = Registration::new(&model, &photo, &refining);
        let mut record = |kind: &str, registration: &Registration, start: View| {
            runs.push(register(kind, registration, &truth, index, &start));
        };
        record("truth", &fixed, true_photo.view);
        if let Some(entry) = initial.as_ref().and_then(|file| file.entry(&true_photo.file)) {
            record("initial", &fixed, View { camera: true_photo.view.camera, pose: entry.pose });
            record("nominal", &refining, entry.view([photo.width, photo.height]));
        }
        if let Some(entry) = pairs.iter().find(|entry| entry.file == true_photo.file) {
            let camera = true_photo.view.camera;
            if let Ok(solution) = texreg::posit::pose(&entry.points, &camera, &Default::default()) {
                record("pairs", &fixed, solution.view);
            }
        }
        for level in [2.0, 5.0, 10.0] {
            for seed in 0..seeds {
                let start = perturbed(&mesh, &true_photo.view, level, seed);
                record(&format!("{level}°/{level} %"), &fixed, start);
            }
        }
    }
    Ok(runs)
}

fn register(kind: &str, registration: &Registration, truth: &Truth, index: usize, start: &View) -> Run {
    let photo = &truth.photos[index];
    let camera = photo.view.camera;
    let started = Instant::now();
    let outcome = registration.run(start, &mut |_| ());
    let milliseconds = started.elapsed().as_secs_f64() * 1e3;
    if std::env::var("DBG").is_ok()
        && let Ok(o) = &outcome
    {
        let mut v: Vec<(f64, f64)> = photo
            .visible
            .iter()
            .filter_map(|p| {
                let d = o.view.project(p)? - photo.view.project(p)?;
                Some((d.x, d.y))
            })
            .collect();
        let n = v.len() as f64;
        let m = (v.iter().map(|d| d.0).sum::<f64>() / n, v.iter().map(|d| d.1).sum::<f64>() / n);
        v.sort_by(|a, b| a.0.total_cmp(&b.0));
        eprintln!(
            "{kind} mean displacement {:.2} {:.2}  x range {:.2} {:.2}  focal {:.2}%",
            m.0,
            m.1,
            v[0].0,
            v[v.len() - 1].0,
            score(photo, truth.diagonal, &o.view).focal_pct
        );
        for s in &o.stages {
            eprintln!(
                "   {} {} evals {} renders {:.4} -> {:.4}  {:.0} ms",
                s.name, s.evaluations, s.renderings, s.similarity.0, s.similarity.1, s.milliseconds
            );
        }
    }
    let distance = |view: &View| score(photo, truth.diagonal, view).mean_px;
    Run {
        kind: kind.to_string(),
        start: distance(start),
        end: distance(outcome.as_ref().map_or(start, |outcome| &outcome.view)),
        tolerance: 0.002 * f64::from(camera.width).hypot(f64::from(camera.height)),
        evaluations: outcome.as_ref().map_or(0, |outcome| outcome.evaluations()),
        milliseconds,
    }
}

/// The model turned by `level` degrees about its centre and the camera moved by `level` percent of the bounding box's
/// diagonal, both in a random direction.
fn perturbed(mesh: &Mesh, view: &View, level: f64, seed: u64) -> View {
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
