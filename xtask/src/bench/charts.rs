//! Charts and solvers compared: whether it matters in which chart a rotation is stepped, and by which solver.
//!
//! Each case's first photo is climbed from views near the truth (2 degrees and 2 % of the diagonal off), through the levels,
//! without looking around first: with every chart and every solver. Two charts run once more with the world frame turned to where they
//! are worst: Euler angles a hundredth of a degree from the gimbal lock, rotation vectors a hundredth of a degree from half a
//! turn. The same starts for all.

use super::accuracy::{case_folders, perturbed};
use super::{Arguments, Report, Row};
use anyhow::{Context, Result};
use nalgebra::{Rotation3, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::time::Instant;
use texreg::camera::View;
use texreg::driver::{Model, Options, Photo, Registration, RotationName, SolverName, TruePhoto, read_truth, score};
use texreg::lie::{Pose, so3};
use texreg::surface::Mesh;

/// How far from where a chart is singular, radians.
const NEAR: f64 = 1.7e-4;

/// A world frame: its name, where it puts the true rotation (`None` leaves it), and the charts to try there.
type Frame = (&'static str, Option<Rotation3<f64>>, &'static [RotationName]);

fn frames() -> [Frame; 3] {
    let lock = Rotation3::from_euler_angles(0.3, FRAC_PI_2 - NEAR, 0.8);
    let half = so3::exp(&(Vector3::new(2.0, -1.0, 0.5).normalize() * (PI - NEAR)));
    [
        ("as it is", None, RotationName::ALL),
        ("gimbal lock", Some(lock), &[RotationName::Euler]),
        ("half a turn", Some(half), &[RotationName::AxisAngle]),
    ]
}

/// What one chart and solver did over the cases.
#[derive(Default)]
struct Tally {
    runs: usize,
    right: usize,
    ends: Vec<f64>,
    evaluations: usize,
    milliseconds: f64,
}

/// Climbs every case with every chart and solver.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let mut folders = case_folders(arguments)?;
    if arguments.quick {
        folders.truncate(2);
    }
    let mut tallies: Vec<(String, Tally)> = Vec::new();
    for folder in &folders {
        let mesh = texreg::surface::load(folder.join("model.ply"))?;
        let truth = read_truth(&folder.join("truth.json"))?;
        let true_photo = truth.photos.first().context("truth.json has no photo")?;
        let photo = Photo::load(folder.join(&true_photo.file))?;
        for (frame, target, charts) in frames() {
            let turn = target.map_or(Rotation3::identity(), |target| target.inverse() * true_photo.view.pose.rotation);
            let mesh = turned(&mesh, &turn);
            let there = |view: &View| {
                let rotation = view.pose.rotation * turn.inverse();
                View { camera: view.camera, pose: Pose::new(rotation, view.pose.translation) }
            };
            let visible = true_photo.visible.iter().map(|point| turn * point).collect();
            let true_view = TruePhoto { file: true_photo.file.clone(), view: there(&true_photo.view), visible };
            let model = Model::new(&mesh, &[])?;
            for &solver in SolverName::ALL {
                for &rotation in charts {
                    let options = Options { rotation, solver, ..Options::default() };
                    let registration = Registration::new(&model, &photo, &options);
                    let name = format!("{frame:11} {solver:11} {rotation}");
                    let place = tallies.iter().position(|(other, _)| *other == name).unwrap_or(tallies.len());
                    if place == tallies.len() {
                        tallies.push((name, Tally::default()));
                    }
                    let tally = &mut tallies[place].1;
                    let start = perturbed(&mesh, &true_view.view, 2.0, 0);
                    let began = Instant::now();
                    let Some((end, evaluations)) = registration.climb_from(&start) else { continue };
                    tally.milliseconds += began.elapsed().as_secs_f64() * 1e3;
                    let off = score(&true_view, truth.diagonal, &end).mean_px;
                    let camera = &true_view.view.camera;
                    let tolerance = 2e-3 * f64::from(camera.width).hypot(f64::from(camera.height));
                    tally.runs += 1;
                    tally.right += usize::from(off < tolerance);
                    tally.ends.push(off);
                    tally.evaluations += evaluations;
                }
            }
        }
    }
    println!("{} cases, one start each\n", folders.len());
    println!(
        "{:11} {:11} {:11} {:>5} {:>8} {:>8} {:>7} {:>7}",
        "frame", "solver", "chart", "runs", "<0.2%", "px", "evals", "ms"
    );
    let mut rows = Vec::new();
    for (name, mut tally) in tallies {
        tally.ends.sort_by(f64::total_cmp);
        let runs = tally.runs.max(1);
        let middle = tally.ends.get(tally.ends.len() / 2).copied().unwrap_or(f64::NAN);
        let share = 100.0 * tally.right as f64 / runs as f64;
        println!(
            "{name:35} {:>5} {share:>7.0}% {middle:>8.2} {:>7} {:>7.0}",
            tally.runs,
            tally.evaluations / runs,
            tally.milliseconds / runs as f64
        );
        rows.push(Row::alone(format!("{}, right", name.split_whitespace().collect::<Vec<_>>().join(" ")), share, "%"));
    }
    Ok(Report::new("charts", rows))
}

/// The mesh in a turned frame.
fn turned(mesh: &Mesh, turn: &Rotation3<f64>) -> Mesh {
    let mut mesh = mesh.clone();
    mesh.origin = turn * mesh.origin;
    let matrix = turn.matrix().cast::<f32>();
    for vector in mesh.positions.iter_mut().chain(&mut mesh.normals) {
        *vector = (matrix * Vector3::from(*vector)).into();
    }
    mesh
}
