//! The Lie algebra around the current point (C. J. Taylor & D. J. Kriegman, *Minimization on the Lie Group SO(3) and
//! Related Manifolds*, 1994): the workspace's default.

use crate::chart::short;
use crate::{Chart, Pose, se3, so3};
use nalgebra::{DMatrix, Rotation3, Vector6};
use std::f64::consts::PI;

/// `R' = exp(ω) R`; for poses the step is (ω, t) and `pose' = exp(ω, t) · pose`. One to one for ‖ω‖ < π, its radius; its
/// derivative is the identity, and nowhere singular.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Left;

impl Chart<Rotation3<f64>> for Left {
    fn dimension(&self) -> usize {
        3
    }

    fn retract(&self, at: &Rotation3<f64>, step: &[f64]) -> Option<Rotation3<f64>> {
        Some(so3::exp(&short::<3>(step, PI)?.into()) * at)
    }

    fn derivative(&self, _: &Rotation3<f64>) -> DMatrix<f64> {
        DMatrix::identity(3, 3)
    }

    fn radius(&self) -> f64 {
        PI
    }
}

impl Chart<Pose> for Left {
    fn dimension(&self) -> usize {
        6
    }

    fn retract(&self, at: &Pose, step: &[f64]) -> Option<Pose> {
        short::<3>(step.get(..3)?, PI)?;
        let tangent: [f64; 6] = step.try_into().ok()?;
        let pose = se3::exp(&Vector6::from(tangent)) * *at;
        pose.is_finite().then_some(pose)
    }

    fn derivative(&self, _: &Pose) -> DMatrix<f64> {
        DMatrix::identity(6, 6)
    }

    fn radius(&self) -> f64 {
        PI
    }
}
