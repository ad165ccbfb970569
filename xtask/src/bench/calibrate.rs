//! Calibrations from checkerboards beside OpenCV, Bouguet's published camera and the truth of a rendered board.
//!
//! OpenCV is run live, by `calibrate_peer.py`, on the same photos: `findChessboardCorners` with `cornerSubPix` (half
//! window 5, which suits it best here) and `calibrateCamera` with five coefficients. Ours and theirs take turns, and the
//! least of the runs counts; how many boards the newer `findChessboardCornersSB` finds is told beside. Reading files is
//! not timed.

use super::{Arguments, Report, Row};
use anyhow::{Context, Result, bail, ensure};
use nalgebra::{Point2, Point3, Vector2};
use serde_json::Value;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;
use texreg::calib::{Board, BoardCorner, Calibration, Image, Model, Options, calibrate, detect};
use texreg::camera::{Camera, Distortion, Intrinsics};
use texreg::driver::Photo;

/// A folder of photos of one board.
struct Set {
    name: &'static str,
    folder: &'static str,
    /// What the photos' names start with.
    prefix: &'static str,
    board: Board,
}

const SETS: [Set; 4] = [
    Set {
        name: "opencv left",
        folder: "real/calib_opencv",
        prefix: "left",
        board: Board { columns: 9, rows: 6, square: 1.0 },
    },
    Set {
        name: "opencv right",
        folder: "real/calib_opencv",
        prefix: "right",
        board: Board { columns: 9, rows: 6, square: 1.0 },
    },
    Set {
        name: "bouguet",
        folder: "real/calib_bouguet",
        prefix: "Image",
        board: Board { columns: 12, rows: 13, square: 1.0 },
    },
    Set {
        name: "lion board",
        folder: "lion_board",
        prefix: "photo",
        board: Board { columns: 9, rows: 6, square: 1.0 },
    },
];

/// The lens model of OpenCV's five coefficients.
const FIVE: Options = Options { model: Some(Model::Brown5), leave_out: false };

/// Runs the benchmark.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let Some(cases) = &arguments.cases else {
        bail!("the photos of boards are not in the repository; give --cases DIR")
    };
    let mut rows = Vec::new();
    let mut notes = Vec::new();
    let rounds = if arguments.quick { 3 } else { 15 };
    for set in &SETS {
        let folder = cases.join(set.folder);
        if !folder.is_dir() {
            notes.push(format!("missing: {}", folder.display()));
            continue;
        }
        measure(set, &folder, arguments, rounds, &mut rows, &mut notes)
            .with_context(|| format!("the set {}", set.name))?;
    }
    let mut report = Report::new("calibrate", rows);
    notes.dedup();
    report.notes = notes;
    Ok(report)
}

