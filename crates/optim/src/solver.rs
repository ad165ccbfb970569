//! What every solver does, and what it reports.

use crate::{Manifold, Objective};
use nalgebra::DVector;
use std::time::Instant;

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
    /// The next step, the gain it promises or that of the last is below the tolerance.
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

/// The trial steps of a solver: taken, timed, told to the observer, and kept.
pub(crate) struct Trials<'a, Point> {
    pub(crate) manifold: &'a dyn Manifold<Point>,
    pub(crate) objective: &'a mut dyn Objective<Point>,
    observer: &'a mut dyn FnMut(&Iteration),
    began: Instant,
    pub(crate) taken: Vec<Iteration>,
}

impl<'a, Point> Trials<'a, Point> {
    pub(crate) fn new(
        manifold: &'a dyn Manifold<Point>,
        objective: &'a mut dyn Objective<Point>,
        observer: &'a mut dyn FnMut(&Iteration),
    ) -> Self {
        Self { manifold, objective, observer, began: Instant::now(), taken: Vec::new() }
    }

    /// Where a step leads to, and the value there; `None` where there is none. It counts as accepted if the value is above `best`.
    pub(crate) fn take(&mut self, from: &Point, step: &DVector<f64>, damping: f64, best: f64) -> Option<(f64, Point)> {
        let trial = self.manifold.retract(from, step);
        let trial = trial.and_then(|trial| Some((self.objective.value(&trial)?, trial)));
        let value = trial.as_ref().map(|(value, _)| *value);
        self.keep(value, step, damping, value.is_some_and(|value| value > best));
        trial
    }

    /// Tells of a step and keeps it.
    pub(crate) fn keep(&mut self, value: Option<f64>, step: &DVector<f64>, damping: f64, accepted: bool) {
        let seconds = self.began.elapsed().as_secs_f64();
        let iteration = Iteration { value, step: step.norm(), damping, accepted, seconds };
        (self.observer)(&iteration);
        self.taken.push(iteration);
    }

    /// The report on these steps.
    pub(crate) fn report(self, start: f64, (value, point): (f64, Point), stop: Stop) -> Report<Point> {
        Report { point, start, value, stop, iterations: self.taken }
    }
}
