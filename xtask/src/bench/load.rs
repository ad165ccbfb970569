//! Loading: models beside a plain read of the same file, in the same run and in turns, with their peak memory; and the
//! decoding of a photo.
//!
//! The models are graphs over a grid, written here: 10 million triangles as binary PLY (2 million with `--quick`), and
//! smaller ones as text. Files are read once before, so that none waits for the disk.

use super::{Arguments, Report, Row};
use anyhow::{Context, Result};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;
use texreg::driver::Photo;
use texreg::surface::load;

/// What is written of a model.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    /// Binary PLY of positions and faces.
    Plain,
    /// Binary PLY with normals, reflectance and colours.
    Attributes,
    /// Binary PLY of double-precision survey coordinates.
    Survey,
    /// Text PLY of positions and faces.
    Text,
    /// OBJ.
    Obj,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    if let Some(path) = std::env::var_os(PEAK_OF) {
        print_peak(Path::new(&path))?;
        std::process::exit(0);
    }
    let folder = tempfile::tempdir().context("no temporary folder")?;
    let large = if arguments.quick { 1_000 } else { 2_236 };
    let small = if arguments.quick { 300 } else { 708 };
    let mut rows = Vec::new();
    let mut notes = Vec::new();
    for (name, form, side) in [
        ("binary PLY", Form::Plain, large),
        ("binary PLY with normals, reflectance, colours", Form::Attributes, large),
        ("binary PLY, survey coordinates in f64", Form::Survey, large),
        ("text PLY", Form::Text, small),
        ("OBJ", Form::Obj, small),
    ] {
        let path = folder.path().join(if form == Form::Obj { "model.obj" } else { "model.ply" });
        write(&path, form, side).with_context(|| path.display().to_string())?;
        let megabytes = std::fs::metadata(&path)?.len() as f64 / 1e6;
        let triangles = 2.0 * ((side - 1) * (side - 1)) as f64 / 1e6;
        let (ours, peer) = in_turns(&path, if arguments.quick { 5 } else { 9 })?;
        let name = format!("{name}, {triangles:.1} M triangles, {megabytes:.0} MB");
        for (kind, of) in [("best", best as fn(&[f64]) -> f64), ("median", median)] {
            rows.push(Row::beside(format!("{name}: {kind}"), of(&ours), of(&peer), "plain read", "ms"));
        }
        notes.push(format!(
            "{name}: {:.0} MB/s, plain read {:.0} MB/s",
            1e3 * megabytes / best(&ours),
            1e3 * megabytes / best(&peer)
        ));
        if let Some(peak) = peak_memory(&path)? {
            let row = Row::beside(format!("{name}: peak memory"), peak, megabytes, "file", "MB");
            rows.push(if matches!(form, Form::Text | Form::Obj) { row } else { row.goal(2.0) });
        }
    }
    if !Path::new("/proc/self/status").exists() {
        notes.push("this system does not tell the peak memory of a process".into());
    }
    let photo = photo(arguments);
    let mut times = Vec::new();
    for _ in 0..9 {
        let start = Instant::now();
        let loaded = Photo::load(&photo)?;
        times.push(milliseconds(start));
        std::hint::black_box(loaded);
    }
    rows.push(Row::alone(format!("photo {}: best", photo.display()), best(&times), "ms"));
    rows.push(Row::alone(format!("photo {}: median", photo.display()), median(&times), "ms"));
    Ok(Report { notes, ..Report::new("load", rows) })
}

/// Times our loading and a plain read of a file, one after the other again and again.
fn in_turns(path: &Path, rounds: usize) -> Result<(Vec<f64>, Vec<f64>)> {
    std::hint::black_box(std::fs::read(path)?);
    let (mut ours, mut peer) = (Vec::new(), Vec::new());
    for _ in 0..rounds {
        let start = Instant::now();
        let bytes = std::fs::read(path)?;
        peer.push(milliseconds(start));
        drop(bytes);
        let start = Instant::now();
        let mesh = load(path)?;
        ours.push(milliseconds(start));
        drop(mesh);
    }
    Ok((ours, peer))
}

