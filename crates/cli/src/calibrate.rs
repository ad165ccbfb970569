//! `texreg calibrate`: from photos of a checkerboard to a camera and a report.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use image::imageops::{self, FilterType};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use texreg::calib::{
    Board, BoardCorner, Calibration, Error, Image, Options, PARAMETER_NAMES, PhotoFit, Sighting, Weakness, calibrate,
    detect, other_size, weaknesses,
};
use texreg::formats::{Format, Lens, write_lens};

use crate::args::Calibrate;
use crate::calibration_report as report;
use crate::inputs::photo;
use crate::output::{Output, jpeg, print, table};
use crate::register::command;
use crate::{Ending, corners};

/// The longer side of pictures in the report, pixels.
const THUMBNAIL: u32 = 560;

/// A photo that was looked at.
pub(crate) struct Looked {
    /// Its file name.
    pub(crate) file: String,
    /// Its width and height.
    pub(crate) size: [u32; 2],
    /// What it shows of the board.
    pub(crate) sighting: Option<Sighting>,
    /// The photo with the corners drawn, as a small JPEG file.
    pub(crate) thumbnail: Vec<u8>,
}

impl Looked {
    fn corners(&self) -> usize {
        self.sighting.as_ref().map_or(0, |sighting| sighting.corners.len())
    }
}

/// What a photo came to.
pub(crate) struct Entry<'a> {
    /// The photo.
    pub(crate) looked: &'a Looked,
    /// Its fit, if it shows a board.
    pub(crate) fit: Option<&'a PhotoFit>,
}

impl Entry<'_> {
    /// In one word or two.
    pub(crate) fn verdict(&self) -> &'static str {
        match self.fit {
            None => "no board",
            Some(fit) if fit.is_outlier => "left out",
            Some(_) => "used",
        }
    }
}

/// Everything the result says.
pub(crate) struct Result<'a> {
    /// The board.
    pub(crate) board: Board,
    /// The camera.
    pub(crate) calibration: &'a Calibration,
    /// The photos, in the order given.
    pub(crate) entries: Vec<Entry<'a>>,
    /// What is poorly determined.
    pub(crate) weaknesses: Vec<Weakness>,
    /// The corners of the photos that show a board.
    pub(crate) corners: &'a [Vec<BoardCorner>],
}

pub(crate) fn run(args: &Calibrate, json: bool) -> anyhow::Result<Ending> {
    let (columns, rows) = args.board;
    let board = Board { columns, rows, square: args.square };
    let folder = args.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = args
        .output
        .file_name()
        .and_then(OsStr::to_str)
        .ok_or_else(|| anyhow!("{}: not the name of a file; give one with -o FILE", args.output.display()))?;
    let output = Output::open(folder)?;
    let debug = args.debug.as_deref().map(Output::open).transpose()?;

    let looked = args.images.par_iter().map(|path| look(path, &board, debug.as_ref()));
    let looked: Vec<Looked> = looked.collect::<anyhow::Result<_>>()?;
    let size = one_size(&args.images, &looked)?;
    let sightings: Vec<Option<Sighting>> = looked.iter().map(|l| l.sighting.clone()).collect();
    if let Some((columns, rows)) = other_size(&sightings, &board) {
        bail!(
            "the photos show a board of {columns}x{rows} inner corners, not {}x{}; give --board {columns}x{rows}",
            board.columns,
            board.rows
        );
    }
    let shown: Vec<&Looked> = looked.iter().filter(|l| l.sighting.is_some()).collect();
    if shown.is_empty() {
        bail!(
            "{}: no photo shows a board of {}x{} inner corners ({} looked at); check --board, which counts inner corners, \
             not squares, and that the board is sharp and lit",
            args.images[0].display(),
            board.columns,
            board.rows,
            looked.len()
        );
    }
    let corners: Vec<Vec<BoardCorner>> = sightings.into_iter().flatten().map(|s| s.corners).collect();
    let options = Options { model: args.model.0, leave_out: !args.keep_all };
    let calibration = calibrate(&corners, &board, size, &options).map_err(|error| refused(&error, &shown, &looked))?;
    let mut fits = calibration.photos.iter();
    let entries = looked.iter().map(|looked| Entry { looked, fit: looked.sighting.as_ref().and_then(|_| fits.next()) });
    let result = Result {
        board,
        calibration: &calibration,
        entries: entries.collect(),
        weaknesses: weaknesses(&calibration, &corners),
        corners: &corners,
    };

    let shown_report = args.output.with_extension("html");
    let report = Path::new(file).with_extension("html").to_string_lossy().into_owned();
    output.write(&report, report::html(&command(), &result).as_bytes())?;
    if Format::of(&args.output) == Some(Format::OpenCv) {
        write_lens(&args.output, &Lens::from(&calibration.camera), Format::OpenCv)?;
    } else {
        output.write(file, text(&object(&result)).as_bytes())?;
    }
    if json {
        let mut object = object(&result);
        object.insert("camera".into(), json!(args.output.display().to_string()));
        object.insert("report".into(), json!(shown_report.display().to_string()));
        print(&format!("{:#}", Value::Object(object)))?;
    } else {
        print(&summary(&result, &shown_report))?;
    }
    let good = result.entries.iter().all(|entry| entry.fit.is_some_and(|fit| !fit.is_outlier));
    Ok(if good { Ending::Good } else { Ending::Doubtful })
}

