//! From the mesh frame to fixed-point image coordinates.

use crate::corner::{CLIP, Corner, SUBPIXELS};
use crate::meshlets::{Aabb, GROUP};
use crate::three::each;
use fearless_simd::{f32x8, f64x8, i32x16, i64x8, mask64x8, prelude::*};
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

/// What rounding may add to the picture of a box, in pixels, and to its depths, relative.
const MARGIN: f64 = 0.01;
const SLACK: f64 = 1e-5;

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
    /// The length, in fixed-point units, at which edges are bent by [`DISTORTION_TOLERANCE`].
    bent_edge: f64,
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
            bent_edge: f64::INFINITY,
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
        let bent_edge = longest_edge(camera, reach) * SUBPIXELS;
        Self {
            camera: *camera,
            inside: apothem * apothem,
            planes: (0..SIDES).map(plane).collect(),
            longest_edge: bent_edge.clamp(SHORTEST_EDGE * SUBPIXELS, f64::from(i32::MAX)) as i32,
            bent_edge,
        }
    }

    /// Pixel coordinates between which all points are shown whose undistorted normalized coordinates are between these.
    #[inline(always)]
    fn image(&self, x: [f64; 2], y: [f64; 2]) -> [[f64; 2]; 2] {
        let k = &self.camera.intrinsics;
        let [x, y] = if self.camera.distortion.is_none() { [x, y] } else { self.distort(x, y) };
        let (u, v) = (add(times(x, [k.fx; 2]), times(y, [k.skew; 2])), times(y, [k.fy; 2]));
        [[u[0] + k.cx, u[1] + k.cx], [v[0] + k.cy, v[1] + k.cy]]
    }

    /// The distortion in interval arithmetic.
    #[inline(always)]
    fn distort(&self, x: [f64; 2], y: [f64; 2]) -> [[f64; 2]; 2] {
        let [k1, k2, p1, p2, k3] = self.camera.distortion.to_array();
        let scaled = |k: f64, a: [f64; 2]| times([k; 2], a);
        let (xx, yy, xy) = (square(x), square(y), times(x, y));
        let s = add(xx, yy);
        let powers = add(scaled(k1, s), add(scaled(k2, times(s, s)), scaled(k3, times(s, times(s, s)))));
        let g = add([1.0; 2], powers);
        let x_d = add(times(x, g), add(scaled(2.0 * p1, xy), scaled(p2, add(s, scaled(2.0, xx)))));
        let y_d = add(times(y, g), add(scaled(2.0 * p2, xy), scaled(p1, add(s, scaled(2.0, yy)))));
        [x_d, y_d]
    }

    pub(crate) fn is_for(&self, camera: &Camera) -> bool {
        self.camera == *camera
    }

    /// How far, in fixed-point units, a triangle in a box of this side may stray from what the lens makes of it, at most.
    pub(crate) fn bend(&self, side: f64) -> f64 {
        // The longest edge may be √2 times the side, and as much again is for what sampling has missed.
        4.0 * DISTORTION_TOLERANCE * SUBPIXELS * (side / self.bent_edge).powi(2)
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

    /// The focal length in pixels.
    pub(crate) fn focal(&self) -> f32 {
        self.lens.camera.intrinsics.fx as f32
    }

    /// A vertex in the camera frame.
    pub(crate) fn in_camera(&self, position: [f32; 3]) -> Vector3<f64> {
        let [x, y, z] = position.map(f64::from);
        let m = &self.camera_from_mesh;
        let row = |r: usize| m[(r, 0)] * x + m[(r, 1)] * y + m[(r, 2)] * z + m[(r, 3)];
        Vector3::new(row(0), row(1), row(2))
    }

    /// Projects vertices to snapped positions and reciprocal depths (bits); what needs clipping gets [`CLIP`].
    #[inline(always)]
    pub(crate) fn project<S: Simd>(&self, simd: S, positions: &[[[f32; GROUP]; 3]], corners: &mut [[[i32; 4]; GROUP]]) {
        if self.lens.camera.distortion.is_none() {
            self.project_ideal(simd, positions, corners);
        } else {
            self.project_distorted(simd, positions, corners);
        }
    }

    /// What the picture of a box lies within, if any of it is before the near plane.
    #[inline(always)]
    pub(crate) fn extent(&self, aabb: &Aabb) -> Option<Extent> {
        const SIGNS: [[f64; 8]; 3] = [
            [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0],
            [-1.0, -1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0],
            [-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0],
        ];
        let centre = self.in_camera(aabb.centre);
        let half = each(aabb.half, f64::from);
        let m = &self.camera_from_mesh;
        let row = |r: usize| -> [f64; 8] {
            let (x, y, z) = (m[(r, 0)] * half[0], m[(r, 1)] * half[1], m[(r, 2)] * half[2]);
            std::array::from_fn(
                #[inline(always)]
                |k| centre[r] + SIGNS[0][k] * x + SIGNS[1][k] * y + SIGNS[2][k] * z,
            )
        };
        let (x, y, z) = (row(0), row(1), row(2));
        let [near, far] = range(z);
        if far < self.near {
            return None;
        }
        if !(near > self.near * (1.0 + SLACK) && far < f64::INFINITY) {
            return Some(Extent {
                x: [f64::NEG_INFINITY, f64::INFINITY],
                y: [f64::NEG_INFINITY, f64::INFINITY],
                w: [0.0, f32::INFINITY],
            });
        }
        let over_z = |x: [f64; 8]| -> [f64; 8] {
            std::array::from_fn(
                #[inline(always)]
                |k| x[k] / z[k],
            )
        };
        let [x, y] = self.lens.image(range(over_z(x)), range(over_z(y)));
        let w = [((1.0 - SLACK) / far) as f32, ((1.0 + SLACK) / near) as f32];
        Some(Extent { x: [x[0] - MARGIN, x[1] + MARGIN], y: [y[0] - MARGIN, y[1] + MARGIN], w })
    }

    #[inline(always)]
    fn project_ideal<S: Simd>(&self, simd: S, positions: &[[[f32; GROUP]; 3]], corners: &mut [[[i32; 4]; GROUP]]) {
        let k = self.lens.camera.intrinsics.matrix();
        let scaled = nalgebra::Matrix3::from_diagonal(&Vector3::new(SUBPIXELS, SUBPIXELS, 1.0));
        let m = scaled * k * self.camera_from_mesh;
        for (position, corners) in positions.iter().zip(corners) {
            let [u, v, depth] = transform(simd, &m, position);
            let inverse = f64x8::splat(simd, 1.0) / depth;
            let inside = depth.simd_ge(self.near);
            store(simd, [u * inverse, v * inverse, inverse], inside, corners);
        }
    }

    #[inline(always)]
    fn project_distorted<S: Simd>(&self, simd: S, positions: &[[[f32; GROUP]; 3]], corners: &mut [[[i32; 4]; GROUP]]) {
        let camera = &self.lens.camera;
        let [k1, k2, p1, p2, k3] = camera.distortion.to_array();
        let [fx, fy, cx, cy, skew] = camera.intrinsics.to_array().map(|k| k * SUBPIXELS);
        for (position, corners) in positions.iter().zip(corners) {
            let [x, y, depth] = transform(simd, &self.camera_from_mesh, position);
            let inverse = f64x8::splat(simd, 1.0) / depth;
            let (x, y) = (x * inverse, y * inverse);
            let s = x * x + y * y;
            let g = s * (s * (s * k3 + k2) + k1) + 1.0;
            let x_d = x * g + x * (2.0 * p1) * y + (s + x * 2.0 * x) * p2;
            let y_d = y * g + (s + y * 2.0 * y) * p1 + x * (2.0 * p2) * y;
            let inside = depth.simd_ge(self.near) & s.simd_le(self.lens.inside);
            store(simd, [x_d * fx + y_d * skew + cx, y_d * fy + cy, inverse], inside, corners);
        }
    }
}

