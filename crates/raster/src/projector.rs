//! From the mesh frame to fixed-point image coordinates.

use crate::corner::{CLIP, Corner, SUBPIXELS};
use crate::three::each;
use fearless_simd::{Level, dispatch};
use nalgebra::{Matrix3x4, Point2, Point3, Vector2, Vector3};
use std::f64::consts::TAU;
use texreg_camera::Camera;
use texreg_lie::Pose;

/// How far, in pixels, a triangle drawn with straight edges may stray from what a distorting lens makes of it.
///
/// Longer edges are split. A camera whose distortion would need edges under 2 pixels is drawn
/// with edges of that length.
pub const DISTORTION_TOLERANCE: f64 = 1.0 / 32.0;

/// The length in pixels below which distorted edges are never split.
const SHORTEST_EDGE: f64 = 2.0;

/// Projected coordinates stay within ± this many pixels; the rest is clipped. 2¹⁷ · 2¹² units leave room for products in i64.
const GUARD: f64 = 131_072.0;

/// Sides of the polygon that stands for the circle in which a distorted camera is drawn.
const SIDES: usize = 16;

/// What a camera needs known before it draws, whatever the pose.
#[derive(Clone, Debug)]
pub(crate) struct Lens {
    camera: Camera,
    /// Squared radius in undistorted normalized coordinates inside which vertices are projected directly.
    inside: f64,
    /// Half spaces `n·p ≥ 0` through the camera centre that bound what is drawn.
    pub(crate) planes: Vec<Vector3<f64>>,
    /// Longest edge that is drawn straight, in fixed-point units.
    pub(crate) longest_edge: i32,
}

impl Lens {
    pub(crate) fn new(camera: &Camera) -> Self {
        if camera.distortion.is_none() { Self::ideal(camera) } else { Self::distorting(camera) }
    }

    fn ideal(camera: &Camera) -> Self {
        let k = &camera.intrinsics;
        let u = Vector3::new(k.fx, k.skew, k.cx);
        let v = Vector3::new(0.0, k.fy, k.cy);
        let guard = Vector3::new(0.0, 0.0, 0.999 * GUARD);
        Self {
            camera: *camera,
            inside: f64::INFINITY,
            planes: vec![guard - u, guard + u, guard - v, guard + v],
            longest_edge: i32::MAX,
        }
    }

    fn distorting(camera: &Camera) -> Self {
        let domain = camera.distortion.domain().sqrt() * (1.0 - 1e-6);
        // The circle in which the polygon is inscribed reaches a little beyond the farthest image point.
        let reach = image_radius(camera).map_or(domain, |r| (1.04 * r).min(domain));
        let apothem = reach * (TAU / (2 * SIDES) as f64).cos();
        let plane = |k: usize| {
            let (sin, cos) = (TAU * k as f64 / SIDES as f64).sin_cos();
            Vector3::new(-cos, -sin, apothem)
        };
        let edge = longest_edge(camera, reach).max(SHORTEST_EDGE);
        Self {
            camera: *camera,
            inside: apothem * apothem,
            planes: (0..SIDES).map(plane).collect(),
            longest_edge: (edge * SUBPIXELS).min(f64::from(i32::MAX)) as i32,
        }
    }

    pub(crate) fn is_for(&self, camera: &Camera) -> bool {
        self.camera == *camera
    }

    /// The snapped projection of a point in the camera frame, or `None` where it has none within the guard band.
    pub(crate) fn corner(&self, point: &Vector3<f64>) -> Option<Corner> {
        let pixel = self.camera.project(&Point3::from(*point))?;
        let inside = pixel.x.abs() <= GUARD && pixel.y.abs() <= GUARD;
        inside.then(|| Corner { x: snap(pixel.x * SUBPIXELS), y: snap(pixel.y * SUBPIXELS), w: (1.0 / point.z) as f32 })
    }
}

/// The largest undistorted radius on the image's border, or `None` where part of the border sees nothing.
fn image_radius(camera: &Camera) -> Option<f64> {
    let (right, bottom) = (f64::from(camera.width) - 0.5, f64::from(camera.height) - 0.5);
    let mut radius = 0.0_f64;
    for k in 0..=8 {
        let (u, v) = (f64::from(k) / 8.0 * right, f64::from(k) / 8.0 * bottom);
        for (u, v) in [(u, -0.5), (u, bottom), (-0.5, v), (right, v)] {
            radius = radius.max(camera.unproject(&Point2::new(u, v))?.xy().norm());
        }
    }
    Some(radius)
}

/// The edge length in pixels up to which a triangle is drawn straight within [`DISTORTION_TOLERANCE`].
///
/// A map with second derivatives at most M leaves its linear interpolation over a triangle with sides ℓ by at most M ℓ²/6,
/// and over the sides themselves by M ℓ²/8. M and the smallest stretch σ from normalized coordinates to pixels, both
/// sampled over the circle, turn ℓ into σℓ pixels.
fn longest_edge(camera: &Camera, radius: f64) -> f64 {
    const STEP: f64 = 1e-4;
    let linear = camera.intrinsics.linear();
    let slope = |p: &Vector2<f64>| Some(linear * camera.distortion.apply_with_jacobian(p)?.1);
    let (mut bend, mut stretch) = (0.0_f64, f64::INFINITY);
    for ring in 0..=6 {
        for spoke in 0..12 {
            let (sin, cos) = (TAU * f64::from(spoke) / 12.0).sin_cos();
            let radial = Vector2::new(cos, sin);
            let p = radial * (radius * (f64::from(ring) / 6.0));
            let Some(here) = slope(&p) else { continue };
            let s = here.norm_squared();
            let smallest = (0.5 * (s - (s * s - 4.0 * here.determinant().powi(2)).max(0.0).sqrt())).max(0.0).sqrt();
            stretch = stretch.min(smallest);
            for direction in [radial, Vector2::new(-sin, cos), Vector2::new(cos - sin, sin + cos) * 0.5_f64.sqrt()] {
                let step = direction * (STEP * radius);
                // One-sided at the rim, where the outer point may have left the domain.
                if let Some(there) = slope(&(p - step)).or_else(|| slope(&(p + step))) {
                    bend = bend.max(((there - here) * direction).norm() / (STEP * radius));
                }
            }
        }
    }
    // The samples' maximum may miss the true one by a little.
    stretch * (6.0 * DISTORTION_TOLERANCE / (1.2 * bend)).sqrt()
}

