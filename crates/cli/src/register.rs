//! `texreg register`: from photos with a rough start to cameras, pictures and a report.

use std::ops::ControlFlow;
use std::path::Path;

use anyhow::{anyhow, bail};
use clap::CommandFactory as _;
use clap::error::ErrorKind;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};
use texreg::camera::View;
use texreg::driver::{
    Bounds, Event, FocalSource, Model, Motion, Options, Outcome, Panel, Photo, Refine, Registration, Stage, Status,
    Stop, Uncertainty, motion, overlay, register, register_jointly, search,
};
use texreg::formats::{CameraEntry, CameraFile, write_cameras};
use texreg::surface::Mesh;

use crate::Ending;
use crate::args::{Args, Part, Register};
use crate::handover;
use crate::inputs::{Inputs, masked, model, name, photo};
use crate::output::{Output, jpeg, overlay_name, print, table};
use crate::report;

/// A photo that went through registration.
pub(crate) struct Registered {
    /// The photo's file name.
    pub(crate) file: String,
    /// The view it started from.
    pub(crate) start: View,
    /// What came of it.
    pub(crate) outcome: Outcome,
    /// How far the camera moved from its start.
    pub(crate) motion: Motion,
    /// The overlay picture, a JPEG file.
    pub(crate) overlay: Vec<u8>,
}

impl Registered {
    /// Whether the verdict is good.
    pub(crate) fn is_good(&self) -> bool {
        self.outcome.status == Status::Registered
    }

    /// The verdict in one word.
    pub(crate) fn verdict(&self) -> &'static str {
        word(self.outcome.status)
    }

    /// The verdict's reasons, and whether the climb came to its end.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let limit = self.outcome.stop == Stop::Exhausted;
        let limit =
            limit.then(|| "the last climb ended at its limit of iterations, perhaps short of the maximum".to_owned());
        self.outcome.reasons.iter().cloned().chain(limit).collect()
    }

    fn entry(&self) -> CameraEntry {
        let mut entry = CameraEntry::new(&self.file, &self.outcome.view);
        let (start, end) = self.outcome.similarity;
        entry.other.insert("status".into(), json!(self.verdict()));
        entry.other.insert("reasons".into(), json!(self.outcome.reasons));
        entry.other.insert("similarity".into(), json!({"start": start, "end": end}));
        entry.other.insert("uncertainty".into(), json!(self.outcome.uncertainty.as_ref().map(Uncertainty::json)));
        entry
    }
}

pub(crate) fn run(args: &Register, json: bool) -> anyhow::Result<Ending> {
    let joint = args.joint || args.share_intrinsics;
    if let Some(contradiction) = args.contradiction() {
        let mut command = Args::command();
        command.build();
        let mut register = command.find_subcommand("register").cloned().unwrap_or(command);
        register.error(ErrorKind::ArgumentConflict, contradiction).exit();
    }
    let inputs = Inputs::read(&args.inputs, args.init.as_deref())?;
    let output = Output::open(&args.inputs.output)?;
    let mesh = model(&args.inputs.model)?;
    let refines = |part| args.refine.contains(&part);
    let options = Options {
        metric: args.metric,
        channel: args.channel,
        bins: args.bins,
        rotation: args.rotation,
        solver: args.solver,
        refine: Refine {
            focal: refines(Part::Focal),
            principal: refines(Part::Principal),
            distortion: refines(Part::Distortion),
        },
        focal_from: if args.init.is_some() && args.inputs.camera.is_none() {
            FocalSource::Guessed
        } else {
            FocalSource::Stated
        },
        bounds: Bounds { focal: args.focal_range, principal: args.principal_within, distance: args.distance_range },
        share_intrinsics: args.share_intrinsics,
        seed: args.seed,
    };
    let ready = Model::new(&mesh, &args.signal).map_err(|error| anyhow!("{}: {error}", args.inputs.model.display()))?;
    let bar = progress(inputs.photos.len());
    let photos = if joint {
        jointly(args.mask.as_deref(), &mesh, &ready, &inputs, &options, &bar)?
    } else {
        let mask = args.mask.as_deref();
        let photos = inputs.photos.iter().map(|path| one(path, mask, &mesh, &ready, &inputs, &options, &bar));
        photos.collect::<anyhow::Result<_>>()?
    };
    bar.finish_and_clear();

    for photo in &photos {
        output.write(&overlay_name(&photo.file), &photo.overlay)?;
    }
    let file = name(&args.inputs.model);
    let head = report::Head { command: &command(), options: &args.options(ready.signals()), model: &file, mesh: &mesh };
    output.write("report.html", report::html(&head, &photos).as_bytes())?;
    let cameras = CameraFile { photos: photos.iter().map(Registered::entry).collect(), ..CameraFile::default() };
    write_cameras(&output.path("cameras.json"), &cameras)?;
    let handed = handover::write_all(&args.inputs, &output, &cameras)?;

    if json {
        let mut object = object(args, &output, &mesh, &ready, &photos);
        object["formats"] = json!(handed);
        print(&format!("{object:#}"))?;
    } else {
        print(&summary(&photos, &output))?;
    }
    Ok(if photos.iter().all(Registered::is_good) { Ending::Good } else { Ending::Doubtful })
}

