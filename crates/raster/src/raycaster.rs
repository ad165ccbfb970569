//! The surface point behind a pixel, found again from the face it belongs to.

use crate::gbuffer::NO_FACE;
use crate::three::each;
use crate::triangles::Triangles;

use fearless_simd::{Level, dispatch};
use nalgebra::{Matrix2, Matrix3, Point2, Point3, Vector2, Vector3};
use texreg_camera::Camera;
use texreg_lie::Pose;

/// Pixels intersected together.
const LANES: usize = 8;

/// Steps of Newton's method for pixels that are inverted together.
const STEPS: usize = 3;

/// A squared error in normalized coordinates that the next step of Newton's method takes to the last digits.
const CLOSE: f64 = 1e-15;

/// Intersects the rays through pixels with triangles that are known to be there, in f64.
///
/// Rays follow the camera's distortion exactly, so weights found here carry none of the rasterizer's snapping.
#[derive(Clone, Debug)]
pub struct Raycaster {
    camera: Camera,
    /// The camera centre in the mesh frame.
    centre: Vector3<f64>,
    mesh_from_camera: Matrix3<f64>,
    /// Pixel (u, v, 1) to the ray (x, y, 1) where there is no distortion, in the mesh frame.
    mesh_from_pixel: Option<Matrix3<f64>>,
    last: Inverted,
    /// The squared radius up to which the distortion is one to one.
    domain: f64,
}

/// A distorted normalized point that was inverted, its inverse, and how that follows it: a start for the next.
#[derive(Clone, Copy, Debug)]
struct Inverted {
    distorted: Vector2<f64>,
    point: Vector2<f64>,
    slope: Matrix2<f64>,
}

impl Default for Inverted {
    fn default() -> Self {
        Self { distorted: Vector2::zeros(), point: Vector2::zeros(), slope: Matrix2::identity() }
    }
}

impl Raycaster {
    /// A raycaster for the camera and pose of a rendering.
    pub fn new(camera: &Camera, camera_from_mesh: &Pose) -> Self {
        let Pose { rotation, translation } = camera_from_mesh.inverse();
        let mesh_from_camera = rotation.into_inner();
        let camera_from_pixel = camera.intrinsics.matrix().try_inverse().filter(|_| camera.distortion.is_none());
        Self {
            camera: *camera,
            centre: translation,
            mesh_from_camera,
            mesh_from_pixel: camera_from_pixel.map(|m| mesh_from_camera * m),
            last: Inverted::default(),
            domain: camera.distortion.domain(),
        }
    }

    /// The weights of the second and third corner of `face` at pixel coordinates, moved into the triangle where the ray
    /// misses it by a rounding error. `None` if the face does not exist, is seen edge-on, or the pixel has no ray.
    pub fn barycentric(&mut self, mesh: &Triangles, face: u32, pixel: Point2<f64>) -> Option<[f32; 2]> {
        let ray = self.ray(pixel)?;
        let weights = weights(self.centre.into(), ray.into(), mesh.corners(face)?);
        weights.iter().all(|w| w.is_finite()).then_some(weights)
    }

    /// [`barycentric`](Self::barycentric) of many pixels and the faces they see, NaN where that is `None`: quicker, where each pixel
    /// is near the one before.
    pub fn barycentrics(&mut self, mesh: &Triangles, pixels: &[(u32, Point2<f64>)]) -> Vec<[f32; 2]> {
        let mut found = vec![[f32::NAN; 2]; pixels.len()];
        let places = pixels.iter().enumerate().map(|(i, &(face, pixel))| (i, face, pixel));
        dispatch!(Level::new(), _simd => self.each(mesh, places, &mut found));
        found
    }

    /// [`barycentric`](Self::barycentric) of the pixels of a row that see a face, `[0, 0]` where there is none.
    #[inline(always)]
    pub(crate) fn row(&mut self, mesh: &Triangles, y: f64, faces: &[u32], barycentric: &mut [[f32; 2]]) {
        barycentric.fill([0.0; 2]);
        // Rows are shared out among threads: none depends on another.
        self.last = Inverted::default();
        let seen = faces.iter().enumerate().filter(|&(_, &face)| face != NO_FACE);
        self.each(mesh, seen.map(|(x, &face)| (x, face, Point2::new(x as f64, y))), barycentric);
    }

