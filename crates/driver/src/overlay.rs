//! Overlay pictures: the model's outline and its shaded normals over the photo, one panel a camera, side by side
//! or, where the model is wide, one below the other.
//!
//! All panels show the same part of the photo, the part the model covers in any of them with a margin around it. The
//! model is rendered at twice the panel's resolution; the outline is where the depth jumps there, drawn as a bright line
//! with a dark rim so that it can be read on any photo.

use image::imageops::{self, FilterType};
use image::{Rgb, RgbImage};
use nalgebra::Vector3;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster, get_raster_width};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_lie::Pose;
use texreg_raster::{GBuffer, NO_FACE, Options, render};
use texreg_surface::Mesh;

use crate::{Photo, Window};

/// Rendered pixels to a picture's pixel, along each axis.
const FINE: u32 = 2;
/// The greatest width and height of the whole picture, in pixels.
const LIMIT: [u32; 2] = [1600, 1000];
/// The greatest enlargement of a photo.
const ENLARGED: f64 = 4.0;
/// The width of the strip between panels, in pixels.
const GAP: u32 = 6;
/// The share of the shaded model where it lies over the photo.
const SHADE: f32 = 0.38;
/// A jump in depth that makes an edge, as a share of the model's diagonal.
const JUMP: f64 = 0.012;
/// The size of the labels.
const TEXT: RasterHeight = RasterHeight::Size20;
/// The colour of strips, rims and labels' plates.
const INK: [f32; 3] = [14.0, 17.0, 22.0];

/// One panel of an overlay.
#[derive(Clone, Copy, Debug)]
pub struct Panel<'a> {
    /// What is written in its corner (printable ASCII).
    pub label: &'a str,
    /// The camera the model is drawn with.
    pub view: &'a View,
    /// The colour of the outline.
    pub colour: [u8; 3],
}