fn measure(
    set: &Set,
    folder: &Path,
    arguments: &Arguments,
    rounds: usize,
    rows: &mut Vec<Row>,
    notes: &mut Vec<String>,
) -> Result<()> {
    let files = files(folder, set.prefix)?;
    let photos: Vec<Photo> = files.iter().map(Photo::load).collect::<Result<_, _>>()?;
    let size = [photos[0].width, photos[0].height];
    let name = |what: &str| format!("{}: {what}", set.name);
    let mut peer = match Peer::start(arguments, set, &files) {
        Ok(peer) => Some(peer),
        Err(error) => {
            notes.push(format!("missing: OpenCV ({error:#})"));
            None
        }
    };

    let mut found: Vec<Option<Vec<BoardCorner>>> = Vec::new();
    let (mut ours, mut theirs) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..rounds {
        let start = Instant::now();
        found = photos.iter().map(|photo| look(photo, &set.board)).collect();
        ours = ours.min(start.elapsed().as_secs_f64() * 1e3);
        if let Some(peer) = &mut peer {
            theirs = theirs.min(number(&peer.ask("detect")?["ms"]));
        }
    }
    let count = photos.len() as f64;
    let whole = found.iter().flatten().filter(|corners| corners.len() == set.board.corners()).count();
    let corners: Vec<Vec<BoardCorner>> = found.into_iter().flatten().collect();
    let missed = photos.len() - whole;
    let own = calibrate(&corners, &set.board, size, &FIVE)?;

    let Some(peer) = &mut peer else {
        rows.push(Row::alone(name("whole boards missed"), missed as f64, ""));
        rows.push(Row::alone(name("detection, a photo"), ours / count, "ms"));
        rows.push(Row::alone(name("rms, 5 coefficients"), own.rms, "px"));
        return truths(set, folder, &photos, &corners, None, rows);
    };
    let seen = peer.ask("corners")?;
    let boards: Vec<Vec<BoardCorner>> = list(&seen["boards"]).iter().filter_map(|b| board(b, &set.board)).collect();
    let sector_based = seen["sector_based"].as_u64().unwrap_or(0) as usize;
    let least = photos.len() - boards.len().max(sector_based);
    rows.push(Row::alone(name("whole boards missed"), missed as f64, "").goal(least as f64));
    notes.push(format!(
        "{}: {whole} of {} boards found whole; OpenCV {} and, sector based, {sector_based}",
        set.name,
        photos.len(),
        boards.len()
    ));
    let opencv = || "OpenCV".to_owned();
    rows.push(Row::beside(name("detection, a photo"), ours / count, theirs / count, opencv(), "ms").goal(1.0));

    let (mut ours, mut theirs) = (f64::INFINITY, f64::INFINITY);
    let mut answer = Value::Null;
    let mut same = calibrate(&boards, &set.board, size, &FIVE)?;
    for _ in 0..rounds {
        let start = Instant::now();
        same = calibrate(&boards, &set.board, size, &FIVE)?;
        ours = ours.min(start.elapsed().as_secs_f64() * 1e3);
        answer = peer.ask("calibrate")?;
        theirs = theirs.min(number(&answer["ms"]));
    }
    rows.push(Row::beside(name("calibration, its corners"), ours, theirs, opencv(), "ms").goal(1.0));
    let rms = number(&answer["rms"]);
    rows.push(Row::beside(name("rms, its corners"), same.rms, rms, opencv(), "px").goal(1.000_001));
    rows.push(Row::beside(name("rms, own corners"), own.rms, rms, opencv(), "px").goal(1.0));
    let values: Vec<f64> = list(&answer["values"]).iter().map(number).collect();
    let deviations: Vec<f64> = list(&answer["deviations"]).iter().map(number).collect();
    let peer = |i: usize| (values[i], deviations[i]);
    rows.push(Row::alone(name("off OpenCV, its corners"), off(&same, peer), "σ").goal(1.0));
    rows.push(Row::alone(name("off OpenCV, own corners"), off(&own, peer), "σ").goal(1.0));
    truths(set, folder, &photos, &corners, Some(&boards), rows)
}

/// The corners in a photo.
fn look(photo: &Photo, board: &Board) -> Option<Vec<BoardCorner>> {
    let image = Image::new(photo.width as usize, photo.height as usize, &photo.luma)?;
    Some(detect(&image, board)?.corners)
}

/// The largest distance of a parameter from another calibration's, in that one's standard deviations; `other` takes the
/// place of a parameter in fx, fy, cx, cy, k1, k2, p1, p2, k3.
fn off(calibration: &Calibration, other: impl Fn(usize) -> (f64, f64)) -> f64 {
    let values = [calibration.camera.intrinsics.to_array(), calibration.camera.distortion.to_array()].concat();
    let distances = calibration.model.parameters().iter().enumerate().map(|(i, parameter)| {
        let (value, deviation) = other(i);
        (values[*parameter] - value).abs() / deviation
    });
    distances.fold(0.0, f64::max)
}