    /// Puts the weights of pixels into their places; what has none keeps what is there.
    #[inline(always)]
    fn each(
        &mut self,
        mesh: &Triangles,
        mut pixels: impl Iterator<Item = (usize, u32, Point2<f64>)>,
        found: &mut [[f32; 2]],
    ) {
        loop {
            let (mut count, mut places) = (0, [0; LANES]);
            // Coordinate by coordinate, as vectors want them.
            let (mut at, mut corners) = ([[0.0; LANES]; 2], [[[0.0; LANES]; 3]; 3]);
            for (place, face, pixel) in pixels.by_ref() {
                if let Some(triangle) = mesh.corners(face) {
                    places[count] = place;
                    (at[0][count], at[1][count]) = (pixel.x, pixel.y);
                    for k in 0..3 {
                        for (corner, position) in corners.iter_mut().zip(triangle) {
                            corner[k][count] = position[k];
                        }
                    }
                    count += 1;
                }
                if count == LANES {
                    break;
                }
            }
            let rays = self.ray_lanes(&at, count);
            let centre = self.centre.into();
            let mut lanes = [[0.0; LANES]; 2];
            for lane in 0..LANES {
                let at = |v: &[[f64; LANES]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                let corner = |v: &[[f32; LANES]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                let triangle = [corner(&corners[0]), corner(&corners[1]), corner(&corners[2])];
                [lanes[0][lane], lanes[1][lane]] = weights(centre, at(&rays), triangle);
            }
            for (lane, &place) in places[..count].iter().enumerate() {
                if lanes[0][lane].is_finite() && lanes[1][lane].is_finite() {
                    found[place] = [lanes[0][lane], lanes[1][lane]];
                }
            }
            if count < LANES {
                break;
            }
        }
    }

    /// [`ray`](Self::ray) of the first `count` of some pixels, NaN where there is none.
    #[inline(always)]
    fn ray_lanes(&mut self, pixels: &[[f64; LANES]; 2], count: usize) -> [[f64; LANES]; 3] {
        let mut rays = [[0.0; LANES]; 3];
        if let Some(matrix) = &self.mesh_from_pixel {
            for lane in 0..LANES {
                let ray = matrix * Vector3::new(pixels[0][lane], pixels[1][lane], 1.0);
                (0..3).for_each(|k| rays[k][lane] = ray[k]);
            }
            return rays;
        }
        let (k, last) = (&self.camera.intrinsics, self.last);
        let (across, down) = (1.0 / k.fx, 1.0 / k.fy);
        let (mut points, mut found) = ([[0.0; LANES]; 2], [false; LANES]);
        for lane in 0..LANES {
            let y = (pixels[1][lane] - k.cy) * down;
            let target = Vector2::new((pixels[0][lane] - k.cx - k.skew * y) * across, y);
            let mut p = last.point + last.slope * (target - last.distorted);
            // Newton's method from the last point, which is mostly near: each step squares the error.
            for _ in 0..STEPS {
                let (value, slope) = self.camera.distortion.evaluate(&p);
                let (error, determinant) = (target - value, slope.m11 * slope.m22 - slope.m12 * slope.m21);
                let inverse = 1.0 / determinant;
                p.x += inverse * (slope.m22 * error.x - slope.m12 * error.y);
                p.y += inverse * (slope.m11 * error.y - slope.m21 * error.x);
                let is_inside = (p.norm_squared() < self.domain) & (determinant > 0.0);
                found[lane] = is_inside & (error.norm_squared() < CLOSE);
            }
            (points[0][lane], points[1][lane]) = (p.x, p.y);
        }
        for lane in 0..LANES {
            let ray = self.mesh_from_camera * Vector3::new(points[0][lane], points[1][lane], 1.0);
            (0..3).for_each(|k| rays[k][lane] = ray[k]);
        }
        for lane in (0..count).filter(|&lane| !found[lane]) {
            let ray = self.ray(Point2::new(pixels[0][lane], pixels[1][lane]));
            (0..3).for_each(|k| rays[k][lane] = ray.map_or(f64::NAN, |ray| ray[k]));
        }
        if let Some(lane) = found[..count].iter().rposition(|&found| found) {
            let point = Vector2::new(points[0][lane], points[1][lane]);
            let (distorted, slope) = self.camera.distortion.evaluate(&point);
            self.last = Inverted { distorted, point, slope: slope.try_inverse().unwrap_or_else(Matrix2::identity) };
        }
        rays
    }

    /// The directions from the camera's centre in which pixels look, in the mesh frame: one unit deep, NaN where there is none.
    /// Quicker, where each pixel is near the one before.
    pub fn rays(&mut self, pixels: &[Point2<f64>]) -> Vec<Vector3<f64>> {
        let mut rays = Vec::with_capacity(pixels.len());
        dispatch!(Level::new(), _simd => {
            for pixels in pixels.chunks(LANES) {
                let mut at = [[0.0; LANES]; 2];
                for (lane, pixel) in pixels.iter().enumerate() {
                    (at[0][lane], at[1][lane]) = (pixel.x, pixel.y);
                }
                let [x, y, z] = self.ray_lanes(&at, pixels.len());
                rays.extend((0..pixels.len()).map(|lane| Vector3::new(x[lane], y[lane], z[lane])));
            }
        });
        rays
    }

    /// The surface point of `face` at pixel coordinates, mesh frame.
    pub fn point(&mut self, mesh: &Triangles, face: u32, pixel: Point2<f64>) -> Option<Point3<f64>> {
        let [v, w] = self.barycentric(mesh, face, pixel)?.map(f64::from);
        let [a, b, c] = mesh.corners(face)?.map(|p| Vector3::from(p.map(f64::from)));
        Some(Point3::from(a * (1.0 - v - w) + b * v + c * w))
    }

    /// The direction in the mesh frame in which a pixel looks.
    fn ray(&mut self, pixel: Point2<f64>) -> Option<Vector3<f64>> {
        match &self.mesh_from_pixel {
            Some(matrix) => Some(matrix * pixel.coords.push(1.0)),
            None => Some(self.mesh_from_camera * self.undistorted(pixel)?),
        }
    }

    /// The direction (x, y, 1) of a pixel in the camera frame.
    fn undistorted(&mut self, pixel: Point2<f64>) -> Option<Vector3<f64>> {
        let distortion = &self.camera.distortion;
        let target = self.camera.intrinsics.invert(&pixel);
        // Neighbouring pixels are asked for in turn: Newton's method from the last one mostly needs one step.
        let mut p = self.last.point + self.last.slope * (target - self.last.distorted);
        for _ in 0..4 {
            let Some((value, slope)) = distortion.apply_with_jacobian(&p) else { break };
            let Some(slope) = slope.try_inverse() else { break };
            let error = target - value;
            p += slope * error;
            // Each step squares the error.
            if error.norm_squared() < CLOSE {
                self.last = Inverted { distorted: target, point: p, slope };
                return Some(p.push(1.0));
            }
        }
        self.camera.unproject(&pixel)
    }
}

/// The weights of the second and third corner where a ray meets a triangle, not finite where it is seen edge-on.
///
/// T. Möller and B. Trumbore, *Fast, minimum storage ray/triangle intersection*, J. Graphics Tools 1997.
#[inline(always)]
fn weights(centre: [f64; 3], ray: [f64; 3], [a, b, c]: [[f32; 3]; 3]) -> [f32; 2] {
    let [a, b, c] = each([a, b, c], |p| each(p, f64::from));
    let (ab, ac, from_a) = (minus(b, a), minus(c, a), minus(centre, a));
    let p = cross(ray, ac);
    let scale = 1.0 / dot(ab, p);
    let v = (dot(from_a, p) * scale).max(0.0);
    let w = (dot(ray, cross(from_a, ab)) * scale).max(0.0);
    let inside = 1.0 / (v + w).max(1.0);
    [(v * inside) as f32, (w * inside) as f32]
}

#[inline(always)]
fn minus(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