fn one(
    path: &Path,
    mask: Option<&Path>,
    mesh: &Mesh,
    model: &Model,
    inputs: &Inputs,
    options: &Options,
    bar: &ProgressBar,
) -> anyhow::Result<Registered> {
    let photo = masked(photo(path)?, mask)?;
    let start = inputs.start(&photo)?;
    bar.set_message(photo.file.clone());
    let before = bar.position();
    let mut first = None;
    let mut observer = |event: &Event| {
        first.get_or_insert(event.view);
        bar.set_position(before + PARTS * event.done as u64 / event.of.max(1) as u64);
        ControlFlow::Continue(())
    };
    let outcome = match &start {
        Some(start) => register(model, &photo, start, options, &mut observer),
        None => search(model, &photo, &inputs.camera(&photo)?, options, &mut observer),
    };
    bar.set_position(before + PARTS);
    let outcome = outcome.map_err(|error| anyhow!("{}: {error}", inputs.context(&photo)))?;
    // What was searched for starts at the best view that the search found.
    let start = start.or(first).unwrap_or(outcome.view);
    registered(mesh, &photo, start, outcome)
}

/// Registers all photos jointly.
fn jointly(
    mask: Option<&Path>,
    mesh: &Mesh,
    model: &Model,
    inputs: &Inputs,
    options: &Options,
    bar: &ProgressBar,
) -> anyhow::Result<Vec<Registered>> {
    let photos: Vec<Photo> =
        inputs.photos.iter().map(|path| masked(photo(path)?, mask)).collect::<anyhow::Result<_>>()?;
    let start = |photo: &Photo| match inputs.start(photo)? {
        Some(start) => Ok(start),
        None => search(model, photo, &inputs.camera(photo)?, options, &mut |_| ControlFlow::Continue(()))
            .map(|outcome| outcome.view)
            .map_err(|error| anyhow!("{}: {error}", inputs.context(photo))),
    };
    let starts: Vec<View> = photos.iter().map(start).collect::<anyhow::Result<_>>()?;
    let size = |photo: &Photo| (photo.width, photo.height);
    if let Some(other) = photos.iter().find(|photo| options.share_intrinsics && size(photo) != size(&photos[0])) {
        let [(w, h), (other_w, other_h)] = [size(&photos[0]), size(other)];
        bail!(
            "{}: {other_w} × {other_h} pixels, but {} has {w} × {h}; --share-intrinsics is for photos of one camera and one \
             size",
            other.file,
            photos[0].file
        );
    }
    let ready: Vec<Registration> = photos.iter().map(|photo| Registration::new(model, photo, options)).collect();
    let outcomes = register_jointly(&ready, &starts, options, &mut |event| {
        bar.set_position(bar.length().unwrap_or_default() * event.done as u64 / event.of.max(1) as u64);
        ControlFlow::Continue(())
    });
    let outcomes = outcomes.map_err(|(photo, error)| anyhow!("{}: {error}", inputs.context(&photos[photo])))?;
    let all = photos.iter().zip(starts).zip(outcomes);
    all.map(|((photo, start), outcome)| registered(mesh, photo, start, outcome)).collect()
}

/// What came of a photo, and its picture.
fn registered(mesh: &Mesh, photo: &Photo, start: View, outcome: Outcome) -> anyhow::Result<Registered> {
    let panels = [
        Panel { label: "start", view: &start, colour: [255, 168, 30] },
        Panel { label: word(outcome.status), view: &outcome.view, colour: colour(outcome.status) },
    ];
    let overlay = jpeg(&overlay(mesh, photo, &panels))?;
    let motion = motion(&start.pose, &outcome.view.pose, mesh.diagonal());
    Ok(Registered { file: photo.file.clone(), start, outcome, motion, overlay })
}