/// What can be said against published cameras and true ones; `boards` are OpenCV's corners.
fn truths(
    set: &Set,
    folder: &Path,
    photos: &[Photo],
    corners: &[Vec<BoardCorner>],
    boards: Option<&[Vec<BoardCorner>]>,
    rows: &mut Vec<Row>,
) -> Result<()> {
    let size = [photos[0].width, photos[0].height];
    let name = |what: &str| format!("{}: {what}", set.name);
    let published = folder.join("Calib_Results.m");
    if published.is_file() {
        let text = std::fs::read_to_string(&published)?;
        let numbers = |key: &str| -> Result<Vec<f64>> {
            let line = text
                .lines()
                .find_map(|l| l.strip_prefix(key)?.trim_start().strip_prefix('='))
                .context(key.to_owned())?;
            let inside = line.trim().trim_start_matches('[').split(']').next().unwrap_or_default();
            inside.split(';').map(|x| Ok(x.trim().parse()?)).collect()
        };
        let values = [numbers("fc ")?, numbers("cc ")?, numbers("kc ")?].concat();
        let uncertainties = [numbers("fc_error")?, numbers("cc_error")?, numbers("kc_error")?].concat();
        let options = Options { model: Some(Model::Brown4), leave_out: false };
        let found = calibrate(corners, &set.board, size, &options)?;
        // Bouguet's uncertainties are three standard deviations.
        let bouguet = |i: usize| (values[i], uncertainties[i] / 3.0);
        let his_corners = published_corners(folder, photos, &set.board)?;
        let his = calibrate(&his_corners, &set.board, size, &options)?;
        rows.push(Row::alone(name("off Bouguet, his corners"), off(&his, bouguet), "σ").goal(1.0));
        rows.push(Row::beside(name("rms, 4 coefficients"), found.rms, his.rms, "Bouguet's corners", "px").goal(1.0));
        if corners.len() == photos.len() {
            let (ours, theirs) = (edges_astray(photos, corners), edges_astray(photos, &his_corners));
            let name = name("edges off the lines between corners, rms");
            rows.push(Row::beside(name, ours, theirs, "Bouguet's corners", "px").goal(1.0));
        }
        rows.push(Row::alone(name("off Bouguet, own corners"), off(&found, bouguet), "σ").goal(1.0));
        let (mut worst, mut parameter) = (0.0, 0);
        for i in 0..8 {
            let value = [found.camera.intrinsics.to_array(), found.camera.distortion.to_array()].concat()
                [Model::Brown4.parameters()[i]];
            let off = (value - values[i]).abs() / uncertainties[i];
            if off > worst {
                (worst, parameter) = (off, i);
            }
        }
        let which = ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"][parameter];
        rows.push(Row::alone(name(&format!("the same in his uncertainties, worst {which}")), worst, "3σ"));
    }
    let truth = folder.join("truth.json");
    if truth.is_file() {
        let json: Value = serde_json::from_slice(&std::fs::read(&truth)?)?;
        let photo = &json["photos"][0];
        let k = |key: &str| number(&photo["K"][key]);
        let c: Vec<f64> = list(&photo["distortion"]).iter().map(number).collect();
        ensure!(c.len() == 5, "{}: five coefficients are needed", truth.display());
        let truth = Camera {
            width: size[0],
            height: size[1],
            intrinsics: Intrinsics { fx: k("fx"), fy: k("fy"), cx: k("cx"), cy: k("cy"), skew: k("skew") },
            distortion: Distortion { k1: c[0], k2: c[1], p1: c[2], p2: c[3], k3: c[4] },
        };
        let found = calibrate(corners, &set.board, size, &Options::default())?;
        let (ours, true_k) = (found.camera.intrinsics, truth.intrinsics);
        let focal = (ours.fx / true_k.fx - 1.0).abs().max((ours.fy / true_k.fy - 1.0).abs());
        let principal = (ours.cx - true_k.cx).hypot(ours.cy - true_k.cy);
        rows.push(Row::alone(name("focal length off the truth"), 100.0 * focal, "%").goal(0.1));
        rows.push(Row::alone(name("principal point off the truth"), principal, "px").goal(1.0));
        let lens = Camera { intrinsics: true_k, ..found.camera };
        rows.push(Row::alone(name("distortion off the truth, at most"), farthest(&truth, &lens), "px").goal(0.3));
        let astray = |corners| astray(&json, &truth, corners);
        let name = name("corners off the truth, rms");
        rows.push(match boards {
            Some(boards) => Row::beside(name, astray(corners)?, astray(boards)?, "OpenCV", "px").goal(1.0),
            None => Row::alone(name, astray(corners)?, "px"),
        });
    }
    Ok(())
}

/// How far the edges of the squares lie from the lines between neighbouring corners: what tells good corners without a truth. An
/// edge is where the brightness halves between the two corners; where light squares look wide it is off to one side, and the next
/// edge of the same line to the other, so the mean of two counts. The root mean square, in pixels.
fn edges_astray(photos: &[Photo], boards: &[Vec<BoardCorner>]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (photo, corners) in photos.iter().zip(boards) {
        let at = |column, row| corners.iter().find(|c| (c.column, c.row) == (column, row)).map(|c| c.pixel);
        for corner in corners {
            for (dx, dy) in [(1, 0), (0, 1)] {
                let next = |k: usize| at(corner.column + k * dx, corner.row + k * dy);
                let (Some(b), Some(c)) = (next(1), next(2)) else { continue };
                if let (Some(one), Some(other)) = (edge(photo, &corner.pixel, &b), edge(photo, &b, &c)) {
                    sum += (0.5 * (one + other)).powi(2);
                    count += 1.0;
                }
            }
        }
    }
    f64::sqrt(sum / count)
}

