//! How long one registration takes, stage by stage: a photo of 1600×1200 pixels and the model of a case.
//!
//! The photo of the case is resized to that and its start taken from `initial.json`, with the true lens. The stages run in this
//! process; the last row is the whole program, from the command to its files.

use super::{Arguments, Report, Row, accuracy};
use anyhow::{Context, Result, ensure};
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;
use std::time::Instant;
use texreg::camera::View;
use texreg::driver::{Model, Options, Photo, Registration, read_truth, score};
use texreg::formats::{CameraEntry, CameraFile, read_cameras, write_cameras};

/// Milliseconds the refinement may take, and the whole program.
const REFINEMENT: f64 = 500.0;
const PROGRAM: f64 = 1500.0;

/// Width of the photo.
const WIDTH: u32 = 1600;

/// Measures the first case.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let folder = accuracy::case_folders(arguments)?.into_iter().next().context("no case found")?;
    let model_path = folder.join("model.ply");
    let truth = read_truth(&folder.join("truth.json"))?;
    let true_photo = &truth.photos[0];
    let scratch = tempfile::tempdir()?;
    let photo_path = scratch.path().join(&true_photo.file);
    let factor = f64::from(WIDTH) / f64::from(true_photo.view.camera.width);
    let camera = true_photo.view.camera.scaled(factor);
    let picture = image::open(folder.join(&true_photo.file))?;
    let resized = picture.resize_exact(camera.width, camera.height, image::imageops::FilterType::CatmullRom);
    resized.to_rgb8().save(&photo_path)?;
    let initial = read_cameras(&folder.join("initial.json"))?;
    let pose = initial.entry(&true_photo.file).context("initial.json has no entry of the photo")?.pose;
    let start = View { camera, pose };
    let start_path = scratch.path().join("start.json");
    let entry = CameraEntry::new(&true_photo.file, &start);
    write_cameras(&start_path, &CameraFile { photos: vec![entry], ..CameraFile::default() })?;

    let rounds = if arguments.quick { 3 } else { 9 };
    let mut table: Vec<(String, Vec<f64>)> = Vec::new();
    let mut end = 0.0;
    let mut triangles = 0;
    for _ in 0..rounds {
        let mut column = 0;
        let mut record = |name: &str, milliseconds: f64| {
            if table.len() == column {
                table.push((name.to_string(), Vec::new()));
            }
            table[column].1.push(milliseconds);
            column += 1;
        };
        let began = Instant::now();
        let mesh = texreg::surface::load(&model_path)?;
        record("read the model", since(began));
        triangles = mesh.triangles.len();
        let began = Instant::now();
        let photo = Photo::load(&photo_path)?;
        record("read the photo", since(began));
        let began = Instant::now();
        let model = Model::new(&mesh, &[])?;
        record("ready the model", since(began));
        let began = Instant::now();
        let options = Options::default();
        let registration = Registration::new(&model, &photo, &options);
        record("ready the photo", since(began));
        let began = Instant::now();
        let outcome = registration.run(&start, &mut |_| ControlFlow::Continue(()))?;
        let refinement = since(began);
        for stage in &outcome.stages {
            record(&format!("  {}", stage.name), stage.milliseconds);
        }
        record("refinement", refinement);
        let began = Instant::now();
        register_by_program(&model_path, &photo_path, &start_path, scratch.path())?;
        record("whole program", since(began));
        let true_view = texreg::driver::TruePhoto {
            file: true_photo.file.clone(),
            view: View { camera, pose: true_photo.view.pose },
            visible: true_photo.visible.clone(),
        };
        end = score(&true_view, truth.diagonal, &outcome.view).mean_px;
    }
    println!(
        "{}: {} triangles, {}×{} pixels, ends {end:.2} px from the truth; medians of {rounds} runs",
        folder.display(),
        triangles,
        camera.width,
        camera.height
    );
    let rows = table.into_iter().map(|(name, mut times)| {
        times.sort_by(f64::total_cmp);
        let row = Row::alone(&name, times[times.len() / 2], "ms");
        match name.as_str() {
            "refinement" => row.goal(REFINEMENT),
            "whole program" => row.goal(PROGRAM),
            _ => row,
        }
    });
    Ok(Report::new("register", rows.collect()))
}

/// Runs `texreg register`, which stands beside this program.
fn register_by_program(model: &Path, photo: &Path, start: &Path, scratch: &Path) -> Result<()> {
    let program = std::env::current_exe()?.with_file_name(format!("texreg{}", std::env::consts::EXE_SUFFIX));
    if !program.exists() {
        let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_string());
        let built = Command::new(cargo).args(["build", "--release", "--quiet", "--bin", "texreg"]).status()?;
        ensure!(built.success() && program.exists(), "{}: cannot be built", program.display());
    }
    let output = Command::new(program)
        .arg("register")
        .args([model, photo])
        .arg("--init")
        .arg(start)
        .arg("-o")
        .arg(scratch.join("out"))
        .output()?;
    ensure!(output.status.success(), "texreg register: {}", String::from_utf8_lossy(&output.stderr).trim());
    Ok(())
}

fn since(began: Instant) -> f64 {
    began.elapsed().as_secs_f64() * 1e3
}
