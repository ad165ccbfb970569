//! The rasterizer beside Embree's rays, OpenGL on llvmpipe, OpenCV's rasterizer and a plain copy loop.
//!
//! The peers are run frame by frame from one process each, a frame of theirs and a frame of ours in turn; figures are the
//! least of all frames, with the medians told on standard error. What Embree takes to build its tree is not counted, nor what
//! we take to cut the mesh into meshlets, which has a row of its own.

use super::{Arguments, Report, Row, python};
use anyhow::{Context, Result, bail, ensure};
use nalgebra::{Matrix3, Rotation3, Vector3};
use std::cell::OnceCell;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout};
use std::time::Instant;
use texreg::camera::Camera;
use texreg::lie::Pose;
use texreg::raster::{GBuffer, Meshlets, NO_FACE, Options, Renderer, Triangles, outline};

/// The peers' process: a driver for the scripts in their folder.
const SCRIPT: &str = include_str!("raster_peer.py");

/// The peers by their names in the scripts, with what to call them and the ratio aimed at below and from 4 million triangles.
const PEERS: [(&str, &str, [f64; 2]); 3] = [
    ("o3d_embree", "Embree, 2 threads", [0.2, 1.0 / 3.0]),
    ("gl_llvmpipe", "llvmpipe", [1.0, 1.0]),
    ("cv_raster", "OpenCV, depth only", [1.0, 1.0]),
];

/// Pictures of the large meshes.
const SIZES: [(u32, u32); 2] = [(1024, 768), (2048, 1536)];

/// A mesh that owns its arrays.
pub(super) struct Model {
    name: String,
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) indices: Vec<[u32; 3]>,
    meshlets: OnceCell<Meshlets>,
}

/// Runs the benchmark.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let frames = if arguments.quick { 5 } else { 15 };
    let sizes = if arguments.quick { &SIZES[..1] } else { &SIZES };
    let names: &[(&str, u32)] = &[("100k", 158), ("1m", 500), ("4m", 1000)][..if arguments.quick { 2 } else { 3 }];
    let mut rows = Vec::new();
    for &(name, rings) in names {
        let file = arguments.peers.as_ref().map(|peers| peers.join(format!("data/mesh/statue_{name}.ply")));
        let file = file.filter(|file| file.is_file());
        let model = match &file {
            Some(file) => Model::load(name, file)?,
            None => {
                eprintln!(
                    "{name}: no statue_{name}.ply from the peers' gen.py (--peers); a bumpy sphere instead, without peers"
                );
                Model::bumpy_sphere(name, rings)
            }
        };
        prepare(&model, frames.min(5), &mut rows);
        for &size in sizes {
            beside_a_copy(&model, size, frames, &mut rows);
        }
        if let (Some(peers), Some(_)) = (&arguments.peers, &file) {
            for peer in PEERS {
                if let Err(error) = beside_a_peer(&model, peers, peer, sizes, frames, &mut rows) {
                    eprintln!("{}: missing: {error:#}", peer.1);
                }
            }
        }
    }
    alone(arguments.quick, frames, &mut rows);
    Ok(Report::new("raster", rows))
}

/// The view all large meshes are seen from: 40° high, from four units away.
fn view((width, height): (u32, u32)) -> (Camera, Pose) {
    let focal = f64::from(height) / 2.0 / 20_f64.to_radians().tan();
    let (sin, cos) = 0.5_f64.sin_cos();
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::new(cos, 0.0, sin, 0.0, -1.0, 0.0, sin, 0.0, -cos));
    (Camera::ideal(width, height, focal), Pose::new(rotation, Vector3::new(0.0, 0.0, 4.0)))
}

/// Times one frame, in milliseconds.
fn time<T>(frame: impl FnOnce() -> T) -> f64 {
    let start = Instant::now();
    std::hint::black_box(frame());
    start.elapsed().as_secs_f64() * 1e3
}

/// The least and the median of some figures.
fn least_and_median(mut figures: Vec<f64>) -> (f64, f64) {
    figures.sort_by(f64::total_cmp);
    (figures[0], figures[figures.len() / 2])
}

/// A row from figures taken in turn, and a line with the medians.
fn row(name: String, ours: Vec<f64>, peer: Vec<f64>, peer_name: &str, goal: f64) -> Row {
    let ((ours, our_median), (peer, peer_median)) = (least_and_median(ours), least_and_median(peer));
    eprintln!("{name}: {ours:.2} / {our_median:.2} ms, {peer_name} {peer:.2} / {peer_median:.2} ms (least / median)");
    Row::beside(name, ours, peer, peer_name, "ms").goal(goal)
}

/// What is done once for a mesh.
fn prepare(model: &Model, frames: usize, rows: &mut Vec<Row>) {
    let plain = Triangles::new(&model.positions, &model.indices);
    let (least, median) = least_and_median((0..frames).map(|_| time(|| Meshlets::new(&plain))).collect());
    eprintln!("{} cut into meshlets: {least:.2} / {median:.2} ms (least / median)", model.name);
    rows.push(Row::alone(format!("{} cut into meshlets, once", model.name), least, "ms"));
}

