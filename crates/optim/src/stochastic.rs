//! Stochastic gradient ascent on random batches with decaying gains: H. Robbins & S. Monro, *A stochastic approximation
//! method*, Ann. Math. Stat. 22, 1951, with the gains of S. Klein, M. Staring, J. Pluim, *Evaluation of optimization methods for
//! nonrigid medical image registration using mutual information and B-splines*, IEEE Trans. Image Proc. 16(12), 2007:
//! `γ_k = a / (1 + k/A)^α`. Its cost does not depend on how much data there is, only on the batch.
//!
//! A step is the gain times the gradient in units of the curvature's diagonal at the start, so that a gain of 1 is about a
//! Newton step of each component.

use crate::ascent::units;
use crate::solver::Trials;
use crate::{Iteration, Manifold, Objective, Report, Solver, Stop};

/// The stochastic gradient method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StochasticGradient {
    /// The number of steps, each with a batch of its own.
    pub iterations: usize,
    /// The first gain, a.
    pub gain: f64,
    /// After how many steps it has begun to decay, A.
    pub delay: f64,
    /// How fast, α: above ½ and at most 1.
    pub decay: f64,
}

impl Default for StochasticGradient {
    fn default() -> Self {
        Self { iterations: 200, gain: 0.5, delay: 20.0, decay: 0.9 }
    }
}

impl<Point: Clone> Solver<Point> for StochasticGradient {
    /// Start and end are compared on one batch, the first; `value` and `start` are those of that batch.
    fn maximize(
        &self,
        manifold: &dyn Manifold<Point>,
        objective: &mut dyn Objective<Point>,
        start: Point,
        observer: &mut dyn FnMut(&Iteration),
    ) -> Option<Report<Point>> {
        let mut trials = Trials::new(manifold, objective, observer);
        trials.objective.redraw(0);
        let mut point = start.clone();
        let start_value = trials.objective.value(&point)?;
        let units = units(&trials.objective.derivatives(&point).curvature, manifold.dimension());
        let squares = units.component_mul(&units);
        for k in 0..self.iterations {
            trials.objective.redraw(k + 1);
            let gain = self.gain / (1.0 + k as f64 / self.delay).powf(self.decay);
            let value = trials.objective.value(&point);
            let step = trials.objective.derivatives(&point).gradient.component_mul(&squares) * gain;
            let step = manifold.region(&point).held(step);
            let next = value.and_then(|_| manifold.retract(&point, &step));
            // A batch may lead astray where the objective is not defined: such a step is left out.
            let next = next.filter(|next| trials.objective.value(next).is_some());
            trials.keep(value, &step, 0.0, next.is_some());
            point = next.unwrap_or(point);
        }
        trials.objective.redraw(0);
        let end = trials.objective.value(&point).filter(|value| *value > start_value);
        let end = end.map_or((start_value, start), |value| (value, point));
        Some(trials.report(start_value, end, Stop::Exhausted))
    }
}
