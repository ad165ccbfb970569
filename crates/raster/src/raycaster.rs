//! The surface point behind a pixel, found again from the face it belongs to.

use crate::gbuffer::NO_FACE;
use crate::three::each;
use crate::triangles::Triangles;

use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};
use texreg_camera::Camera;
use texreg_lie::Pose;

/// Pixels intersected together.
const LANES: usize = 8;

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
    /// The last distorted normalized point that was inverted, and its inverse: a start for the next.
    last: (Vector2<f64>, Vector2<f64>),
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
            last: (Vector2::zeros(), Vector2::zeros()),
        }
    }

    /// The weights of the second and third corner of `face` at pixel coordinates, moved into the triangle where the ray
    /// misses it by a rounding error. `None` if the face does not exist, is seen edge-on, or the pixel has no ray.
    pub fn barycentric(&mut self, mesh: &Triangles, face: u32, pixel: Point2<f64>) -> Option<[f32; 2]> {
        let ray = self.ray(pixel)?;
        let weights = weights(self.centre.into(), ray.into(), mesh.corners(face)?);
        weights.iter().all(|w| w.is_finite()).then_some(weights)
    }

    /// [`barycentric`](Self::barycentric) of the pixels of a row that see a face, `[0, 0]` where there is none.
    #[inline(always)]
    pub(crate) fn row(&mut self, mesh: &Triangles, y: f64, faces: &[u32], barycentric: &mut [[f32; 2]]) {
        barycentric.fill([0.0; 2]);
        let mut seen = (0..faces.len()).filter(|&x| faces[x] != NO_FACE);
        loop {
            let (mut count, mut pixels) = (0, [0; LANES]);
            // Coordinate by coordinate, as vectors want them.
            let (mut rays, mut corners) = ([[0.0; LANES]; 3], [[[0.0; LANES]; 3]; 3]);
            for x in seen.by_ref() {
                if let (Some(ray), Some(triangle)) = (self.ray(Point2::new(x as f64, y)), mesh.corners(faces[x])) {
                    pixels[count] = x;
                    for k in 0..3 {
                        rays[k][count] = ray[k];
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
            let centre = self.centre.into();
            let mut found = [[0.0; LANES]; 2];
            for lane in 0..LANES {
                let at = |v: &[[f64; LANES]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                let corner = |v: &[[f32; LANES]; 3]| [v[0][lane], v[1][lane], v[2][lane]];
                let triangle = [corner(&corners[0]), corner(&corners[1]), corner(&corners[2])];
                [found[0][lane], found[1][lane]] = weights(centre, at(&rays), triangle);
            }
            for (lane, &x) in pixels[..count].iter().enumerate() {
                if found[0][lane].is_finite() && found[1][lane].is_finite() {
                    barycentric[x] = [found[0][lane], found[1][lane]];
                }
            }
            if count < LANES {
                break;
            }
        }
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
        // Neighbouring pixels are asked for in turn: Newton's method from the last one mostly needs two steps.
        let mut p = self.last.1 + (target - self.last.0);
        for _ in 0..4 {
            let Some((value, slope)) = distortion.apply_with_jacobian(&p) else { break };
            let error = target - value;
            if error.norm_squared() < 1e-22 {
                self.last = (target, p);
                return Some(p.push(1.0));
            }
            let Some(inverse) = slope.try_inverse() else { break };
            p += inverse * error;
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