/// Set to a file for a process that shall do no more than load it and tell its own peak memory.
const PEAK_OF: &str = "TEXREG_BENCH_LOAD_PEAK_OF";

/// The most memory that a process that loads a file takes, in megabytes; Linux alone tells.
fn peak_memory(path: &Path) -> Result<Option<f64>> {
    let output =
        Command::new(std::env::current_exe()?).args(["bench", "load", "--json"]).env(PEAK_OF, path).output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    Ok(text.trim().parse().ok().map(|kilobytes: f64| kilobytes * 1024.0 / 1e6))
}

/// Loads a file and prints the kilobytes that this process ever held.
fn print_peak(path: &Path) -> Result<()> {
    std::hint::black_box(load(path)?);
    let status = std::fs::read_to_string("/proc/self/status")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    println!("{}", line.and_then(|line| line.split_ascii_whitespace().next()).unwrap_or_default());
    Ok(())
}

/// A photo of the cases, or the fixture's.
fn photo(arguments: &Arguments) -> PathBuf {
    let case = arguments.cases.as_ref().map(|cases| cases.join("terrain_1m/photo_00.jpg"));
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/nefertiti/photo_00.jpg");
    case.filter(|path| path.is_file()).unwrap_or(fixture)
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}

fn best(times: &[f64]) -> f64 {
    times.iter().copied().fold(f64::INFINITY, f64::min)
}

fn median(times: &[f64]) -> f64 {
    let mut times = times.to_vec();
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Writes the graph of a wave over a grid of `side` × `side` vertices.
fn write(path: &Path, form: Form, side: usize) -> Result<()> {
    let mut file = BufWriter::with_capacity(1 << 20, std::fs::File::create(path)?);
    let real = if form == Form::Survey { "double" } else { "float" };
    if form != Form::Obj {
        let encoding = if form == Form::Text { "ascii" } else { "binary_little_endian" };
        write!(file, "ply\nformat {encoding} 1.0\nelement vertex {}\n", side * side)?;
        write!(file, "property {real} x\nproperty {real} y\nproperty {real} z\n")?;
        if form == Form::Attributes {
            write!(file, "property float nx\nproperty float ny\nproperty float nz\nproperty float reflectance\n")?;
            write!(file, "property uchar red\nproperty uchar green\nproperty uchar blue\n")?;
        }
        writeln!(file, "element face {}", 2 * (side - 1) * (side - 1))?;
        write!(file, "property list uchar int vertex_indices\nend_header\n")?;
    }
    for i in 0..side * side {
        let (x, y) = ((i % side) as f64 * 0.01, (i / side) as f64 * 0.01);
        let z = (1.3 * x).sin() * (0.7 * y).cos();
        let point = [x as f32, y as f32, z as f32];
        match form {
            Form::Text => writeln!(file, "{} {} {}", point[0], point[1], point[2])?,
            Form::Obj => writeln!(file, "v {} {} {}", point[0], point[1], point[2])?,
            Form::Survey => {
                for value in [4.5e6 + x, 5.4e6 + y, z] {
                    file.write_all(&value.to_le_bytes())?;
                }
            }
            Form::Plain | Form::Attributes => {
                for value in point {
                    file.write_all(&value.to_le_bytes())?;
                }
            }
        }
        if form == Form::Attributes {
            for value in [0.0f32, 0.0, 1.0, 0.5] {
                file.write_all(&value.to_le_bytes())?;
            }
            file.write_all(&[i as u8, 128, 255])?;
        }
    }
    for i in (0..side * (side - 1)).filter(|i| i % side != side - 1) {
        let [a, b, c, d] = [i, i + 1, i + side, i + side + 1];
        for triangle in [[a, b, d], [a, d, c]] {
            match form {
                Form::Text => writeln!(file, "3 {} {} {}", triangle[0], triangle[1], triangle[2])?,
                Form::Obj => writeln!(file, "f {} {} {}", triangle[0] + 1, triangle[1] + 1, triangle[2] + 1)?,
                _ => {
                    file.write_all(&[3])?;
                    for index in triangle {
                        file.write_all(&(index as i32).to_le_bytes())?;
                    }
                }
            }
        }
    }
    file.flush()?;
    Ok(())
}
