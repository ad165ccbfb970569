//! Levenberg–Marquardt: D. Marquardt, *An algorithm for least-squares estimation of nonlinear parameters*, SIAM J. 11(2),
//! 1963, with the damping schedule of H. B. Nielsen, *Damping parameter in Marquardt's method*, IMM-REP-1999-05.
//!
//! The step solves `σ (H + λ diag H) s = g` for the gradient `g` and the curvature `H`, so that it does not depend on the
//! units of the parameters. It is the best such step within the manifold's region. A step is taken if the objective grows; `λ`
//! follows the ratio of the growth to what the quadratic model promised.
//!
//! The scale `σ` makes the curvature along the step before what that step measured, as in S. S. Oren and D. G. Luenberger,
//! *Self-scaling variable metric (SSVM) algorithms*, Management Science 20(5), 1974: an empirical Fisher matrix is as much too
//! large as samples contradict each other. For least squares near their minimum it stays 1.

use crate::solver::Trials;
use crate::{Curvature, Derivatives, Iteration, Manifold, Objective, Report, Solver, Stop};

/// The Levenberg–Marquardt method for an objective with a positive semidefinite curvature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevenbergMarquardt {
    /// The most trial steps.
    pub iterations: usize,
    /// The damping `λ` of the first step, relative to the diagonal of the curvature.
    pub damping: f64,
    /// Stops when the quadratic model promises a gain below this, in the objective's units, or a step gains less.
    pub gain_tolerance: f64,
}

impl Default for LevenbergMarquardt {
    fn default() -> Self {
        Self { iterations: 50, damping: 1e-3, gain_tolerance: 1e-14 }
    }
}

/// Beyond this damping a step is a vanishing gradient step: there is nothing to gain.
const MAX_DAMPING: f64 = 1e12;
const MIN_DAMPING: f64 = 1e-9;

/// One step changes the curvature's scale by this factor at most.
const RESCALING: f64 = 4.0;

/// The least scale: an objective without a bend says nothing of how far to go.
const LEAST_SCALE: f64 = 0.03;

impl<Point> Solver<Point> for LevenbergMarquardt {
    fn maximize(
        &self,
        manifold: &dyn Manifold<Point>,
        objective: &mut dyn Objective<Point>,
        start: Point,
        observer: &mut dyn FnMut(&Iteration),
    ) -> Option<Report<Point>> {
        let mut trials = Trials::new(manifold, objective, observer);
        let mut point = start;
        let start = trials.objective.value(&point)?;
        let mut value = start;
        let mut derivatives = trials.objective.derivatives(&point);
        if derivatives.curvature == Curvature::Unknown {
            return None;
        }
        let mut damping = self.damping;
        let mut growth = 2.0;
        let mut scale = 1.0;
        let mut region = manifold.region(&point);
        let stop = loop {
            if trials.taken.len() == self.iterations {
                break Stop::Exhausted;
            }
            if damping > MAX_DAMPING {
                break Stop::Stalled;
            }
            let Derivatives { gradient, curvature } = &derivatives;
            let Some(step) = curvature.damped_step_within(&(gradient / scale), damping, &region) else {
                damping *= growth;
                growth *= 2.0;
                continue;
            };
            let (slope, bend) = (gradient.dot(&step), 0.5 * curvature.along(&step));
            let promise = slope - scale * bend;
            if promise < self.gain_tolerance {
                break Stop::Converged;
            }
            let trial = trials.take(&point, &step, damping, value);
            if let Some((trial_value, _)) = trial {
                // A value that is no number counts as a step too far.
                let measured = (slope - (trial_value - value)) / bend;
                scale = measured.min(RESCALING * scale).max(scale / RESCALING).max(LEAST_SCALE);
            }
            let better = trial.filter(|(trial_value, _)| *trial_value > value);
            if let Some((trial_value, trial)) = better {
                let ratio = (trial_value - value) / promise;
                damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).clamp(0.1, 2.0);
                damping = damping.max(MIN_DAMPING);
                growth = 2.0;
                let gain = trial_value - value;
                (point, value) = (trial, trial_value);
                if gain < self.gain_tolerance {
                    break Stop::Converged;
                }
                derivatives = trials.objective.derivatives(&point);
                region = manifold.region(&point);
            } else {
                damping *= growth;
                growth *= 2.0;
            }
        };
        Some(trials.report(start, (value, point), stop))
    }
}
