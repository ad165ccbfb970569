//! Charts: how an optimizer, which thinks in vectors, moves a rotation or a pose.

use crate::{Pose, so3};
use nalgebra::{DMatrix, Point3, Rotation3};

/// A local parametrization around a point: a vector of step components, zero at the point itself.
///
/// With the derivative an objective needs to know the left tangent only: its gradient there, times the derivative, is
/// its gradient in the chart.
pub trait Chart<Point> {
    /// The number of components of a step.
    fn dimension(&self) -> usize;

    /// The point a step leads to; `None` for a step that is not shorter than [`radius`](Self::radius), not finite, or not
    /// of the chart's dimension.
    fn retract(&self, at: &Point, step: &[f64]) -> Option<Point>;

    /// The derivative at the zero step: the left tangent (3 rows for rotations, 6 for poses) per step component (columns).
    fn derivative(&self, at: &Point) -> DMatrix<f64>;

    /// How long the part of a step that turns may be (Euclidean norm, exclusive).
    fn radius(&self) -> f64;
}

/// A rotation chart carried over to poses: its step, then a translation of the pivot in the target frame (3 components).
///
/// The pivot is a point of the source frame (of the world, for a `camera_from_world` pose). Turning about the middle of
/// an object rather than about a far origin keeps rotation and translation independent of each other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Around<C> {
    /// Moves the rotation.
    pub rotation: C,
    /// Stays where it is when only the rotation moves.
    pub pivot: Point3<f64>,
}

impl<C: Chart<Rotation3<f64>>> Chart<Pose> for Around<C> {
    fn dimension(&self) -> usize {
        self.rotation.dimension() + 3
    }

    fn retract(&self, at: &Pose, step: &[f64]) -> Option<Pose> {
        let (turn, shift) = step.split_at_checked(self.rotation.dimension())?;
        let [x, y, z] = shift.try_into().ok()?;
        let rotation = self.rotation.retract(&at.rotation, turn)?;
        let pivot = at.transform_point(&self.pivot).coords + nalgebra::Vector3::new(x, y, z);
        let pose = Pose::new(rotation, pivot - rotation * self.pivot.coords);
        pose.is_finite().then_some(pose)
    }

    /// A turn ω about the pivot p is the left tangent (ω, p × ω).
    fn derivative(&self, at: &Pose) -> DMatrix<f64> {
        let n = self.rotation.dimension();
        let turn = self.rotation.derivative(&at.rotation);
        let mut derivative = DMatrix::zeros(6, n + 3);
        let arm = so3::hat(&at.transform_point(&self.pivot).coords);
        derivative.view_mut((3, 0), (3, n)).copy_from(&(arm * &turn));
        derivative.view_mut((0, 0), (3, n)).copy_from(&turn);
        derivative.view_mut((3, n), (3, 3)).fill_with_identity();
        derivative
    }

    fn radius(&self) -> f64 {
        self.rotation.radius()
    }
}

impl<Point, C: Chart<Point> + ?Sized> Chart<Point> for Box<C> {
    fn dimension(&self) -> usize {
        (**self).dimension()
    }

    fn retract(&self, at: &Point, step: &[f64]) -> Option<Point> {
        (**self).retract(at, step)
    }

    fn derivative(&self, at: &Point) -> DMatrix<f64> {
        (**self).derivative(at)
    }

    fn radius(&self) -> f64 {
        (**self).radius()
    }
}

/// The step as an array, if it has N components and is shorter than the radius.
pub(crate) fn short<const N: usize>(step: &[f64], radius: f64) -> Option<[f64; N]> {
    let step: [f64; N] = step.try_into().ok()?;
    let square: f64 = step.iter().map(|x| x * x).sum();
    (square < radius * radius).then_some(step)
}