/// Draws the panels, all together at most 1600 × 1000 pixels.
pub fn overlay(mesh: &Mesh, photo: &Photo, panels: &[Panel<'_>]) -> RgbImage {
    let frame = Frame::around(mesh, photo, panels);
    let [width, height] = frame.panel;
    let part = frame.cut(photo);
    let filter = if width < frame.width { FilterType::Triangle } else { FilterType::CatmullRom };
    let part = imageops::resize(&part, width, height, filter);
    let [total_width, total_height] = frame.total(panels.len());
    let mut picture = RgbImage::from_pixel(total_width, total_height, Rgb(INK.map(|c| c as u8)));
    for (i, panel) in panels.iter().enumerate() {
        let mut drawn = part.clone();
        draw_model(&mut drawn, mesh, &frame, panel);
        draw_label(&mut drawn, panel);
        let at = i as u32 * (frame.panel[frame.axis] + GAP);
        let (x, y) = if frame.axis == 0 { (at, 0) } else { (0, at) };
        imageops::replace(&mut picture, &drawn, i64::from(x), i64::from(y));
    }
    picture
}

/// The part of the photo that is shown, the size it is shown at, and the axis along which panels are lined up.
struct Frame {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
    panel: [u32; 2],
    axis: usize,
}

impl Frame {
    fn around(mesh: &Mesh, photo: &Photo, panels: &[Panel<'_>]) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let stride = mesh.positions.len() / 50_000 + 1;
        for panel in panels {
            for i in (0..mesh.positions.len()).step_by(stride) {
                if let Some(pixel) = panel.view.project(&mesh.point(i)) {
                    for k in 0..2 {
                        low[k] = low[k].min(pixel[k]);
                        high[k] = high[k].max(pixel[k]);
                    }
                }
            }
        }
        let margin = 0.08 * (high[0] - low[0]).max(high[1] - low[1]) + 8.0;
        let cut = |low: f64, high: f64, size: u32| {
            let from = (low - margin).clamp(0.0, f64::from(size)) as u32;
            let to = (high + margin).clamp(0.0, f64::from(size)).ceil() as u32;
            // What is too thin to be a picture is not worth cutting out.
            if to < from + size.div_ceil(16) { (0, size) } else { (from, to - from) }
        };
        let (left, width) = cut(low[0], high[0], photo.width);
        let (top, height) = cut(low[1], high[1], photo.height);
        let count = panels.len().max(1) as u32;
        let scale = |axis: usize| {
            let mut room = LIMIT;
            room[axis] = (LIMIT[axis] - (count - 1) * GAP) / count;
            (f64::from(room[0]) / f64::from(width)).min(f64::from(room[1]) / f64::from(height))
        };
        let axis = if scale(0) >= scale(1) { 0 } else { 1 };
        let shown = |n: u32| ((f64::from(n) * scale(axis).min(ENLARGED)) as u32).max(1);
        Self { left, top, width, height, panel: [shown(width), shown(height)], axis }
    }

    /// The size of so many panels in a line.
    fn total(&self, count: usize) -> [u32; 2] {
        let mut total = self.panel;
        total[self.axis] = (self.panel[self.axis] + GAP) * count.max(1) as u32 - GAP;
        total
    }

    /// This part of the photo, pixel by pixel.
    fn cut(&self, photo: &Photo) -> RgbImage {
        let at = |x, y| photo.rgb[(self.top + y) as usize * photo.width as usize + (self.left + x) as usize];
        RgbImage::from_fn(self.width, self.height, |x, y| Rgb(at(x, y)))
    }

    /// The camera that sees this part of the photo in `FINE` times the panel's pixels.
    fn camera(&self, camera: &Camera) -> Camera {
        let [left, top, width, height] = [self.left, self.top, self.width, self.height].map(f64::from);
        Window { left, top, width, height, pixels: self.panel.map(|n| n * FINE) }.camera(camera)
    }
}

/// The outline of the model alone, over nothing: red, green, blue and opacity, row by row in the view's own pixels.
pub fn outline_picture(mesh: &Mesh, view: &View, colour: [u8; 3]) -> Vec<[u8; 4]> {
    let camera = view.camera.scaled(f64::from(FINE));
    let camera_from_mesh = view.pose * Pose::new(nalgebra::Rotation3::identity(), mesh.origin);
    let triangles = mesh.shape();
    let fine = render(&triangles, &camera, &camera_from_mesh, &Options::default());
    let edges = edges(&fine, (JUMP * mesh.diagonal()) as f32);
    let (line, rim) = (spread(&edges, fine.width, 1), spread(&edges, fine.width, 3));
    let width = view.camera.width as usize;
    let pixel = |at: usize| {
        let (on_line, on_rim) = (share(&line, at, width), share(&rim, at, width));
        let opacity = 1.0 - (1.0 - 0.4 * on_rim) * (1.0 - on_line);
        let of_line = if opacity > 0.0 { on_line / opacity } else { 0.0 };
        let mix = |k: usize| (INK[k] + (f32::from(colour[k]) - INK[k]) * of_line + 0.5) as u8;
        [mix(0), mix(1), mix(2), (255.0 * opacity + 0.5) as u8]
    };
    (0..width * view.camera.height as usize).into_par_iter().map(pixel).collect()
}

/// The share of a picture's pixel that is marked in `FINE` times its resolution.
fn share(marks: &[bool], at: usize, width: usize) -> f32 {
    let fine = FINE as usize;
    let first = (at / width * width * fine + at % width) * fine;
    let count = (0..fine * fine).filter(|i| marks[first + i / fine * width * fine + i % fine]).count();
    count as f32 / (FINE * FINE) as f32
}

fn draw_model(picture: &mut RgbImage, mesh: &Mesh, frame: &Frame, panel: &Panel<'_>) {
    let pose = panel.view.pose;
    let triangles = mesh.shape();
    let camera_from_mesh = pose * Pose::new(nalgebra::Rotation3::identity(), mesh.origin);
    let options = Options { barycentric: true, ..Options::default() };
    let fine = render(&triangles, &frame.camera(&panel.view.camera), &camera_from_mesh, &options);
    let normals = fine.interpolate(&mesh.triangles, &mesh.normals, [0.0; 3]);
    let rotation = pose.rotation.cast::<f32>();
    let edges = edges(&fine, (JUMP * mesh.diagonal()) as f32);
    let (line, rim) = (spread(&edges, fine.width, 1), spread(&edges, fine.width, 3));

    let width = picture.width() as usize;
    let fine_width = fine.width as usize;
    let share = 1.0 / (FINE * FINE) as f32;
    picture.par_chunks_exact_mut(3 * width).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.chunks_exact_mut(3).enumerate() {
            let (mut shade, mut covered, mut on_line, mut on_rim) = (Vector3::zeros(), 0.0, 0.0, 0.0);
            for i in 0..(FINE * FINE) as usize {
                let at = (y * FINE as usize + i / FINE as usize) * fine_width + x * FINE as usize + i % FINE as usize;
                on_line += share * f32::from(line[at]);
                on_rim += share * f32::from(rim[at]);
                if fine.face[at] != NO_FACE {
                    covered += share;
                    shade += shaded(&(rotation * Vector3::from(normals[at]))) * share;
                }
            }
            if covered > 0.0 {
                mix(pixel, &(shade / covered).into(), SHADE * covered);
            }
            mix(pixel, &INK, 0.4 * on_rim);
            mix(pixel, &panel.colour.map(f32::from), on_line);
        }
    });
}