/// Looks for the board in a photo, and draws what was found.
fn look(path: &Path, board: &Board, debug: Option<&Output>) -> anyhow::Result<Looked> {
    let photo = photo(path)?;
    let image = Image::new(photo.width as usize, photo.height as usize, &photo.luma);
    let sighting = image.and_then(|image| detect(&image, board));
    let picture = corners::picture(&photo, sighting.as_ref().map_or(&[], |s| &s.corners));
    if let Some(debug) = debug {
        // Written at once: they are needed most when the calibration fails.
        debug.write(&format!("{}.jpg", photo.file), &jpeg(&picture)?)?;
    }
    let factor = (f64::from(THUMBNAIL) / f64::from(photo.width.max(photo.height))).min(1.0);
    let side = |n: u32| ((f64::from(n) * factor).round() as u32).max(1);
    let small = imageops::resize(&picture, side(photo.width), side(photo.height), FilterType::Triangle);
    Ok(Looked { file: photo.file, size: [photo.width, photo.height], sighting, thumbnail: jpeg(&small)? })
}

/// The size all photos have.
fn one_size(paths: &[PathBuf], looked: &[Looked]) -> anyhow::Result<[u32; 2]> {
    let size = looked[0].size;
    match looked.iter().zip(paths).find(|(other, _)| other.size != size) {
        Some((other, path)) => bail!(
            "{}: has {} × {} pixels, but {} has {} × {}; calibrate with photos of one camera, held one way, at one size",
            path.display(),
            other.size[0],
            other.size[1],
            looked[0].file,
            size[0],
            size[1]
        ),
        None => Ok(size),
    }
}

/// The error, with the photos it is about.
fn refused(error: &Error, shown: &[&Looked], looked: &[Looked]) -> anyhow::Error {
    match error {
        Error::Degenerate { photo } => {
            let file = &shown[*photo].file;
            anyhow!("{file}: the corners found span no plane; leave it out, or see with --debug DIR what was found")
        }
        Error::TooFew { .. } => {
            let without: Vec<&str> = looked.iter().filter(|l| l.sighting.is_none()).map(|l| l.file.as_str()).collect();
            let none = if without.is_empty() { String::new() } else { format!("; no board in {}", without.join(", ")) };
            anyhow!("{error}{none}")
        }
        _ => anyhow!("{error}"),
    }
}

