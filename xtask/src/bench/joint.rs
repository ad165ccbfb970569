//! Photos registered jointly: how far from the truth beside the same photos alone, and how time and memory grow with their number.
//!
//! Cases start from the rough cameras of `initial.json` with their nominal lens; focal length and distortion are refined, alone
//! and jointly with one camera for all. The growth is measured on copies of the first case's photos, each seen from the same
//! place by a camera that is turned a little, so that its picture is another one.

use super::accuracy::case_folders;
use super::{Arguments, Report, Row};
use anyhow::{Context, Result};
use nalgebra::{Point2, Rotation3, Vector3};
use std::ops::ControlFlow;
use std::path::Path;
use texreg::camera::View;
use texreg::driver::{
    FocalSource, Model, Options, Outcome, Photo, Refine, Registration, Score, TruePhoto, read_truth, register_jointly,
    score,
};
use texreg::formats::read_cameras;
use texreg::lie::Pose;

pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let folders = case_folders(arguments)?;
    let smallest = folders.first().context("no case")?;
    // Before the cases, which leave memory behind.
    let growth = growth(smallest, if arguments.quick { &[4, 8, 16] } else { &[10, 30, 100] })?;
    let mut rows = Vec::new();
    for folder in &folders {
        rows.extend(accuracy(folder).with_context(|| folder.display().to_string())?);
    }
    rows.extend(growth);
    Ok(Report::new("joint", rows))
}

/// One case from its rough cameras, alone and jointly.
fn accuracy(folder: &Path) -> Result<Vec<Row>> {
    let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let truth = read_truth(&folder.join("truth.json"))?;
    if truth.photos.len() < 2 || !folder.join("initial.json").exists() {
        return Ok(Vec::new());
    }
    let initial = read_cameras(&folder.join("initial.json"))?;
    let mesh = texreg::surface::load(folder.join("model.ply"))?;
    let model = Model::new(&mesh, &[])?;
    let refine = Refine { focal: true, distortion: true, ..Refine::default() };
    let options = Options { refine, focal_from: FocalSource::Guessed, share_intrinsics: true, ..Options::default() };
    let photos = truth.photos.iter().map(|photo| Photo::load(folder.join(&photo.file)));
    let photos: Vec<Photo> = photos.collect::<Result<_, _>>()?;
    let starts = photos.iter().map(|photo| {
        let entry = initial.entry(&photo.file).with_context(|| format!("initial.json does not name {}", photo.file))?;
        Ok(entry.view([photo.width, photo.height]))
    });
    let starts: Vec<View> = starts.collect::<Result<_>>()?;
    let ready: Vec<Registration> = photos.iter().map(|photo| Registration::new(&model, photo, &options)).collect();
    let alone = ready.iter().zip(&starts).map(|(photo, start)| photo.run(start, &mut |_| ControlFlow::Continue(())));
    let alone: Vec<Outcome> = alone.collect::<Result<_, _>>()?;
    let joint = jointly(&ready, &starts, &options)?;
    let scores = |outcomes: &[Outcome]| -> Vec<Score> {
        let pairs = truth.photos.iter().zip(outcomes);
        pairs.map(|(photo, outcome): (&TruePhoto, _)| score(photo, truth.diagonal, &outcome.view)).collect()
    };
    let (before, after) = (scores(&alone), scores(&joint));
    let mean = |scores: &[Score], of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    let row = |what: &str, of: fn(&Score) -> f64, unit| {
        Row::beside(format!("{name}: {what}"), mean(&after, of), mean(&before, of), "alone", unit)
    };
    let mut rows = vec![
        row("mean px", |score| score.mean_px.min(1e3), "px"),
        row("worst point", |score| score.max_px.min(1e4), "px"),
        row("focal length off", |score| score.focal_pct.abs(), "%"),
        row("photos off by 0.2 % or more", |score| f64::from(u8::from(!score.ok)), ""),
    ];
    let stated = joint
        .iter()
        .zip(&after)
        .filter_map(|(outcome, score)| Some(score.mean_px / outcome.uncertainty.as_ref()?.pixels));
    let mut stated: Vec<f64> = stated.collect();
    stated.sort_by(f64::total_cmp);
    if let Some(&median) = stated.get(stated.len() / 2) {
        rows.push(Row::alone(format!("{name}: error over what is stated, median"), median, ""));
    }
    Ok(rows)
}