/// Beside reading all vertices and indices and writing all pixels once, in a plain loop on one thread.
fn beside_a_copy(model: &Model, size: (u32, u32), frames: usize, rows: &mut Vec<Row>) {
    let (camera, pose) = view(size);
    let (mut renderer, mut picture) = (Renderer::new(), GBuffer::default());
    let mut render = || renderer.render(&model.triangles(), &camera, &pose, &Options::default(), &mut picture);
    let pixels = (size.0 * size.1) as usize;
    let (mut depth, mut face) = (vec![0.0_f32; pixels], vec![0_u32; pixels]);
    let mut copy = || {
        let vertices = model.positions.as_flattened().iter().fold(0_u32, |sum, x| sum.wrapping_add(x.to_bits()));
        let indices = model.indices.as_flattened().iter().fold(0_u32, |sum, &i| sum.wrapping_add(i));
        depth.fill(vertices as f32);
        face.fill(indices);
        std::hint::black_box((&depth, &face));
    };
    render();
    copy();
    let (ours, limit) = (0..frames).map(|_| (time(&mut render), time(&mut copy))).unzip();
    let name = format!("{} {}×{}", model.name, size.0, size.1);
    rows.push(row(name, ours, limit, "copy loop", 3.0));
}

/// Beside a peer, and in agreement with it where it tells faces.
fn beside_a_peer(
    model: &Model,
    folder: &Path,
    (peer, peer_name, goals): (&str, &str, [f64; 2]),
    sizes: &[(u32, u32)],
    frames: usize,
    rows: &mut Vec<Row>,
) -> Result<()> {
    let scratch = tempfile::tempdir()?;
    let script = scratch.path().join("raster_peer.py");
    std::fs::write(&script, SCRIPT)?;
    let mut peer = Peer::start(folder, &script, &[peer, &model.name, "2"], sizes)?;
    for &size in sizes {
        let (camera, pose) = view(size);
        let (mut renderer, mut picture) = (Renderer::new(), GBuffer::default());
        let mut render = || renderer.render(&model.triangles(), &camera, &pose, &Options::default(), &mut picture);
        ensure!(peer.line()? == "ready", "unexpected answer");
        render();
        peer.frame()?;
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for _ in 0..frames {
            ours.push(time(&mut render));
            theirs.push(peer.frame()?);
        }
        let name = format!("{} {}×{}", model.name, size.0, size.1);
        let goal = goals[usize::from(model.indices.len() > 3_000_000)];
        rows.push(row(name.clone(), ours, theirs, peer_name, goal));
        let saved = scratch.path().join("picture");
        peer.save(&saved)?;
        if peer_name.starts_with("Embree") {
            compare(&name, &picture, &std::fs::read(&saved)?, rows);
        }
    }
    Ok(())
}

/// How a picture agrees with another that was saved: depths, then faces.
fn compare(name: &str, picture: &GBuffer, saved: &[u8], rows: &mut Vec<Row>) {
    let pixels = picture.face.len();
    let word = |k: usize| <[u8; 4]>::try_from(&saved[4 * k..4 * k + 4]).unwrap_or_default();
    let (mut other, mut same, mut deeper) = (0, 0, 0);
    for (k, (&face, &depth)) in picture.face.iter().zip(&picture.depth).enumerate() {
        let (z, id) = (f32::from_le_bytes(word(k)), u32::from_le_bytes(word(pixels + k)));
        if face != id {
            other += 1;
        } else if face != NO_FACE {
            same += 1;
            deeper += u32::from((depth / z - 1.0).abs() > 1e-5);
        }
    }
    let share = |count: u32, of: u32| 100.0 * f64::from(count) / f64::from(of.max(1));
    rows.push(Row::alone(format!("{name}: another face than Embree"), share(other, same + other), "%").goal(0.1));
    let depth = format!("{name}: same face, depth off by 1e-5");
    rows.push(Row::alone(depth, share(deeper, same), "%").goal(0.1));
}

