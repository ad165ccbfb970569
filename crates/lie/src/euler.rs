//! Euler angles, `R = Rz(c) Ry(b) Rx(a)`: roll a, pitch b and yaw c about fixed axes.

use crate::Chart;
use crate::chart::short;
use nalgebra::{DMatrix, Matrix3, Rotation3, Vector3};
use std::f64::consts::FRAC_PI_2;

/// `R' = Rz(c + δc) Ry(b + δb) Rx(a + δa)` with the angles of R. At b = ±π/2, the gimbal lock, a and c turn about the same
/// axis and the derivative loses a rank; [`Euler::lock`] measures how near that is.
///
/// (a, b, c) and (a + π, π − b, c + π) are the same rotation. The angles are rescaled to the one with |b| ≤ π/2 after every
/// step, so that a step shorter than π/2, which keeps |b| < π, may go through the lock and comes out on the other triple.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Euler;

impl Euler {
    /// The angles (a, b, c) of a rotation, |b| ≤ π/2. In the lock, where only c ∓ a is defined, a is zero.
    pub fn angles(rotation: &Rotation3<f64>) -> Vector3<f64> {
        let m = rotation.matrix();
        let cos = m.m11.hypot(m.m21);
        let b = (-m.m31).atan2(cos);
        if cos < 1e-14 {
            return Vector3::new(0.0, b, (-m.m12).atan2(m.m22));
        }
        Vector3::new(m.m32.atan2(m.m33), b, m.m21.atan2(m.m11))
    }

    /// The rotation of the angles (a, b, c).
    pub fn rotation(angles: &Vector3<f64>) -> Rotation3<f64> {
        let [(sa, ca), (sb, cb), (sc, cc)] = [angles.x.sin_cos(), angles.y.sin_cos(), angles.z.sin_cos()];
        #[rustfmt::skip]
        let matrix = Matrix3::new(
            cc * cb, cc * sb * sa - sc * ca, cc * sb * ca + sc * sa,
            sc * cb, sc * sb * sa + cc * ca, sc * sb * ca - cc * sa,
            -sb, cb * sa, cb * ca,
        );
        Rotation3::from_matrix_unchecked(matrix)
    }

    /// cos b: 1 where the angles are best, 0 in the gimbal lock. It is the determinant of the derivative.
    pub fn lock(rotation: &Rotation3<f64>) -> f64 {
        rotation.matrix().m11.hypot(rotation.matrix().m21)
    }
}

impl Chart<Rotation3<f64>> for Euler {
    fn dimension(&self) -> usize {
        3
    }

    fn retract(&self, at: &Rotation3<f64>, step: &[f64]) -> Option<Rotation3<f64>> {
        let step = Vector3::from(short::<3>(step, FRAC_PI_2)?);
        Some(Self::rotation(&(Self::angles(at) + step)))
    }

    /// The axes the three angles turn about: `Rz Ry x`, `Rz y` and `z`.
    fn derivative(&self, at: &Rotation3<f64>) -> DMatrix<f64> {
        let angles = Self::angles(at);
        let ((sb, cb), (sc, cc)) = (angles.y.sin_cos(), angles.z.sin_cos());
        DMatrix::from_column_slice(3, 3, &[cc * cb, sc * cb, -sb, -sc, cc, 0.0, 0.0, 0.0, 1.0])
    }

    fn radius(&self) -> f64 {
        FRAC_PI_2
    }
}
