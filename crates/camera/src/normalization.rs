//! Hartley's normalization: similarities that make linear estimation from homogeneous coordinates well conditioned
//! (R. Hartley, *In Defense of the Eight-Point Algorithm*, 1997).

use nalgebra::{Matrix3, Matrix4, Point2, Point3, Vector2, Vector3};

/// The similarity that takes the points' centroid to the origin and their root mean square distance from it to √2. The
/// identity if they coincide or are not finite.
pub fn normalize_plane(points: &[Point2<f64>]) -> Matrix3<f64> {
    let count = points.len() as f64;
    let mean = points.iter().fold(Vector2::zeros(), |sum, p| sum + p.coords) / count;
    let spread = points.iter().map(|p| (p.coords - mean).norm_squared()).sum::<f64>() / count;
    let scale = (2.0 / spread).sqrt();
    if !scale.is_finite() {
        return Matrix3::identity();
    }
    Matrix3::new(scale, 0.0, -scale * mean.x, 0.0, scale, -scale * mean.y, 0.0, 0.0, 1.0)
}

/// The same in space, to the distance √3.
pub fn normalize_space(points: &[Point3<f64>]) -> Matrix4<f64> {
    let count = points.len() as f64;
    let mean = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / count;
    let spread = points.iter().map(|p| (p.coords - mean).norm_squared()).sum::<f64>() / count;
    let scale = (3.0 / spread).sqrt();
    if !scale.is_finite() {
        return Matrix4::identity();
    }
    Matrix4::new_translation(&(-mean)).append_scaling(scale)
}
