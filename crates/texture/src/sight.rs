//! What a photo sees of a surface, and how well: exact visibility from a rendering, and a weight.

use crate::Source;
use nalgebra::{Point2, Point3, Rotation3, Vector3};
use rayon::prelude::*;
use texreg_camera::Camera;
use texreg_lie::Pose;
use texreg_raster::{GBuffer, NO_FACE, Options, Renderer, outline};
use texreg_surface::Mesh;

/// A jump in depth between neighbouring pixels, in widths of a pixel there, that makes an edge. It is also the slope beyond
/// which a surface is too oblique to be taken a texture from.
const JUMP: f32 = 8.0;
/// How far a point may lie behind what the rendering sees, in widths of a pixel over the cosine of the view's angle.
const DEPTH_TOLERANCE: f64 = 1.0;
/// The least cosine between the normal and the direction to the camera.
const LEAST_COSINE: f64 = 0.12;
/// Pixels next to an edge that are never used, of a photo of 1,600 pixels or less; it grows with larger ones, whose
/// pixels are less sharp.
const MARGIN: f64 = 1.5;
const MARGIN_WIDTH: f64 = 1600.0;
/// The distance to an edge at which it no longer matters, as a share of the photo's longer side.
const RAMP: f64 = 0.02;
/// Steps of a pixel in which distances to edges are kept.
const STEPS: f32 = 4.0;

/// A photo's view of the surface, rendered.
pub(crate) struct Sight {
    camera: Camera,
    camera_from_mesh: Pose,
    /// The camera's centre in the mesh frame.
    centre: Point3<f64>,
    /// 1/z by pixel, 0 on the background.
    inverse_depth: Vec<f32>,
    /// The distance to the nearest edge, in quarters of a pixel.
    distance: Vec<u8>,
    margin: f64,
    ramp: f64,
    trust: f64,
}

/// How a photo sees a point of the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Glimpse {
    /// Where it sees it.
    pub(crate) pixel: Point2<f64>,
    /// How much it is worth: pixels that a unit of length covers along the view's slope, the less the nearer to an edge.
    pub(crate) weight: f64,
    /// The same without regard to pixels.
    pub(crate) even: f64,
    /// Pixels a model unit of the surface is long, seen from straight ahead.
    pub(crate) density: f64,
    /// The distance to the nearest edge, pixels; at most 63.
    pub(crate) edge: f64,
}

impl Sight {
    /// Renders what a photo sees, and marks the faces it sees in `seen`.
    pub(crate) fn new(mesh: &Mesh, source: &Source, renderer: &mut Renderer, seen: &mut [bool]) -> Self {
        let camera = source.view.camera;
        let camera_from_mesh = source.view.pose * Pose::new(Rotation3::identity(), mesh.origin);
        let triangles = mesh.shape();
        let mut picture = GBuffer::default();
        renderer.render(&triangles, &camera, &camera_from_mesh, &Options::default(), &mut picture);
        seen.fill(false);
        picture.face.iter().filter(|&&f| f != NO_FACE).for_each(|&f| seen[f as usize] = true);
        let longer = f64::from(camera.width.max(camera.height));
        let distance = edge_distances(&mut picture, &camera);
        let mut sight = Self {
            camera,
            camera_from_mesh,
            centre: camera_from_mesh.center(),
            inverse_depth: Vec::new(),
            distance,
            margin: MARGIN * (longer / MARGIN_WIDTH).max(1.0) + source.uncertainty,
            ramp: (RAMP * longer).clamp(4.0, 60.0),
            trust: source.trust,
        };
        sight.inverse_depth = picture.depth;
        sight.inverse_depth.par_iter_mut().for_each(|z| *z = 1.0 / *z);
        // Faces smaller than a pixel are seen if one of their vertices is.
        let visible: Vec<bool> = (0..mesh.positions.len())
            .into_par_iter()
            .map(|i| {
                let point = Point3::from(mesh.positions[i].map(f64::from));
                sight.glimpse(&point, &Vector3::from(mesh.normals[i].map(f64::from))).is_some()
            })
            .collect();
        seen.par_iter_mut().zip(&mesh.triangles).for_each(|(seen, t)| *seen |= t.iter().any(|&i| visible[i as usize]));
        sight
    }

