//! The rotation vector as a global parameter, rescaled as it grows (F. S. Grassia, *Practical Parameterization of
//! Rotations Using the Exponential Map*, 1998).

use crate::chart::short;
use crate::{Chart, so3};
use nalgebra::{DMatrix, Rotation3, Vector3};
use std::f64::consts::PI;

/// `R' = exp(ω + δ)` with ω the rotation vector of R. Its derivative is the left Jacobian of SO(3) at ω, singular only at
/// ‖ω‖ = 2π. As ω is kept to ‖ω‖ ≤ π by [`AxisAngle::rescaled`], steps shorter than π never get there.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AxisAngle;

impl AxisAngle {
    /// The same rotation by at most half a turn: `ω (1 − 2π/‖ω‖)` for ‖ω‖ in (π, 2π], ω itself below.
    pub fn rescaled(omega: &Vector3<f64>) -> Vector3<f64> {
        let theta = omega.norm();
        if theta > PI { omega * (1.0 - 2.0 * PI / theta) } else { *omega }
    }
}

impl Chart<Rotation3<f64>> for AxisAngle {
    fn dimension(&self) -> usize {
        3
    }

    fn retract(&self, at: &Rotation3<f64>, step: &[f64]) -> Option<Rotation3<f64>> {
        let step = Vector3::from(short::<3>(step, PI)?);
        Some(so3::exp(&Self::rescaled(&(so3::log(at) + step))))
    }

    fn derivative(&self, at: &Rotation3<f64>) -> DMatrix<f64> {
        DMatrix::from_column_slice(3, 3, so3::left_jacobian(&so3::log(at)).as_slice())
    }

    fn radius(&self) -> f64 {
        PI
    }
}
