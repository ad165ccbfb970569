//! A rigid motion of space.

use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};
use std::ops::Mul;

/// A rigid motion, `y = R x + t`. Name a value by its frames: `camera_from_world` takes world points to the camera frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// R.
    pub rotation: Rotation3<f64>,
    /// t, in model units.
    pub translation: Vector3<f64>,
}

impl Pose {
    /// The motion `y = R x + t`.
    pub fn new(rotation: Rotation3<f64>, translation: Vector3<f64>) -> Self {
        Self { rotation, translation }
    }

    /// The motion that moves nothing.
    pub fn identity() -> Self {
        Self::new(Rotation3::identity(), Vector3::zeros())
    }

    /// `a_from_b` to `b_from_a`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self::new(rotation, -(rotation * self.translation))
    }

    /// `R x + t`.
    pub fn transform_point(&self, point: &Point3<f64>) -> Point3<f64> {
        self.rotation * point + self.translation
    }

    /// The direction `R d`.
    pub fn transform_vector(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * direction
    }

    /// The point that goes to the origin, −Rᵀt: for `camera_from_world`, the camera centre in the world.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(-(self.rotation.inverse() * self.translation))
    }

    /// The 3×4 matrix `[R | t]`.
    pub fn matrix(&self) -> Matrix3x4<f64> {
        let mut m = Matrix3x4::zeros();
        m.fixed_columns_mut::<3>(0).copy_from(self.rotation.matrix());
        m.set_column(3, &self.translation);
        m
    }

    /// The pose with its rotation made orthogonal again, for long chains of products.
    pub fn renormalized(&self) -> Self {
        let rotation = crate::so3::nearest(self.rotation.matrix()).unwrap_or(self.rotation);
        Self::new(rotation, self.translation)
    }

    /// Whether every number is finite.
    pub fn is_finite(&self) -> bool {
        self.rotation.matrix().iter().chain(self.translation.iter()).all(|x| x.is_finite())
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self::identity()
    }
}

/// Composition: `a_from_c = a_from_b * b_from_c`.
impl Mul for Pose {
    type Output = Pose;

    fn mul(self, other: Pose) -> Pose {
        Pose::new(self.rotation * other.rotation, self.rotation * other.translation + self.translation)
    }
}
