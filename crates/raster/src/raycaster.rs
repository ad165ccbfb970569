//! The surface point behind a pixel, found again from the face it belongs to.

use crate::triangles::Triangles;
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};
use texreg_camera::Camera;
use texreg_lie::Pose;

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
        // T. Möller and B. Trumbore, Fast, minimum storage ray/triangle intersection, J. Graphics Tools 1997.
        let ray = self.ray(pixel)?;
        let [a, b, c] = mesh.corners(face)?.map(|p| Vector3::from(p.map(f64::from)));
        let (ab, ac, from_a) = (b - a, c - a, self.centre - a);
        let p = ray.cross(&ac);
        let determinant = ab.dot(&p);
        let v = from_a.dot(&p) / determinant;
        let w = ray.dot(&from_a.cross(&ab)) / determinant;
        if !(v.is_finite() && w.is_finite()) {
            return None;
        }
        let (v, w) = (v.max(0.0), w.max(0.0));
        let scale = 1.0 / (v + w).max(1.0);
        Some([(v * scale) as f32, (w * scale) as f32])
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
