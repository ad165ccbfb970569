//! The camera of the BAL problems (S. Agarwal, N. Snavely, S. Seitz, R. Szeliski, *Bundle adjustment in the large*, ECCV
//! 2010): it looks along −z with y up, and pixels are measured from the principal point.
//!
//! ```text
//! P = R X + t,   p = −(P_x, P_y)/P_z,   pixel = f (1 + k₁ ‖p‖² + k₂ ‖p‖⁴) p
//! ```

use crate::ReprojectionError;
use nalgebra::{Matrix2x3, Point3, Rotation3, SMatrix, SVector, Vector2, Vector3};
use texreg_lie::{Pose, so3};

/// A camera of nine parameters: rotation, translation, focal length and two coefficients of radial distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SnavelyCamera {
    /// From the world to the camera: x right, y up, z backward.
    pub pose: Pose,
    /// f, pixels.
    pub focal: f64,
    /// k₁.
    pub k1: f64,
    /// k₂.
    pub k2: f64,
}

/// The nine parameters by their places in a step: ω of `exp(ω) R`, t of `T + t`, and f, k₁, k₂.
pub const ROTATION: std::ops::Range<usize> = 0..3;
/// The translation's places.
pub const TRANSLATION: std::ops::Range<usize> = 3..6;
/// The intrinsics' places.
pub const INTRINSICS: std::ops::Range<usize> = 6..9;

/// How far a [`SnavelyCamera`] sees a point from its pixel. A point behind the camera has its mirrored pixel, as in the
/// problems' definition; one in the plane of its centre has none.
#[derive(Clone, Copy, Debug, Default)]
pub struct Snavely;

/// The shared part: the turned point, p, 1/z, ‖p‖² and the distortion.
struct Seen {
    turned: Vector3<f64>,
    p: Vector2<f64>,
    inverse_depth: f64,
    square: f64,
    distortion: f64,
}

impl SnavelyCamera {
    #[inline]
    fn see(&self, point: &Point3<f64>) -> Seen {
        let turned = self.pose.rotation * point.coords;
        let in_camera = turned + self.pose.translation;
        let inverse_depth = 1.0 / in_camera.z;
        let p = -in_camera.xy() * inverse_depth;
        let square = p.norm_squared();
        Seen { turned, p, inverse_depth, square, distortion: 1.0 + square * (self.k1 + square * self.k2) }
    }

    /// The pixel of a point; `None` in the plane of the camera's centre.
    #[inline]
    pub fn project(&self, point: &Point3<f64>) -> Option<Vector2<f64>> {
        let seen = self.see(point);
        Some(seen.p * (self.focal * seen.distortion)).filter(|pixel| pixel.x.is_finite() && pixel.y.is_finite())
    }
}

impl ReprojectionError<9> for Snavely {
    type Camera = SnavelyCamera;

    #[inline]
    fn residual(&self, camera: &SnavelyCamera, point: &Point3<f64>, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        Some(camera.project(point)? - pixel)
    }

    #[inline]
    fn linearize(
        &self,
        camera: &SnavelyCamera,
        point: &Point3<f64>,
        pixel: &Vector2<f64>,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, 9>, Matrix2x3<f64>)> {
        let Seen { turned, p, inverse_depth, square, distortion } = camera.see(point);
        let residual = p * (camera.focal * distortion) - pixel;
        if !(residual.x.is_finite() && residual.y.is_finite()) {
            return None;
        }
        // The distortion's slope by ‖p‖², and the pixel's by p.
        let slope = camera.k1 + 2.0 * square * camera.k2;
        let mixed = 2.0 * p.x * p.y * slope;
        let by_p = [[distortion + 2.0 * p.x * p.x * slope, mixed], [mixed, distortion + 2.0 * p.y * p.y * slope]];
        let mut by_camera = SMatrix::<f64, 2, 9>::zeros();
        let mut by_point = Matrix2x3::zeros();
        for (row, [a, b]) in by_p.into_iter().enumerate() {
            let g = Vector3::new(a, b, a * p.x + b * p.y) * (-inverse_depth * camera.focal);
            let turn = turned.cross(&g);
            let point = camera.pose.rotation.matrix().tr_mul(&g);
            for k in 0..3 {
                by_camera[(row, k)] = turn[k];
                by_camera[(row, 3 + k)] = g[k];
                by_point[(row, k)] = point[k];
            }
            by_camera[(row, 6)] = distortion * p[row];
            by_camera[(row, 7)] = camera.focal * square * p[row];
            by_camera[(row, 8)] = camera.focal * square * square * p[row];
        }
        Some((residual, by_camera, by_point))
    }

    fn retract(&self, camera: &SnavelyCamera, step: &SVector<f64, 9>) -> SnavelyCamera {
        let (omega, shift) = (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned());
        SnavelyCamera {
            pose: Pose::new(so3::exp(&omega) * camera.pose.rotation, camera.pose.translation + shift),
            focal: camera.focal + step[6],
            k1: camera.k1 + step[7],
            k2: camera.k2 + step[8],
        }
    }
}

impl SnavelyCamera {
    /// The nine numbers of the files: rotation vector, translation, f, k₁, k₂.
    pub fn to_array(&self) -> [f64; 9] {
        let (omega, t) = (so3::log(&self.pose.rotation), self.pose.translation);
        [omega.x, omega.y, omega.z, t.x, t.y, t.z, self.focal, self.k1, self.k2]
    }

    /// The inverse of [`to_array`](Self::to_array).
    pub fn from_array(numbers: [f64; 9]) -> Self {
        let [a, b, c, x, y, z, focal, k1, k2] = numbers;
        let rotation: Rotation3<f64> = so3::exp(&Vector3::new(a, b, c));
        Self { pose: Pose::new(rotation, Vector3::new(x, y, z)), focal, k1, k2 }
    }
}