/// Figures without a peer: a step of a pose search, what else a picture may need, and a mesh larger than any cache.
fn alone(quick: bool, frames: usize, rows: &mut Vec<Row>) {
    let mut measure = |name: &str, frame: &mut dyn FnMut()| {
        frame();
        let (least, median) = least_and_median((0..frames).map(|_| time(&mut *frame)).collect());
        eprintln!("{name}: {least:.2} / {median:.2} ms (least / median)");
        rows.push(Row::alone(name, least, "ms"));
    };
    let small = Model::bumpy_sphere("20k", 71);
    let (camera, pose) = view((150, 112));
    let (mut renderer, mut picture) = (Renderer::new(), GBuffer::default());
    measure("20k 150×112, one thread", &mut || {
        renderer.render(&small.triangles(), &camera, &pose, &Options::default(), &mut picture);
    });
    measure("outline of it, 12 pixels", &mut || drop(outline(&picture, 12.0)));
    let photo = Model::bumpy_sphere("100k", 158);
    let (mut camera, pose) = view((1600, 1200));
    measure("100k 1600×1200", &mut || {
        renderer.render(&photo.triangles(), &camera, &pose, &Options::default(), &mut picture);
    });
    measure("outline of it, 12 pixels", &mut || drop(outline(&picture, 12.0)));
    let barycentric = Options { barycentric: true, ..Options::default() };
    measure("100k 1600×1200 with barycentrics", &mut || {
        renderer.render(&photo.triangles(), &camera, &pose, &barycentric, &mut picture);
    });
    camera.distortion.k1 = -0.1;
    measure("100k 1600×1200 through a distorting lens", &mut || {
        renderer.render(&photo.triangles(), &camera, &pose, &Options::default(), &mut picture);
    });
    if !quick {
        let large = Model::bumpy_sphere("1m", 500);
        let (camera, pose) = view((150, 112));
        let one_thread = Options { parallel: false, ..Options::default() };
        measure("1m 150×112, one thread", &mut || {
            renderer.render(&large.triangles(), &camera, &pose, &one_thread, &mut picture);
        });
        let (camera, pose) = view(SIZES[0]);
        let mut a_triangle = |name: &str, rings: u32| {
            let model = Model::bumpy_sphere(name, rings);
            let mut render = || renderer.render(&model.triangles(), &camera, &pose, &Options::default(), &mut picture);
            render();
            1e6 / model.indices.len() as f64 * (0..frames).map(|_| time(&mut render)).fold(f64::INFINITY, f64::min)
        };
        let (one, ten) = (a_triangle("1m", 500), a_triangle("10m", 1581));
        rows.push(Row::beside("10m 1024×768, a triangle", ten, one, "1m", "ns").goal(1.1));
    }
}

impl Model {
    fn triangles(&self) -> Triangles<'_> {
        let plain = Triangles::new(&self.positions, &self.indices);
        Triangles { meshlets: Some(self.meshlets.get_or_init(|| Meshlets::new(&plain))), ..plain }
    }

    fn new(name: &str, positions: Vec<[f32; 3]>, indices: Vec<[u32; 3]>) -> Self {
        Self { name: name.to_string(), positions, indices, meshlets: OnceCell::new() }
    }

    fn load(name: &str, file: &Path) -> Result<Self> {
        let mesh = texreg::surface::load(file)?;
        Ok(Self::new(name, mesh.positions, mesh.triangles))
    }

    /// A closed bumpy sphere of about unit radius with 4·rings² triangles, row after row.
    pub(super) fn bumpy_sphere(name: &str, rings: u32) -> Self {
        let columns = 2 * rings;
        let point = |ring: u32, column: u32| {
            let theta = std::f32::consts::PI * ring as f32 / rings as f32;
            let phi = std::f32::consts::TAU * column as f32 / columns as f32;
            let r = 1.0 + 0.08 * (5.0 * theta).sin() * (4.0 * phi).sin() * theta.sin();
            [r * theta.sin() * phi.cos(), r * theta.cos(), -r * theta.sin() * phi.sin()]
        };
        let grid = |rings| (0..rings).flat_map(move |ring| (0..columns).map(move |column| (ring, column)));
        let at = |ring: u32, column: u32| ring * columns + column % columns;
        let quad = |(r, c)| [[at(r, c), at(r + 1, c), at(r + 1, c + 1)], [at(r, c), at(r + 1, c + 1), at(r, c + 1)]];
        Self::new(name, grid(rings + 1).map(|(r, c)| point(r, c)).collect(), grid(rings).flat_map(quad).collect())
    }
}

/// A peer's process.
struct Peer {
    process: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
}

impl Peer {
    fn start(folder: &Path, script: &Path, arguments: &[&str], sizes: &[(u32, u32)]) -> Result<Self> {
        let folder = folder.canonicalize()?;
        let mut process = python(&folder)
            .arg(script)
            .args(arguments)
            .args(sizes.iter().map(|(width, height)| format!("{width}x{height}")))
            .current_dir(folder)
            .envs([("LP_NUM_THREADS", "2"), ("LIBGL_ALWAYS_SOFTWARE", "1"), ("EGL_PLATFORM", "surfaceless")])
            .spawn()?;
        let input = process.stdin.take().context("no input")?;
        let output = BufReader::new(process.stdout.take().context("no output")?);
        Ok(Self { process, input, output })
    }

    /// The next line the peer says of itself, without what its libraries print.
    fn line(&mut self) -> Result<String> {
        loop {
            let mut line = String::new();
            if self.output.read_line(&mut line)? == 0 {
                bail!("it ended early; is it installed?");
            }
            let line = line.trim();
            if matches!(line, "ready" | "saved") || line.parse::<f64>().is_ok() {
                return Ok(line.to_string());
            }
        }
    }

    /// Renders a frame and returns its milliseconds.
    fn frame(&mut self) -> Result<f64> {
        writeln!(self.input, "frame")?;
        Ok(self.line()?.parse()?)
    }

    /// Finishes a size and saves its picture.
    fn save(&mut self, file: &Path) -> Result<()> {
        writeln!(self.input, "save {}", file.display())?;
        ensure!(self.line()? == "saved", "unexpected answer");
        Ok(())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // It may have ended by itself, which is as good.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
