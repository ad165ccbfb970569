//! Rotations as files state them, checked before they are believed.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion};
use texreg_lie::so3;

/// How far any entry of `R Rᵀ` may be from the identity before `R` is refused as a rotation.
const TOLERANCE: f64 = 1e-3;

/// How far a quaternion's norm may be from 1.
const NORM_TOLERANCE: f64 = 1e-2;

/// Half a turn about the x axis: between cameras that look along −z with y up (OpenGL) and ours.
pub(crate) const FLIP: Matrix3<f64> = Matrix3::new(1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0);

/// The nearest rotation to a matrix that is close to one, or what is wrong with it.
pub(crate) fn checked_rotation(r: &Matrix3<f64>) -> Result<Rotation3<f64>, &'static str> {
    let off = (r * r.transpose() - Matrix3::identity()).amax();
    if off > TOLERANCE || off.is_nan() {
        return Err("is not a rotation: its rows are not perpendicular and of length 1");
    }
    if r.determinant() < 0.0 {
        return Err("mirrors (determinant -1): the camera's axes must be right-handed");
    }
    so3::nearest(r).ok_or("is not a rotation")
}

/// The rotation of a quaternion `[w, x, y, z]` of about unit norm.
pub(crate) fn from_quaternion([w, x, y, z]: [f64; 4]) -> Result<Rotation3<f64>, &'static str> {
    let q = Quaternion::new(w, x, y, z);
    match q.norm() {
        norm if norm < 1e-12 => Err("is a quaternion of norm zero, which is no rotation"),
        norm if (norm - 1.0).abs() <= NORM_TOLERANCE => Ok(UnitQuaternion::from_quaternion(q).to_rotation_matrix()),
        _ => Err("is a quaternion whose norm is not 1"),
    }
}

/// The quaternion `[w, x, y, z]` of a rotation, with `w ≥ 0`.
pub(crate) fn to_quaternion(rotation: &Rotation3<f64>) -> [f64; 4] {
    let q = UnitQuaternion::from_rotation_matrix(rotation).into_inner();
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [q.w, q.i, q.j, q.k].map(|c| sign * c)
}
