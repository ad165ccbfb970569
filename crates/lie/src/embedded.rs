//! Rotations embedded in a larger vector space, stepped there and projected back: quaternions in R⁴, matrices in R⁹.

use crate::chart::short;
use crate::{Chart, so3};
use nalgebra::{DMatrix, Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

/// `q' = (q + δ)/‖q + δ‖`, δ = (w, x, y, z). No singularities, but one component too many: along q itself a step does
/// nothing. Steps shorter than 1, its radius, cannot reach zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InQuaternions;

impl Chart<Rotation3<f64>> for InQuaternions {
    fn dimension(&self) -> usize {
        4
    }

    fn retract(&self, at: &Rotation3<f64>, step: &[f64]) -> Option<Rotation3<f64>> {
        let [w, x, y, z] = short(step, 1.0)?;
        let q = so3::quaternion(at) + Quaternion::new(w, x, y, z);
        Some(UnitQuaternion::from_quaternion(q).to_rotation_matrix())
    }

    /// `ω = 2 Im(δ q⁻¹)`.
    fn derivative(&self, at: &Rotation3<f64>) -> DMatrix<f64> {
        let inverse = so3::quaternion(at).conjugate();
        let units = [(1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)];
        let columns = units.map(|(w, x, y, z)| (Quaternion::new(w, x, y, z) * inverse).imag() * 2.0);
        DMatrix::from_fn(3, 4, |row, column| columns[column][row])
    }

    fn radius(&self) -> f64 {
        1.0
    }
}

/// `R'` is the rotation nearest to `R + Δ`, the step being Δ column by column. No singularities, but six components too
/// many. Steps shorter than 1, its radius, keep the determinant positive and the nearest rotation unique.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InMatrices;

impl Chart<Rotation3<f64>> for InMatrices {
    fn dimension(&self) -> usize {
        9
    }

    fn retract(&self, at: &Rotation3<f64>, step: &[f64]) -> Option<Rotation3<f64>> {
        let step = short::<9>(step, 1.0)?;
        so3::nearest(&(at.matrix() + Matrix3::from_column_slice(&step)))
    }

    /// ω is the vector of the skew-symmetric part of Δ Rᵀ.
    fn derivative(&self, at: &Rotation3<f64>) -> DMatrix<f64> {
        let mut derivative = DMatrix::zeros(3, 9);
        for j in 0..3 {
            let column = at.matrix().column(j).into_owned();
            for i in 0..3 {
                let omega = column.cross(&Vector3::ith(i, 0.5));
                derivative.set_column(3 * j + i, &omega);
            }
        }
        derivative
    }

    fn radius(&self) -> f64 {
        1.0
    }
}
