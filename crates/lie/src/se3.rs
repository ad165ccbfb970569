//! SE(3), the rigid motions of space. Barfoot 2017, section 7.1, with the tangent in the order (ω, t).
//!
//! | | |
//! | --- | --- |
//! | tangent | (ω, t) ∈ R⁶, radians and model units, [`exp`] maps ‖ω‖ < π one to one |
//! | point | [`Pose`] |
//! | action | `R x + T` |

use crate::coefficients::{fifth, fourth, third};
use crate::{Pose, so3};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

fn split(tangent: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (tangent.fixed_rows::<3>(0).into_owned(), tangent.fixed_rows::<3>(3).into_owned())
}

fn blocks(upper_left: &Matrix3<f64>, lower_left: &Matrix3<f64>, lower_right: &Matrix3<f64>) -> Matrix6<f64> {
    let mut m = Matrix6::zeros();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(upper_left);
    m.fixed_view_mut::<3, 3>(3, 0).copy_from(lower_left);
    m.fixed_view_mut::<3, 3>(3, 3).copy_from(lower_right);
    m
}

/// The screw motion with rotation `exp(ω)` and translation `J(ω) t`, J the left Jacobian of SO(3).
pub fn exp(tangent: &Vector6<f64>) -> Pose {
    let (omega, t) = split(tangent);
    Pose::new(so3::exp(&omega), so3::left_jacobian(&omega) * t)
}

/// The shortest tangent of a pose, ‖ω‖ ≤ π.
pub fn log(pose: &Pose) -> Vector6<f64> {
    let omega = so3::log(&pose.rotation);
    let t = so3::left_jacobian_inverse(&omega) * pose.translation;
    Vector6::new(omega.x, omega.y, omega.z, t.x, t.y, t.z)
}

/// The left Jacobian `J`: `exp(ξ + δ) = exp(J δ) exp(ξ)` to first order.
pub fn left_jacobian(tangent: &Vector6<f64>) -> Matrix6<f64> {
    let (omega, t) = split(tangent);
    let j = so3::left_jacobian(&omega);
    blocks(&j, &coupling(&omega, &t), &j)
}

/// The inverse of [`left_jacobian`]; singular at ‖ω‖ = 2π.
pub fn left_jacobian_inverse(tangent: &Vector6<f64>) -> Matrix6<f64> {
    let (omega, t) = split(tangent);
    let inverse = so3::left_jacobian_inverse(&omega);
    blocks(&inverse, &(-inverse * coupling(&omega, &t) * inverse), &inverse)
}

/// The right Jacobian `J`: `exp(ξ + δ) = exp(ξ) exp(J δ)` to first order.
pub fn right_jacobian(tangent: &Vector6<f64>) -> Matrix6<f64> {
    left_jacobian(&-tangent)
}

/// The inverse of [`right_jacobian`]; singular at ‖ω‖ = 2π.
pub fn right_jacobian_inverse(tangent: &Vector6<f64>) -> Matrix6<f64> {
    left_jacobian_inverse(&-tangent)
}

/// The adjoint: `pose · exp(ξ) · pose⁻¹ = exp(Ad ξ)`.
pub fn adjoint(pose: &Pose) -> Matrix6<f64> {
    let r = pose.rotation.matrix();
    blocks(r, &(so3::hat(&pose.translation) * r), r)
}

/// The point a fraction `s` along the screw from `a` (s = 0) to `b` (s = 1).
pub fn interpolate(a: &Pose, b: &Pose, s: f64) -> Pose {
    exp(&(log(&(*b * a.inverse())) * s)) * *a
}

/// The lower left block Q of the left Jacobian, Barfoot's equation (7.86), φ = ω and ρ = t there.
fn coupling(omega: &Vector3<f64>, t: &Vector3<f64>) -> Matrix3<f64> {
    let theta = omega.norm();
    let (p, r) = (so3::hat(omega), so3::hat(t));
    let (pr, rp) = (p * r, r * p);
    let prp = pr * p;
    r * 0.5
        + (pr + rp + prp) * third(theta)
        + (p * pr + rp * p - prp * 3.0) * fourth(theta)
        + (prp * p + p * prp) * fifth(theta)
}
