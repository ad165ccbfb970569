//! What is optimized: a point on a manifold, and an objective over it.

use nalgebra::{DMatrix, DVector};

/// A space whose points are moved by steps in a tangent space.
pub trait Manifold<Point> {
    /// The number of components of a step.
    fn dimension(&self) -> usize;

    /// The point that a step from `at` leads to; the zero step leads to `at`. `None` where the step is not allowed:
    /// outside the region where the chart is safe, or beyond the parameters' bounds.
    fn retract(&self, at: &Point, step: &DVector<f64>) -> Option<Point>;
}

/// The vector space of a given dimension, stepped by addition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Euclidean(
    /// The dimension.
    pub usize,
);

impl Manifold<DVector<f64>> for Euclidean {
    fn dimension(&self) -> usize {
        self.0
    }

    fn retract(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step)
    }
}

/// Derivatives of an objective with respect to a step at zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives {
    /// The gradient, one component for each of the manifold's dimensions.
    pub gradient: DVector<f64>,
    /// A positive semidefinite stand-in for minus the Hessian (such as Gauss–Newton's or the empirical Fisher matrix).
    pub curvature: DMatrix<f64>,
}

/// A function to be maximized.
pub trait Objective<Point> {
    /// The value at a point; `None` where it is not defined.
    fn value(&mut self, at: &Point) -> Option<f64>;

    /// The derivatives at a point where the value is defined. Solvers ask for them at the point they evaluated last, or
    /// one they come back to.
    fn derivatives(&mut self, at: &Point) -> Derivatives;
}