/// How far to the left of the line from `a` to `b` the edge lies there, from a profile over the middle third of it.
fn edge(photo: &Photo, a: &Point2<f64>, b: &Point2<f64>) -> Option<f64> {
    const REACH: f64 = 4.0;
    const STEPS: usize = 32;
    let along = b - a;
    if along.norm() < 4.0 * REACH {
        return None;
    }
    let normal = Vector2::new(-along.y, along.x).normalize();
    let value = |p: Point2<f64>| -> Option<f64> {
        let (x, y) = (p.x.floor(), p.y.floor());
        let (width, inside) = (photo.width as usize, x >= 0.0 && y >= 0.0);
        let (column, row) = (x as usize, y as usize);
        if !inside || column + 1 >= width || row + 1 >= photo.height as usize {
            return None;
        }
        let at = |dx: usize, dy: usize| f64::from(photo.luma[(row + dy) * width + column + dx]);
        let (u, v) = (p.x - x, p.y - y);
        Some((1.0 - v) * ((1.0 - u) * at(0, 0) + u * at(1, 0)) + v * ((1.0 - u) * at(0, 1) + u * at(1, 1)))
    };
    let offset = |i: usize| REACH * (2.0 * i as f64 / STEPS as f64 - 1.0);
    let mean = |i: usize| -> Option<f64> {
        let places = (0..7).map(|k| a + along * (0.35 + 0.05 * f64::from(k)) + normal * offset(i));
        places.map(value).sum::<Option<f64>>().map(|sum| sum / 7.0)
    };
    let profile: Vec<f64> = (0..=STEPS).map(mean).collect::<Option<_>>()?;
    let end = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    let (low, high) = (end(&profile[..5]), end(&profile[STEPS - 4..]));
    if (high - low).abs() < 0.15 {
        return None;
    }
    let share = |i: usize| (profile[i] - low) / (high - low) - 0.5;
    let crossings = (0..STEPS).filter(|&i| share(i) < 0.0 && share(i + 1) >= 0.0);
    let places = crossings.map(|i| offset(i) + (offset(i + 1) - offset(i)) * share(i) / (share(i) - share(i + 1)));
    places.min_by(|a, b| a.abs().total_cmp(&b.abs()))
}

/// The corners that Bouguet's toolbox extracted, from `correspondences.json`: of each photo points of the board, in multiples
/// of its squares, and pixels.
fn published_corners(folder: &Path, photos: &[Photo], board: &Board) -> Result<Vec<Vec<BoardCorner>>> {
    let json: Value = serde_json::from_slice(&std::fs::read(folder.join("correspondences.json"))?)?;
    let points = |view: &Value, key: &str| list(&view[key]).iter().map(list).map(<[Value]>::to_vec).collect::<Vec<_>>();
    let views = photos.iter().map(|photo| {
        let view = list(&json["views"]).iter().find(|view| view["image"] == *photo.file);
        let view = view.with_context(|| format!("no corners of {}", photo.file))?;
        let (places, pixels) = (points(view, "points_3d_mm"), points(view, "points_2d"));
        ensure!(places.len() == board.corners() && pixels.len() == places.len(), "a view lacks corners");
        let step = places.iter().flatten().map(number).filter(|x| *x > 0.0).fold(f64::INFINITY, f64::min);
        let corner = |(place, pixel): (&Vec<Value>, &Vec<Value>)| BoardCorner {
            column: (number(&place[0]) / step).round() as usize,
            row: (number(&place[1]) / step).round() as usize,
            pixel: Point2::new(number(&pixel[0]), number(&pixel[1])),
        };
        Ok(places.iter().zip(&pixels).map(corner).collect())
    });
    views.collect()
}