fn jointly(photos: &[Registration], starts: &[View], options: &Options) -> Result<Vec<Outcome>> {
    let outcomes = register_jointly(photos, starts, options, &mut |_| ControlFlow::Continue(()));
    outcomes.map_err(|(photo, error)| anyhow::anyhow!("photo {photo}: {error}"))
}

/// Processor time and memory a photo, for growing numbers of photos.
fn growth(folder: &Path, counts: &[usize]) -> Result<Vec<Row>> {
    let truth = read_truth(&folder.join("truth.json"))?;
    let mesh = texreg::surface::load(folder.join("model.ply"))?;
    let model = Model::new(&mesh, &[])?;
    let refine = Refine { focal: true, ..Refine::default() };
    let options = Options { refine, share_intrinsics: true, ..Options::default() };
    let originals = truth.photos.iter().map(|photo| Photo::load(folder.join(&photo.file)));
    let originals: Vec<Photo> = originals.collect::<Result<_, _>>()?;
    let mut figures = Vec::new();
    // What fewer photos leave behind is used again.
    let before = resident();
    for &count in counts {
        let began = processor_milliseconds();
        let copies: Vec<(Photo, View)> = (0..count)
            .map(|k| turned(&originals[k % originals.len()], &truth.photos[k % originals.len()].view, k))
            .collect();
        let ready: Vec<Registration> =
            copies.iter().map(|(photo, _)| Registration::new(&model, photo, &options)).collect();
        let starts: Vec<View> = copies.iter().map(|(_, view)| *view).collect();
        let outcomes = jointly(&ready, &starts, &options)?;
        let each = |total: f64| total / outcomes.len() as f64;
        figures.push((count, each(processor_milliseconds() - began), each((resident() - before).max(0.0))));
    }
    let (first, time, memory) = figures[0];
    let rows = figures[1..].iter().flat_map(|&(count, ms, megabytes)| {
        [
            Row::beside(format!("{count} photos, processor time each"), ms, time, format!("{first} photos"), "ms")
                .goal(1.2),
            Row::beside(format!("{count} photos, memory each"), megabytes, memory, format!("{first} photos"), "MB")
                .goal(1.2),
        ]
    });
    Ok(rows.collect())
}

/// A photo as a camera in the same place would take it that is turned by up to two degrees: pixels are looked up along their rays
/// (the nearest, and the photo's border beyond it).
fn turned(photo: &Photo, view: &View, k: usize) -> (Photo, View) {
    let angle = |rate: f64| 0.035 * (rate * (k + 1) as f64).sin();
    let turn = Rotation3::from_scaled_axis(Vector3::new(angle(1.3), angle(2.1), angle(3.7)));
    let other = View { camera: view.camera, pose: Pose::new(turn * view.pose.rotation, turn * view.pose.translation) };
    let source = |i: u32| {
        let pixel = Point2::new(f64::from(i % photo.width), f64::from(i / photo.width));
        let ray = view.camera.unproject(&pixel).map(|ray| turn.inverse() * ray);
        let seen = ray.and_then(|ray| view.camera.project(&ray.into())).unwrap_or(pixel);
        let within = |x: f64, size: u32| x.round().clamp(0.0, f64::from(size - 1)) as usize;
        within(seen.y, photo.height) * photo.width as usize + within(seen.x, photo.width)
    };
    let sources: Vec<usize> = (0..photo.width * photo.height).map(source).collect();
    let copy = Photo {
        file: format!("{k}_{}", photo.file),
        luma: sources.iter().map(|&i| photo.luma[i]).collect(),
        rgb: sources.iter().map(|&i| photo.rgb[i]).collect(),
        ..photo.clone()
    };
    (copy, other)
}

/// The time that processors worked for this process, whatever else they did; zero where the system does not tell.
fn processor_milliseconds() -> f64 {
    let status = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = status.rsplit(')').next().unwrap_or_default();
    // Of the user and of the system, in hundredths of a second.
    after_name.split_whitespace().skip(11).take(2).filter_map(|ticks| ticks.parse::<f64>().ok()).sum::<f64>() * 10.0
}

/// The memory this process holds, in megabytes; zero where the system does not tell.
fn resident() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
    kilobytes.unwrap_or_default() / 1024.0
}
