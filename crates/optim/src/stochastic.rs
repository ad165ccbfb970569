//! Stochastic gradient ascent on random batches with decaying gains: H. Robbins & S. Monro, *A stochastic approximation
//! method*, Ann. Math. Stat. 22, 1951, with the gains of S. Klein, M. Staring, J. Pluim, *Evaluation of optimization methods for
//! nonrigid medical image registration using mutual information and B-splines*, IEEE Trans. Image Proc. 16(12), 2007:
//! `γ_k = a / (1 + k/A)^α`. Its cost does not depend on how much data there is, only on the batch.
//!
//! A step is the gain times the gradient in units of the curvature's diagonal at the start, so that a gain of 1 is about a
//! Newton step of each component.

use crate::ascent::units;
use crate::{Iteration, Manifold, Objective, Report, Solver, Stop};
use std::time::Instant;

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
        let began = Instant::now();
        objective.redraw(0);
        let mut point = start.clone();
        let start_value = objective.value(&point)?;
        let units = units(&objective.derivatives(&point).curvature, manifold.dimension());
        let squares = units.component_mul(&units);
        let mut iterations = Vec::with_capacity(self.iterations);
        for k in 0..self.iterations {
            objective.redraw(k + 1);
            let gain = self.gain / (1.0 + k as f64 / self.delay).powf(self.decay);
            let value = objective.value(&point);
            let mut step = objective.derivatives(&point).gradient.component_mul(&squares) * gain;
            let region = manifold.region(&point);
            step = region.tangent(&step);
            step *= region.longest(&step).min(1.0);
            let next = value.and_then(|_| manifold.retract(&point, &step));
            // A batch may lead astray where the objective is not defined: such a step is left out.
            let next = next.filter(|next| objective.value(next).is_some());
            let iteration = Iteration {
                value,
                step: step.norm(),
                damping: 0.0,
                accepted: next.is_some(),
                seconds: began.elapsed().as_secs_f64(),
            };
            observer(&iteration);
            iterations.push(iteration);
            point = next.unwrap_or(point);
        }
        objective.redraw(0);
        let end = objective.value(&point).filter(|value| *value > start_value);
        let (point, value) = end.map_or((start, start_value), |value| (point, value));
        Some(Report { point, start: start_value, value, stop: Stop::Exhausted, iterations })
    }
}
