//! What every solver does, and what it reports.

use crate::{Manifold, Objective};

/// A method that climbs an objective over a manifold.
pub trait Solver<Point> {
    /// Climbs from `start`, telling `observer` of each iteration. `None` if the objective is not defined at the start, or
    /// has no curvature and the solver needs one.
    /// The reported point is never worse than the start.
    fn maximize(
        &self,
        manifold: &dyn Manifold<Point>,
        objective: &mut dyn Objective<Point>,
        start: Point,
        observer: &mut dyn FnMut(&Iteration),
    ) -> Option<Report<Point>>;
}

/// One trial step of a solver.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    /// The objective's value at the trial point; `None` where it is not defined or the manifold refused the step.
    pub value: Option<f64>,
    /// The length of the step in the tangent space.
    pub step: f64,
    /// The damping λ that was used; 0 by solvers without one.
    pub damping: f64,
    /// Whether the step was taken.
    pub accepted: bool,
    /// Seconds since the solver began.
    pub seconds: f64,
}

/// Why a solver stopped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The next step, or the gain it promises, is below the tolerance.
    Converged,
    /// No damping gives a better point.
    Stalled,
    /// The number of iterations is used up.
    Exhausted,
}

/// Where a solver came to.
#[derive(Clone, Debug, PartialEq)]
pub struct Report<Point> {
    /// The best point.
    pub point: Point,
    /// The value at the start.
    pub start: f64,
    /// The value at the best point.
    pub value: f64,
    /// Why the solver stopped.
    pub stop: Stop,
    /// Every trial step.
    pub iterations: Vec<Iteration>,
}