    /// How the photo sees a point in the mesh frame; `None` if something is before it, it is out of the picture, too oblique
    /// or too near to an edge.
    pub(crate) fn glimpse(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> Option<Glimpse> {
        let to_camera = self.centre - point;
        let cosine = normal.dot(&to_camera).abs() / to_camera.norm();
        if cosine.is_nan() || cosine < LEAST_COSINE {
            return None;
        }
        let in_camera = self.camera_from_mesh.transform_point(point);
        let pixel = self.camera.project(&in_camera)?;
        let (width, height) = (self.camera.width as usize, self.camera.height as usize);
        let border = pixel.x.min(pixel.y).min((width - 1) as f64 - pixel.x).min((height - 1) as f64 - pixel.y);
        if border.is_nan() || border < 1.0 {
            return None;
        }
        let (x, y) = (pixel.x as usize, pixel.y as usize);
        let (fx, fy) = (pixel.x - x as f64, pixel.y - y as f64);
        let at = y * width + x;
        let w = [at, at + 1, at + width, at + width + 1].map(|i| f64::from(self.inverse_depth[i]));
        if w.contains(&0.0) {
            return None;
        }
        // 1/z is linear in the picture of a plane.
        let seen = (w[0] * (1.0 - fx) + w[1] * fx) * (1.0 - fy) + (w[2] * (1.0 - fx) + w[3] * fx) * fy;
        let z = in_camera.z;
        let focal = self.focal();
        let behind = z - 1.0 / seen;
        if behind.abs() > DEPTH_TOLERANCE * z / (focal * cosine) + 1e-6 * z {
            return None;
        }
        let nearest = (pixel.y.round() as usize) * width + pixel.x.round() as usize;
        let edge = f64::from(self.distance[nearest]) / f64::from(STEPS);
        let inside = edge - self.margin;
        if inside <= 0.0 {
            return None;
        }
        let density = focal / z;
        let ease = smooth(inside / self.ramp) * smooth(border / self.ramp);
        let even = self.trust * (1e-3 + ease);
        Some(Glimpse { pixel, weight: even * density * cosine, even, density, edge })
    }

    /// Pixels that see a model unit of a surface that is not hidden, the mean along and across the view's slope; `normal` may
    /// have any length.
    pub(crate) fn density(&self, point: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
        let to_camera = self.centre - point;
        let z = self.camera_from_mesh.transform_point(point).z;
        let cosine = normal.dot(&to_camera).abs() / (to_camera.norm() * normal.norm());
        if z > 0.0 && cosine > 0.0 { self.focal() / z * cosine.sqrt() } else { 0.0 }
    }

    /// Pixels per unit of normalized coordinates.
    fn focal(&self) -> f64 {
        (self.camera.intrinsics.fx * self.camera.intrinsics.fy).sqrt()
    }

    /// Whether a pixel sees the surface well away from any edge.
    pub(crate) fn is_inside(&self, pixel: usize) -> bool {
        self.inverse_depth[pixel] != 0.0 && f64::from(self.distance[pixel]) >= self.margin * f64::from(STEPS)
    }
}

/// From 0 at 0 to 1 at 1, flat at both ends.
fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The distance of each pixel to the nearest one at a jump in depth, in quarters of a pixel. Takes the faces of the picture.
fn edge_distances(picture: &mut GBuffer, camera: &Camera) -> Vec<u8> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let focal = camera.intrinsics.fx.min(camera.intrinsics.fy) as f32;
    let depth = &picture.depth;
    let is_edge = |at: usize| {
        let (x, here) = (at % width, depth[at]);
        let jump = |there: f32| match (here.is_finite(), there.is_finite()) {
            (true, true) => (here - there).abs() * focal > JUMP * here.min(there),
            (here, there) => here || there,
        };
        (x > 0 && jump(depth[at - 1]))
            || (x + 1 < width && jump(depth[at + 1]))
            || (at >= width && jump(depth[at - width]))
            || (at + width < width * height && jump(depth[at + width]))
    };
    let edges: Vec<bool> = (0..width * height).into_par_iter().map(is_edge).collect();
    picture.face.par_iter_mut().zip(&edges).for_each(|(face, edge)| *face = if *edge { 0 } else { NO_FACE });
    let mut distance: Vec<u8> = edges.iter().map(|edge| if *edge { 0 } else { u8::MAX }).collect();
    for pixel in outline(picture, f32::from(u8::MAX) / STEPS) {
        distance[pixel.pixel as usize] = (pixel.distance * STEPS) as u8;
    }
    distance
}
