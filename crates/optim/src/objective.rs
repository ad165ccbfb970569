//! A function to be maximized, and its derivatives.

use crate::Curvature;
use nalgebra::DVector;

/// A function to be maximized.
pub trait Objective<Point> {
    /// The value at a point; `None` where it is not defined.
    fn value(&mut self, at: &Point) -> Option<f64>;

    /// The derivatives at a point where the value is defined. Solvers ask for them at the point they evaluated last, or
    /// one they come back to.
    fn derivatives(&mut self, at: &Point) -> Derivatives;

    /// Draws another random batch of the data, for the objectives that are estimated from one. `round` counts up from
    /// zero, and the same round is the same batch. `false` where there are no batches.
    fn redraw(&mut self, _round: usize) -> bool {
        false
    }
}

/// Derivatives of an objective with respect to a step at zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Derivatives {
    /// The gradient, one component for each of the manifold's dimensions.
    pub gradient: DVector<f64>,
    /// A positive semidefinite stand-in for minus the Hessian (such as Gauss–Newton's or the empirical Fisher matrix).
    pub curvature: Curvature,
}