fn word(status: Status) -> &'static str {
    match status {
        Status::Registered => "registered",
        Status::Uncertain => "uncertain",
        Status::Failed => "failed",
    }
}

fn colour(status: Status) -> [u8; 3] {
    match status {
        Status::Registered => [40, 230, 160],
        Status::Uncertain => [250, 225, 60],
        Status::Failed => [255, 80, 80],
    }
}

fn stop(stop: Stop) -> &'static str {
    match stop {
        Stop::Converged => "converged",
        Stop::Stalled => "stalled",
        Stop::Exhausted => "iteration limit",
    }
}

/// Steps of the progress bar a photo.
pub(crate) const PARTS: u64 = 100;

/// A bar on standard error; where that is no terminal, nothing is drawn.
pub(crate) fn progress(photos: usize) -> ProgressBar {
    let bar = ProgressBar::new(PARTS * photos as u64);
    match ProgressStyle::with_template("{bar:40} {percent:>3} %  {msg}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// The command line as it could be typed again.
pub(crate) fn command() -> String {
    let plain = |c: char| c.is_alphanumeric() || "-_./=,+:@%".contains(c);
    let quote = |word: String| {
        if !word.is_empty() && word.chars().all(plain) { word } else { format!("'{}'", word.replace('\'', r"'\''")) }
    };
    let words = std::env::args_os().skip(1).map(|word| quote(word.to_string_lossy().into_owned()));
    ["texreg".to_owned()].into_iter().chain(words).collect::<Vec<_>>().join(" ")
}

/// How sure a view is; with it how sure its focal length, and how much that goes with the distance.
fn sureness(found: &Uncertainty) -> String {
    let focal = found.focal.map_or_else(String::new, |focal| {
        format!(", f ±{:.2} % ({:+.2} with distance)", focal.percent, focal.with_distance)
    });
    format!("±{:.2} px{focal}", found.pixels)
}

fn summary(photos: &[Registered], output: &Output) -> String {
    let header = ["photo", "verdict", "similarity", "rotated", "moved", "sure to", "evaluations", "ms", ""];
    let mut rows = vec![header.map(str::to_owned).to_vec()];
    for photo in photos {
        let (start, end) = photo.outcome.similarity;
        let milliseconds: f64 = photo.outcome.stages.iter().map(|stage| stage.milliseconds).sum();
        rows.push(vec![
            photo.file.clone(),
            photo.verdict().to_owned(),
            format!("{start:.4} → {end:.4}"),
            format!("{:.3}°", photo.motion.rotation_deg),
            format!("{:.3} %", photo.motion.distance_pct),
            photo.outcome.uncertainty.as_ref().map_or_else(String::new, sureness),
            photo.outcome.evaluations().to_string(),
            format!("{milliseconds:.0}"),
            photo.remarks().join("; "),
        ]);
    }
    let good = photos.iter().filter(|photo| photo.is_good()).count();
    format!("{}{good} of {} registered; see {}", table(&rows), photos.len(), output.path("report.html").display())
}

/// The result for programs: the entries of `cameras.json`, and how they came about.
fn object(args: &Register, output: &Output, mesh: &Mesh, model: &Model, photos: &[Registered]) -> Value {
    let stage = |stage: &Stage| {
        json!({
            "name": stage.name,
            "evaluations": stage.evaluations,
            "renderings": stage.renderings,
            "similarity": {"start": stage.similarity.0, "end": stage.similarity.1},
            "milliseconds": stage.milliseconds,
        })
    };
    let photo = |photo: &Registered| {
        let mut object = photo.entry().keys();
        object.insert("rotated_deg".into(), json!(photo.motion.rotation_deg));
        object.insert("moved_pct".into(), json!(photo.motion.distance_pct));
        object.insert("evaluations".into(), json!(photo.outcome.evaluations()));
        object.insert("stop".into(), json!(stop(photo.outcome.stop)));
        object.insert("stages".into(), photo.outcome.stages.iter().map(stage).collect());
        Value::Object(object)
    };
    json!({
        "model": {
            "file": args.inputs.model.display().to_string(),
            "vertices": mesh.positions.len(),
            "triangles": mesh.triangles.len(),
            "diagonal": mesh.diagonal(),
        },
        "options": args.options(model.signals()).into_iter().map(|(name, value)| (name.to_owned(), json!(value))).collect::<Map<_, _>>(),
        "cameras": output.path("cameras.json").display().to_string(),
        "report": output.path("report.html").display().to_string(),
        "photos": photos.iter().map(photo).collect::<Vec<_>>(),
    })
}
