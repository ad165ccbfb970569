//! SO(3), the rotations of space. Barfoot 2017, section 7.1.
//!
//! | | |
//! | --- | --- |
//! | tangent | ω ∈ R³, radians, [`exp`] maps ‖ω‖ < π one to one |
//! | point | `Rotation3<f64>` |
//! | action | `R x` |

use crate::coefficients::{inverse, sinc, third, versine};
use nalgebra::{Matrix3, Quaternion, Rotation3, Vector3};

/// The cross product as a matrix: `hat(a) b = a × b`.
pub fn hat(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// The vector of a matrix's skew-symmetric part: `vee(hat(a)) = a`.
pub fn vee(m: &Matrix3<f64>) -> Vector3<f64> {
    Vector3::new(m.m32 - m.m23, m.m13 - m.m31, m.m21 - m.m12) * 0.5
}

/// `I + a [ω]× + b [ω]×²`, the shape of the exponential and its Jacobians.
fn quadratic(omega: &Vector3<f64>, a: f64, b: f64) -> Matrix3<f64> {
    let square = omega * omega.transpose() - Matrix3::from_diagonal_element(omega.norm_squared());
    Matrix3::identity() + hat(omega) * a + square * b
}

/// The rotation by ‖ω‖ radians about ω (Rodrigues' formula).
pub fn exp(omega: &Vector3<f64>) -> Rotation3<f64> {
    let theta = omega.norm();
    Rotation3::from_matrix_unchecked(quadratic(omega, sinc(theta), versine(theta)))
}

/// The shortest rotation vector of a rotation, ‖ω‖ ≤ π. At exactly π one of the two opposite vectors is returned.
///
/// Goes through the unit quaternion, which keeps all digits near 0 and near π, where arccos of the trace keeps half.
pub fn log(rotation: &Rotation3<f64>) -> Vector3<f64> {
    let q = quaternion(rotation);
    let (v, w) = if q.w < 0.0 { (-q.imag(), -q.w) } else { (q.imag(), q.w) };
    let s = v.norm();
    v * if s < f64::MIN_POSITIVE { 2.0 / w } else { 2.0 * s.atan2(w) / s }
}

/// The unit quaternion of a rotation, by the largest of its four components (Shepperd 1978).
pub fn quaternion(rotation: &Rotation3<f64>) -> Quaternion<f64> {
    let m = rotation.matrix();
    let skew = vee(m) * 2.0;
    let t = m.trace();
    let (w, x, y, z) = if t >= m.m11.max(m.m22).max(m.m33) {
        (1.0 + t, skew.x, skew.y, skew.z)
    } else if m.m11 >= m.m22.max(m.m33) {
        (skew.x, 1.0 + m.m11 - m.m22 - m.m33, m.m12 + m.m21, m.m13 + m.m31)
    } else if m.m22 >= m.m33 {
        (skew.y, m.m12 + m.m21, 1.0 - m.m11 + m.m22 - m.m33, m.m23 + m.m32)
    } else {
        (skew.z, m.m13 + m.m31, m.m23 + m.m32, 1.0 - m.m11 - m.m22 + m.m33)
    };
    Quaternion::new(w, x, y, z).normalize()
}

/// The left Jacobian `J`: `exp(ω + δ) = exp(J δ) exp(ω)` to first order.
pub fn left_jacobian(omega: &Vector3<f64>) -> Matrix3<f64> {
    let theta = omega.norm();
    quadratic(omega, versine(theta), third(theta))
}

/// ∂R/∂ω₁, ∂R/∂ω₂, ∂R/∂ω₃ of `R = exp(ω)`: `hat(J eₖ) R` with J the left Jacobian.
pub fn exp_derivatives(omega: &Vector3<f64>) -> [Matrix3<f64>; 3] {
    let (rotation, jacobian) = (exp(omega), left_jacobian(omega));
    [0, 1, 2].map(|k| hat(&jacobian.column(k).into_owned()) * rotation.matrix())
}

/// The inverse of [`left_jacobian`]; singular at ‖ω‖ = 2π.
pub fn left_jacobian_inverse(omega: &Vector3<f64>) -> Matrix3<f64> {
    quadratic(omega, -0.5, inverse(omega.norm()))
}

/// The right Jacobian `J`: `exp(ω + δ) = exp(ω) exp(J δ)` to first order.
pub fn right_jacobian(omega: &Vector3<f64>) -> Matrix3<f64> {
    left_jacobian(&-omega)
}

/// The inverse of [`right_jacobian`]; singular at ‖ω‖ = 2π.
pub fn right_jacobian_inverse(omega: &Vector3<f64>) -> Matrix3<f64> {
    left_jacobian_inverse(&-omega)
}

/// The adjoint: `R exp(ω) R⁻¹ = exp(Ad ω)`. For rotations it is the matrix itself.
pub fn adjoint(rotation: &Rotation3<f64>) -> Matrix3<f64> {
    *rotation.matrix()
}

/// The point a fraction `s` along the shortest way from `a` (s = 0) to `b` (s = 1).
pub fn interpolate(a: &Rotation3<f64>, b: &Rotation3<f64>, s: f64) -> Rotation3<f64> {
    exp(&(log(&(b * a.inverse())) * s)) * a
}

/// The rotation nearest to a matrix in the Frobenius norm (Kabsch 1976; Umeyama 1991), `None` if the matrix is not
/// finite or so near rank one that the answer is arbitrary.
pub fn nearest(matrix: &Matrix3<f64>) -> Option<Rotation3<f64>> {
    if !matrix.iter().all(|x| x.is_finite()) {
        return None;
    }
    let svd = matrix.svd(true, true);
    let (u, v_t, s) = (svd.u?, svd.v_t?, svd.singular_values);
    let d = (u.determinant() * v_t.determinant()).signum();
    let smallest = s.imin();
    // Unique as long as the sum of the two smallest singular values, signed, is not zero.
    let others = s.sum() - s.max() - s[smallest];
    if others + d * s[smallest] <= s.max() * 1e-12 {
        return None;
    }
    let mut signs = Vector3::repeat(1.0);
    signs[smallest] = d;
    Some(Rotation3::from_matrix_unchecked(u * Matrix3::from_diagonal(&signs) * v_t))
}