/// What `camera.json` says.
fn object(result: &Result<'_>) -> Map<String, Value> {
    let Calibration { camera, model, deviations, rms, sigma, .. } = result.calibration;
    let k = &camera.intrinsics;
    let deviation = |i: &usize| (PARAMETER_NAMES[*i].to_owned(), json!(deviations[*i]));
    let board = |entry: &Entry<'_>| {
        let mut object = Map::new();
        object.insert("file".into(), json!(entry.looked.file));
        object.insert("status".into(), json!(entry.verdict()));
        if let Some(fit) = entry.fit {
            let rows: [[f64; 3]; 3] = fit.pose.rotation.matrix().transpose().into();
            object.insert("corners".into(), json!(entry.looked.corners()));
            object.insert("rms_px".into(), json!(fit.rms));
            object.insert("R".into(), json!(rows));
            object.insert("T".into(), json!(<[f64; 3]>::from(fit.pose.translation)));
        }
        Value::Object(object)
    };
    let fields = [
        ("width", json!(camera.width)),
        ("height", json!(camera.height)),
        ("K", json!({"fx": k.fx, "fy": k.fy, "cx": k.cx, "cy": k.cy, "skew": k.skew})),
        ("distortion", json!(camera.distortion.to_array())),
        ("model", json!(model.name())),
        ("deviations", model.parameters().iter().map(deviation).collect::<Map<_, _>>().into()),
        ("rms_px", json!(rms)),
        ("sigma_px", json!(sigma)),
        ("weaknesses", result.weaknesses.iter().map(ToString::to_string).collect()),
        ("boards", result.entries.iter().map(board).collect()),
    ];
    fields.into_iter().map(|(key, value)| (key.to_owned(), value)).collect()
}

/// The object as a file, one key a line.
fn text(object: &Map<String, Value>) -> String {
    let lines: Vec<String> = object
        .iter()
        .map(|(key, value)| match value.as_array().filter(|list| list.iter().any(|v| !v.is_number())) {
            Some(list) => {
                let items: Vec<String> = list.iter().map(|item| format!("\n  {item}")).collect();
                format!(" {}: [{}\n ]", json!(key), items.join(","))
            }
            None => format!(" {}: {value}", json!(key)),
        })
        .collect();
    format!("{{\n{}\n}}\n", lines.join(",\n"))
}

/// A parameter's name, its value and its deviation, as text.
pub(crate) fn parameters(calibration: &Calibration) -> Vec<[String; 3]> {
    let values = [calibration.camera.intrinsics.to_array(), calibration.camera.distortion.to_array()].concat();
    let row = |&i: &usize| {
        let places = if i < 4 { 3 } else { 6 };
        let number = |x: f64| format!("{x:.places$}");
        [PARAMETER_NAMES[i].to_owned(), number(values[i]), number(calibration.deviations[i])]
    };
    calibration.model.parameters().iter().map(row).collect()
}

fn summary(result: &Result<'_>, report: &Path) -> String {
    let mut rows = vec![["photo", "corners", "rms px", ""].map(str::to_owned).to_vec()];
    rows.extend(result.entries.iter().map(|entry| {
        let rms = entry.fit.map_or_else(String::new, |fit| format!("{:.3}", fit.rms));
        let verdict = if entry.verdict() == "used" { "" } else { entry.verdict() };
        vec![entry.looked.file.clone(), entry.looked.corners().to_string(), rms, verdict.to_owned()]
    }));
    let mut text = table(&rows);
    let rows = parameters(result.calibration).into_iter();
    let rows: Vec<Vec<String>> =
        rows.map(|[name, value, deviation]| vec![name, value, format!("± {deviation}")]).collect();
    text += &format!("\n{}", table(&rows));
    for weakness in &result.weaknesses {
        text += &format!("note: {weakness}\n");
    }
    let Calibration { rms, model, .. } = result.calibration;
    let used = result.entries.iter().filter(|entry| entry.verdict() == "used").count();
    format!("{text}{model}, rms {rms:.3} px over {used} of {} photos; see {}", result.entries.len(), report.display())
}