/// A camera at a pose: transforms vertices, in bulk and one by one.
pub(crate) struct Projector<'a> {
    pub(crate) lens: &'a Lens,
    pub(crate) near: f64,
    camera_from_mesh: Matrix3x4<f64>,
}

impl<'a> Projector<'a> {
    pub(crate) fn new(lens: &'a Lens, camera_from_mesh: &Pose, near: f64) -> Self {
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(camera_from_mesh.rotation.matrix());
        matrix.set_column(3, &camera_from_mesh.translation);
        Self { lens, near, camera_from_mesh: matrix }
    }

    /// A vertex in the camera frame.
    pub(crate) fn in_camera(&self, position: [f32; 3]) -> Vector3<f64> {
        let [x, y, z] = position.map(f64::from);
        let m = &self.camera_from_mesh;
        let row = |r: usize| m[(r, 0)] * x + m[(r, 1)] * y + m[(r, 2)] * z + m[(r, 3)];
        Vector3::new(row(0), row(1), row(2))
    }

    /// Projects vertices to snapped positions and reciprocal depths; what needs clipping gets [`CLIP`].
    pub(crate) fn project(&self, level: Level, positions: &[[f32; 3]], xy: &mut [[i32; 2]], w: &mut [f32]) {
        dispatch!(level, _simd => self.project_all(positions, xy, w));
    }

    #[inline(always)]
    fn project_all(&self, positions: &[[f32; 3]], xy: &mut [[i32; 2]], w: &mut [f32]) {
        if self.lens.camera.distortion.is_none() {
            self.project_ideal(positions, xy, w);
        } else {
            self.project_distorted(positions, xy, w);
        }
    }

    #[inline(always)]
    fn project_ideal(&self, positions: &[[f32; 3]], xy: &mut [[i32; 2]], w: &mut [f32]) {
        let k = self.lens.camera.intrinsics.matrix();
        let scaled = nalgebra::Matrix3::from_diagonal(&Vector3::new(SUBPIXELS, SUBPIXELS, 1.0));
        let m = scaled * k * self.camera_from_mesh;
        let rows: [[f64; 4]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
        let (near, guard) = (self.near, GUARD * SUBPIXELS);
        for ((position, xy), w) in positions.iter().zip(xy).zip(w) {
            let [x, y, z] = each(*position, f64::from);
            let [u, v, depth] = each(
                rows,
                #[inline(always)]
                |r: [f64; 4]| r[0] * x + r[1] * y + r[2] * z + r[3],
            );
            let inverse = 1.0 / depth;
            let (u, v) = (u * inverse, v * inverse);
            let inside = (depth >= near) & (u.abs() <= guard) & (v.abs() <= guard);
            *xy = [if inside { snap(u) } else { CLIP }, snap(v)];
            *w = inverse as f32;
        }
    }

    #[inline(always)]
    fn project_distorted(&self, positions: &[[f32; 3]], xy: &mut [[i32; 2]], w: &mut [f32]) {
        let camera = &self.lens.camera;
        let [k1, k2, p1, p2, k3] = camera.distortion.to_array();
        let [fx, fy, cx, cy, skew] = camera.intrinsics.to_array().map(|k| k * SUBPIXELS);
        let m = &self.camera_from_mesh;
        let rows: [[f64; 4]; 3] = std::array::from_fn(|r| std::array::from_fn(|c| m[(r, c)]));
        let (near, reach, guard) = (self.near, self.lens.inside, GUARD * SUBPIXELS);
        for ((position, xy), w) in positions.iter().zip(xy).zip(w) {
            let [x, y, z] = each(*position, f64::from);
            let [x, y, depth] = each(
                rows,
                #[inline(always)]
                |r: [f64; 4]| r[0] * x + r[1] * y + r[2] * z + r[3],
            );
            let inverse = 1.0 / depth;
            let (x, y) = (x * inverse, y * inverse);
            let s = x * x + y * y;
            let g = 1.0 + s * (k1 + s * (k2 + s * k3));
            let x_d = x * g + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x);
            let y_d = y * g + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y;
            let (u, v) = (fx * x_d + skew * y_d + cx, fy * y_d + cy);
            let inside = (depth >= near) & (s <= reach) & (u.abs() <= guard) & (v.abs() <= guard);
            *xy = [if inside { snap(u) } else { CLIP }, snap(v)];
            *w = inverse as f32;
        }
    }
}

/// Rounds to the nearest integer, for |x| < 2³¹: adding 1.5·2⁵² leaves the integer in the low mantissa bits.
#[inline(always)]
fn snap(x: f64) -> i32 {
    (x + 6_755_399_441_055_744.0).to_bits() as i32
}