/// The colour of a normal in the camera frame: its direction as hue, lit from above the camera's left shoulder.
fn shaded(normal: &Vector3<f32>) -> Vector3<f32> {
    let normal = if normal.z > 0.0 { -normal } else { *normal };
    let light = Vector3::new(-0.35, -0.55, -0.76).dot(&normal).max(0.0);
    let hue = Vector3::new(0.5 + 0.5 * normal.x, 0.5 - 0.5 * normal.y, 0.5 - 0.5 * normal.z);
    (hue * 0.75 + Vector3::repeat(0.25)) * (0.25 + 0.75 * light) * 255.0
}

/// Marks the nearer side of every jump in depth: against the background, or by more than `jump` and more than the slope explains.
fn edges(buffer: &GBuffer, jump: f32) -> Vec<bool> {
    let (width, height) = (buffer.width as usize, buffer.height as usize);
    let depth = &buffer.depth;
    let step = |here: f32, there: f32, behind: f32| {
        here.is_finite() && there - here > jump && (there.is_infinite() || there - here > 3.0 * (here - behind).abs())
    };
    let is_edge = |at: usize| {
        let (x, y, here) = (at % width, at / width, depth[at]);
        let across = x > 0 && x + 1 < width && {
            step(here, depth[at - 1], depth[at + 1]) || step(here, depth[at + 1], depth[at - 1])
        };
        across
            || (y > 0 && y + 1 < height && {
                step(here, depth[at - width], depth[at + width]) || step(here, depth[at + width], depth[at - width])
            })
    };
    (0..width * height).into_par_iter().map(is_edge).collect()
}

/// Every pixel within `radius` of a marked one.
fn spread(marks: &[bool], width: u32, radius: i64) -> Vec<bool> {
    let (width, height) = (i64::from(width), (marks.len() / width.max(1) as usize) as i64);
    let mut wide = vec![false; marks.len()];
    for at in (0..marks.len()).filter(|&at| marks[at]) {
        let (x, y) = (at as i64 % width, at as i64 / width);
        for v in (y - radius).max(0)..=(y + radius).min(height - 1) {
            for u in (x - radius).max(0)..=(x + radius).min(width - 1) {
                if (u - x).pow(2) + (v - y).pow(2) <= radius * radius {
                    wide[(v * width + u) as usize] = true;
                }
            }
        }
    }
    wide
}

/// Writes the label on a plate in the top left corner, after a stroke of the outline's colour.
fn draw_label(picture: &mut RgbImage, panel: &Panel<'_>) {
    let (letter, tall) = (get_raster_width(FontWeight::Bold, TEXT) as u32, TEXT.val() as u32);
    let (margin, pad, stroke) = (10, 8, 18);
    let text = margin + pad + stroke + pad;
    let right = text + letter * panel.label.len() as u32 + pad + 2;
    let bottom = margin + tall + pad;
    let paint = |picture: &mut RgbImage, x: u32, y: u32, colour: &[f32; 3], share: f32| {
        if x < picture.width() && y < picture.height() {
            mix(&mut picture.get_pixel_mut(x, y).0, colour, share);
        }
    };
    for y in margin..bottom {
        for x in margin..right {
            paint(picture, x, y, &INK, 0.72);
        }
    }
    let middle = (margin + bottom) / 2;
    for y in middle - 2..middle + 2 {
        for x in margin + pad..margin + pad + stroke {
            paint(picture, x, y, &panel.colour.map(f32::from), 1.0);
        }
    }
    for (i, character) in panel.label.chars().enumerate() {
        let Some(glyph) = get_raster(character, FontWeight::Bold, TEXT) else { continue };
        for (y, row) in glyph.rows().enumerate() {
            for (x, &ink) in row.iter().enumerate() {
                let (x, y) = (text + i as u32 * letter + x as u32, margin + pad / 2 + y as u32);
                paint(picture, x, y, &[245.0; 3], f32::from(ink) / 255.0);
            }
        }
    }
}

fn mix(pixel: &mut [u8], colour: &[f32; 3], share: f32) {
    for (value, colour) in pixel.iter_mut().zip(colour) {
        *value = (f32::from(*value) + (colour - f32::from(*value)) * share + 0.5) as u8;
    }
}
