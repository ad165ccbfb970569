//! How long the studio takes from a motion of the mouse to the picture: a million triangles at 1000×800 over HTTP, as its page asks
//! for them, coarse while the model turns and in full when it rests. What the browser adds to that is in no row: it reports its
//! own figure in the page (`data-spent` of the model's canvas).

use super::raster::Model;
use super::{Arguments, Report, Row};
use anyhow::{Context, Result, ensure};
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::sync::mpsc;
use std::time::Instant;
use texreg::surface::{Attributes, Mesh};
use texreg_studio::{Sources, Studio, serve};

/// Milliseconds from the mouse to the picture.
const LIMIT: f64 = 50.0;

/// The pane, in pixels.
const PANE: [u32; 2] = [1000, 800];

/// Measures frames of each kind.
pub(crate) fn run(arguments: &Arguments) -> Result<Report> {
    let sphere = Model::bumpy_sphere("1m", 500);
    let points: Vec<[f64; 3]> = sphere.positions.iter().map(|p| p.map(f64::from)).collect();
    let reflectance = Some(points.iter().map(|p| (p[1] * 9.0).sin() as f32).collect());
    let mesh = Mesh::new(&points, sphere.indices, Attributes { reflectance, ..Attributes::default() })?;
    let scratch = tempfile::tempdir()?;
    let photo = scratch.path().join("photo.png");
    image::RgbImage::new(64, 48).save(&photo)?;
    let sources = Sources { photos: vec![photo], folder: scratch.path().join("out"), ..Sources::default() };
    let studio = Studio::open(mesh, "sphere", &sources)?;
    let (sender, receiver) = mpsc::channel();
    std::thread::spawn(move || {
        let announce = |page: &str| _ = sender.send(page.to_owned());
        serve(&studio, SocketAddr::from(([127, 0, 0, 1], 0)), announce)
    });
    let page = receiver.recv().context("the studio does not start")?;
    let mut client = Client::new(&page)?;

    let frames = if arguments.quick { 15 } else { 60 };
    let mut rows = Vec::new();
    for (name, scale, quality, shading) in [
        ("moving, half size, shaded", 0.5, 75, "shaded"),
        ("moving, full size, shaded", 1.0, 75, "shaded"),
        ("still, full size, shaded", 1.0, 92, "shaded"),
        ("still, full size, normals", 1.0, 92, "normals"),
        ("still, full size, reflectance", 1.0, 92, "reflectance"),
        ("still, full size, occlusion", 1.0, 92, "occlusion"),
    ] {
        let mut times: Vec<f64> =
            (0..frames + 2).map(|i| client.frame(i, scale, quality, shading)).collect::<Result<_>>()?;
        // The first ones make skins and fill memory.
        times.drain(..2);
        times.sort_by(f64::total_cmp);
        rows.push(Row::beside(name, times[times.len() / 2], LIMIT, "limit", "ms").goal(1.0));
        rows.push(Row::alone(format!("{name}, nine in ten within"), times[times.len() * 9 / 10], "ms"));
    }
    Ok(Report::new("studio", rows))
}

/// A page's connection.
struct Client {
    stream: BufReader<TcpStream>,
    host: String,
    token: String,
}

impl Client {
    fn new(page: &str) -> Result<Self> {
        let (host, token) = page.trim_start_matches("http://").split_once("/#").context("no address")?;
        let stream = TcpStream::connect(host)?;
        stream.set_nodelay(true)?;
        Ok(Self { stream: BufReader::new(stream), host: host.to_owned(), token: token.to_owned() })
    }

    /// Milliseconds from asking for a frame of a turn to having it.
    fn frame(&mut self, turn: usize, scale: f64, quality: u8, shading: &str) -> Result<f64> {
        let (sin, cos) = (0.05 * turn as f64).sin_cos();
        let [width, height] = PANE.map(|n| (f64::from(n) * scale).round());
        let request = format!(
            "GET /api/frame?r={cos},0,{sin},0,1,0,{},0,{cos}&t=0,0,3&f={}&w={width}&h={height}&shading={shading}&photo=0\
             &back=20,24,28&quality={quality} HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {}\r\n\r\n",
            -sin,
            1100.0 * scale,
            self.host,
            self.token
        );
        let began = Instant::now();
        self.stream.get_mut().write_all(request.as_bytes())?;
        let mut length = 0;
        let mut status = String::new();
        self.stream.read_line(&mut status)?;
        loop {
            let mut line = String::new();
            self.stream.read_line(&mut line)?;
            if line.trim().is_empty() {
                break;
            }
            if let Some((name, value)) = line.split_once(':')
                && name.eq_ignore_ascii_case("content-length")
            {
                length = value.trim().parse()?;
            }
        }
        let mut picture = vec![0; length];
        self.stream.read_exact(&mut picture)?;
        let spent = began.elapsed().as_secs_f64() * 1e3;
        ensure!(status.contains("200"), "{status}{}", String::from_utf8_lossy(&picture));
        Ok(spent)
    }
}
