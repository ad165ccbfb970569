//! Two cameras: what a pixel in one says about its counterpart in the other (Hartley & Zisserman 2004, chapter 9).
//!
//! For the same world point at x in the first and x′ in the second camera, `x′ᵀ E x = 0` in normalized and `u′ᵀ F u = 0` in
//! undistorted pixel coordinates.

use crate::View;
use nalgebra::{Matrix3, Point2, Vector3};
use texreg_lie::{Pose, so3};

/// `E = [t]× R` of the motion from the first camera's frame to the second's.
pub fn essential(second_from_first: &Pose) -> Matrix3<f64> {
    so3::hat(&second_from_first.translation) * second_from_first.rotation.matrix()
}

/// `F = K′⁻ᵀ E K⁻¹`, of unit Frobenius norm. `None` if the cameras stand at one place or have no focal length.
pub fn fundamental(first: &View, second: &View) -> Option<Matrix3<f64>> {
    let motion = second.pose * first.pose.inverse();
    let inverse = |view: &View| view.camera.intrinsics.matrix().try_inverse();
    let f = inverse(second)?.transpose() * essential(&motion) * inverse(first)?;
    let norm = f.norm();
    (norm > 0.0 && norm.is_finite()).then(|| f / norm)
}

/// The line `a u + b v + c = 0` in the second image, a² + b² = 1, on which the counterpart of a pixel of the first lies.
/// `None` for the epipole, whose counterpart may be anywhere.
pub fn epipolar_line(fundamental: &Matrix3<f64>, pixel: &Point2<f64>) -> Option<Vector3<f64>> {
    let line = fundamental * pixel.coords.push(1.0);
    let length = line.x.hypot(line.y);
    (length > 0.0 && line.iter().all(|x| x.is_finite())).then(|| line / length)
}

/// The distance, in pixels, of a pixel of the second image from the epipolar line of one of the first; signed by side.
pub fn epipolar_distance(fundamental: &Matrix3<f64>, first: &Point2<f64>, second: &Point2<f64>) -> Option<f64> {
    Some(epipolar_line(fundamental, first)?.dot(&second.coords.push(1.0)))
}

/// Sampson's distance: the first-order distance, in pixels, of the pair to the nearest pair that satisfies
/// `u′ᵀ F u = 0` exactly.
pub fn sampson_distance(fundamental: &Matrix3<f64>, first: &Point2<f64>, second: &Point2<f64>) -> Option<f64> {
    let (u, v) = (first.coords.push(1.0), second.coords.push(1.0));
    let (line, back) = (fundamental * u, fundamental.tr_mul(&v));
    let slope = line.xy().norm_squared() + back.xy().norm_squared();
    let distance = v.dot(&line) / slope.sqrt();
    distance.is_finite().then_some(distance)
}