/// The largest distance, over the image, at which two cameras show what one of them sees in a pixel.
fn farthest(truth: &Camera, found: &Camera) -> f64 {
    let steps = 24u32;
    let grid = (0..=steps).flat_map(|i| (0..=steps).map(move |j| (i, j)));
    let distances = grid.filter_map(|(i, j)| {
        let share = |i: u32, size: u32| f64::from(i) / f64::from(steps) * f64::from(size) - 0.5;
        let pixel = Point2::new(share(i, truth.width), share(j, truth.height));
        let ray = truth.unproject(&pixel)?;
        Some((found.project(&Point3::from(ray))? - pixel).norm())
    });
    distances.fold(0.0, f64::max)
}

/// The root mean square of the corners' distances from the nearest places where the true camera shows any; each board is
/// compared with the photo that it fits best.
fn astray(json: &Value, truth: &Camera, boards: &[Vec<BoardCorner>]) -> Result<f64> {
    let shown = |photo: &Value| -> Result<Vec<Point2<f64>>> {
        let place = |point: &Value| {
            let row = |i: usize| {
                (0..3).map(|j| number(&photo["R"][i][j]) * number(&point[j])).sum::<f64>() + number(&photo["T"][i])
            };
            truth.project(&Point3::new(row(0), row(1), row(2))).context("a corner behind the camera")
        };
        list(&photo["visible_points"]).iter().map(place).collect()
    };
    let photos: Vec<_> = list(&json["photos"]).iter().map(shown).collect::<Result<_>>()?;
    let nearest = |corner: &BoardCorner, places: &[Point2<f64>]| {
        places.iter().map(|place| (place - corner.pixel).norm_squared()).fold(f64::INFINITY, f64::min)
    };
    let sum_over = |corners: &[BoardCorner], places: &[Point2<f64>]| -> f64 {
        corners.iter().map(|corner| nearest(corner, places)).sum()
    };
    let best = |corners: &Vec<BoardCorner>| {
        photos.iter().map(|places| sum_over(corners, places)).fold(f64::INFINITY, f64::min)
    };
    let count: usize = boards.iter().map(Vec::len).sum();
    Ok((boards.iter().map(best).sum::<f64>() / count as f64).sqrt())
}

/// A peer's board, a list of [u, v] row by row.
fn board(value: &Value, board: &Board) -> Option<Vec<BoardCorner>> {
    let corners = value.as_array()?.iter().enumerate();
    let corner = |(i, uv): (usize, &Value)| BoardCorner {
        column: i % board.columns,
        row: i / board.columns,
        pixel: Point2::new(number(&uv[0]), number(&uv[1])),
    };
    Some(corners.map(corner).collect())
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// The photos of a folder whose names start with a prefix, sorted.
fn files(folder: &Path, prefix: &str) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let is_photo = path.extension().is_some_and(|e| e == "jpg" || e == "tif");
        if is_photo && path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(prefix)) {
            files.push(path);
        }
    }
    files.sort();
    ensure!(!files.is_empty(), "{}: no photos", folder.display());
    Ok(files)
}

/// OpenCV in a process of its own.
struct Peer {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Peer {
    fn start(arguments: &Arguments, set: &Set, files: &[PathBuf]) -> Result<Self> {
        let python = arguments.peers.as_ref().map(|p| p.join("venv/bin/python")).filter(|p| p.exists());
        let python = python.unwrap_or_else(|| PathBuf::from("python3"));
        let mut process = Command::new(&python)
            .args(["-c", include_str!("calibrate_peer.py")])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .with_context(|| python.display().to_string())?;
        let input = process.stdin.take().context("no input")?;
        let output = BufReader::new(process.stdout.take().context("no output")?);
        let mut peer = Self { process, input, output };
        let files: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
        let answer = peer.ask(&format!("load\t{}\t{}\t{}", set.board.columns, set.board.rows, files.join("\t")))?;
        ensure!(answer["images"] == files.len(), "it cannot read all photos");
        Ok(peer)
    }

    /// Asks for one thing.
    fn ask(&mut self, words: &str) -> Result<Value> {
        writeln!(self.input, "{words}").and_then(|()| self.input.flush()).context("cv2 cannot be imported?")?;
        let mut line = String::new();
        ensure!(self.output.read_line(&mut line)? > 0, "it ended early; can cv2 be imported?");
        Ok(serde_json::from_str(&line)?)
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended by itself, which is as good.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