/// Vertices in the frame that a matrix leads to.
#[inline(always)]
fn transform<S: Simd>(simd: S, m: &Matrix3x4<f64>, position: &[[f32; GROUP]; 3]) -> [f64x8<S>; 3] {
    let [x, y, z] = each(
        *position,
        #[inline(always)]
        |values| {
            let (first, last) = f32x8::load_array(simd, values).widen();
            first.combine(last)
        },
    );
    each(
        [0, 1, 2],
        #[inline(always)]
        |r: usize| x * m[(r, 0)] + y * m[(r, 1)] + z * m[(r, 2)] + m[(r, 3)],
    )
}

/// Rounds image coordinates in fixed-point units to integers; what is not inside gets [`CLIP`].
#[inline(always)]
fn store<S: Simd>(simd: S, [u, v, w]: [f64x8<S>; 3], inside: mask64x8<S>, corners: &mut [[i32; 4]; GROUP]) {
    let guard = GUARD * SUBPIXELS;
    let inside = inside & u.abs().simd_le(guard) & v.abs().simd_le(guard);
    let clip = f64x8::splat(simd, f64::from_bits(u64::from(CLIP as u32)));
    let [u, v]: [i64x8<S>; 2] = [inside.select(u + INTEGER, clip).bitcast(), (v + INTEGER).bitcast()];
    let (xw, y) = u.narrow(v).interleave(w.narrow(f64x8::splat(simd, 0.0)).bitcast::<i32x16<S>>());
    let (first, last) = xw.interleave(y);
    let (low, high) = corners.as_flattened_mut().split_at_mut(2 * GROUP);
    first.store_slice(low);
    last.store_slice(high);
}

/// Where the picture of a box lies, and its 1/z.
pub(crate) struct Extent {
    pub(crate) x: [f64; 2],
    pub(crate) y: [f64; 2],
    pub(crate) w: [f32; 2],
}

/// The least and the greatest.
#[inline(always)]
fn range(values: [f64; 8]) -> [f64; 2] {
    let (mut low, mut high) = (values, values);
    for half in [4, 2, 1] {
        for k in 0..half {
            low[k] = less(low[k], low[k + half]);
            high[k] = more(high[k], high[k + half]);
        }
    }
    [low[0], high[0]]
}

/// The lesser of two numbers, in one instruction.
#[inline(always)]
fn less(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The greater of two numbers, in one instruction.
#[inline(always)]
fn more(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[inline(always)]
fn times(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let [p, q, r, s] = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]];
    [less(less(p, q), less(r, s)), more(more(p, q), more(r, s))]
}

#[inline(always)]
fn square([low, high]: [f64; 2]) -> [f64; 2] {
    let (a, b) = (low * low, high * high);
    [if low * high > 0.0 { less(a, b) } else { 0.0 }, more(a, b)]
}

/// 1.5·2⁵²: added to a number, it leaves the nearest integer in the low mantissa bits, for |x| < 2³¹.
const INTEGER: f64 = 6_755_399_441_055_744.0;

fn snap(x: f64) -> i32 {
    (x + INTEGER).to_bits() as i32
}
