//! Methods that choose a direction from gradients and search along it: steepest ascent, nonlinear conjugate gradients
//! (E. Polak & G. Ribière, 1969, with the non-negative β of M. Powell, 1984), BFGS (C. Broyden, R. Fletcher, D. Goldfarb,
//! D. Shanno, 1970) and its version of limited memory (J. Nocedal, *Updating quasi-Newton matrices with limited storage*,
//! Math. Comp. 35, 1980). On manifolds as in W. Ring & B. Wirth, *Optimization methods on Riemannian manifolds and their
//! application to shape space*, SIAM J. Optim. 22(2), 2012.
//!
//! Gradients of earlier points are carried to the next as they are, component by component: exact where the chart's steps
//! add up (vector spaces, rotation vectors, Euler angles) or multiply (the Lie algebra, whose tangents are those of the group),
//! to first order elsewhere. So that the units of the parameters do not matter, all is measured in units of `1/√H_kk` where
//! the objective knows a curvature H at the start.

use crate::line_search::{LineSearch, Probe};
use crate::solver::Trials;
use crate::{Curvature, Derivatives, Iteration, Manifold, Objective, Report, Solver, Stop};
use nalgebra::{DMatrix, DVector};
use std::collections::VecDeque;

/// A gradient method with a line search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ascent {
    /// How a direction is chosen.
    pub direction: Direction,
    /// How far it goes.
    pub search: LineSearch,
    /// The most evaluations of the objective.
    pub iterations: usize,
    /// Stops when a step gains less than this, in the objective's units.
    pub gain_tolerance: f64,
}

impl Default for Ascent {
    fn default() -> Self {
        let direction = Direction::LimitedBfgs { memory: 8 };
        Self { direction, search: LineSearch::StrongWolfe, iterations: 200, gain_tolerance: 1e-14 }
    }
}

/// How a direction is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// The gradient.
    Gradient,
    /// The gradient and a share of the last direction.
    ConjugateGradient,
    /// The gradient times an inverse Hessian that is learned step by step.
    Bfgs,
    /// The same, from the last few steps.
    LimitedBfgs {
        /// How many steps are kept.
        memory: usize,
    },
}

/// A step s and how the gradient fell along it, y.
struct Pair {
    step: DVector<f64>,
    fall: DVector<f64>,
}

/// What a method has learned.
#[derive(Default)]
struct Memory {
    pairs: VecDeque<Pair>,
    inverse: Option<DMatrix<f64>>,
    /// The last gradient and direction.
    last: Option<(DVector<f64>, DVector<f64>)>,
    /// The components that were held at an end of their bounds.
    held: Vec<bool>,
}

impl Direction {
    fn choose(self, memory: &mut Memory, gradient: &DVector<f64>) -> DVector<f64> {
        match self {
            Self::Gradient => gradient.clone(),
            Self::ConjugateGradient => match &memory.last {
                None => gradient.clone(),
                Some((before, direction)) => {
                    let beta = gradient.dot(&(gradient - before)) / before.norm_squared();
                    gradient + direction * beta.max(0.0)
                }
            },
            Self::Bfgs => memory.inverse.as_ref().map_or_else(|| gradient.clone(), |inverse| inverse * gradient),
            Self::LimitedBfgs { .. } => two_loops(&memory.pairs, gradient),
        }
    }

    fn learn(self, memory: &mut Memory, pair: Pair, before: DVector<f64>, direction: DVector<f64>) {
        memory.last = Some((before, direction));
        let curvature = pair.step.dot(&pair.fall);
        // Only what is concave along the step keeps the inverse positive.
        if curvature <= 1e-10 * pair.step.norm() * pair.fall.norm() {
            return;
        }
        match self {
            Self::Bfgs => {
                let n = pair.step.len();
                let first = || DMatrix::identity(n, n) * (curvature / pair.fall.norm_squared());
                let inverse = memory.inverse.take().unwrap_or_else(first);
                let identity = DMatrix::<f64>::identity(n, n);
                let left = &identity - &pair.step * pair.fall.transpose() / curvature;
                memory.inverse =
                    Some(&left * inverse * left.transpose() + &pair.step * pair.step.transpose() / curvature);
            }
            Self::LimitedBfgs { memory: most } => {
                memory.pairs.push_back(pair);
                if memory.pairs.len() > most {
                    memory.pairs.pop_front();
                }
            }
            Self::Gradient | Self::ConjugateGradient => (),
        }
    }
}

/// The inverse Hessian of the stored pairs times the gradient (Nocedal 1980).
fn two_loops(pairs: &VecDeque<Pair>, gradient: &DVector<f64>) -> DVector<f64> {
    let mut direction = gradient.clone();
    let mut shares = Vec::with_capacity(pairs.len());
    for pair in pairs.iter().rev() {
        let share = pair.step.dot(&direction) / pair.step.dot(&pair.fall);
        direction.axpy(-share, &pair.fall, 1.0);
        shares.push(share);
    }
    if let Some(pair) = pairs.back() {
        direction *= pair.step.dot(&pair.fall) / pair.fall.norm_squared();
    }
    for (pair, share) in pairs.iter().zip(shares.into_iter().rev()) {
        let other = pair.fall.dot(&direction) / pair.step.dot(&pair.fall);
        direction.axpy(share - other, &pair.step, 1.0);
    }
    direction
}

/// The units of a step's components: `1/√H_kk`, or 1 where nothing is known.
pub(crate) fn units(curvature: &Curvature, dimension: usize) -> DVector<f64> {
    let diagonal = curvature.diagonal().unwrap_or_else(|| DVector::from_element(dimension, 1.0));
    let floor = (1e-12 * diagonal.max()).max(f64::MIN_POSITIVE);
    diagonal.map(|x| 1.0 / x.max(floor).sqrt())
}

impl<Point: Clone> Solver<Point> for Ascent {
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
        let Derivatives { mut gradient, curvature } = trials.objective.derivatives(&point);
        let known = curvature != Curvature::Unknown;
        let units = units(&curvature, manifold.dimension());
        let mut memory = Memory::default();
        // How far steepest directions went, and how steep it was: the next first trial promises as much.
        let mut before: Option<(f64, f64)> = None;
        let stop = loop {
            if trials.taken.len() >= self.iterations {
                break Stop::Exhausted;
            }
            let region = manifold.region(&point);
            // Components that are held at an end take no part, and what was learned with others held does not hold.
            let free = region.tangent(&gradient);
            let held: Vec<bool> = free.iter().zip(gradient.iter()).map(|(free, all)| free != all).collect();
            if memory.held != held {
                memory = Memory { held: held.clone(), ..Memory::default() };
            }
            let scaled = free.component_mul(&units);
            let mut direction = self.direction.choose(&mut memory, &scaled);
            let fresh = memory.last.is_none();
            let mut along = region.tangent(&direction.component_mul(&units));
            let mut slope = free.dot(&along);
            let rises = |slope: f64| slope > 0.0 && slope.is_finite();
            if !fresh && !rises(slope) {
                memory = Memory { held: held.clone(), ..Memory::default() };
                direction = scaled.clone();
                along = region.tangent(&direction.component_mul(&units));
                slope = free.dot(&along);
            }
            if !rises(slope) {
                break Stop::Converged;
            }
            let is_quasi_newton = memory.inverse.is_some() || !memory.pairs.is_empty();
            let first = match before {
                _ if is_quasi_newton => 1.0,
                Some((step, steep)) => step * steep / slope,
                None if known => 1.0,
                None => 1.0 / direction.norm().max(1.0),
            };
            let promise = 0.5 * slope * first;
            if promise < self.gain_tolerance && (known || is_quasi_newton) {
                break Stop::Converged;
            }
            let mut probes: Vec<(Probe, Point, Option<DVector<f64>>)> = Vec::new();
            let mut evaluate = |step: f64, sloped: bool| {
                if trials.taken.len() >= self.iterations {
                    return None;
                }
                // The way bends where a component comes to its end.
                let straight = &along * step;
                let bent = region.held(straight.clone());
                let (trial_value, trial) = trials.take(&point, &bent, 0.0, value)?;
                let gradient = sloped.then(|| trials.objective.derivatives(&trial).gradient);
                let moving = |i: usize| if bent[i] == straight[i] { along[i] } else { 0.0 };
                let slope = gradient.as_ref().map_or(0.0, |g| (0..g.len()).map(|i| g[i] * moving(i)).sum());
                let probe = Probe { step, value: trial_value, slope };
                probes.push((probe, trial, gradient));
                Some(probe)
            };
            let from = Probe { step: 0.0, value, slope };
            let longest = region.longest_in_balls(&along);
            let found = self.search.search(from, first, longest, &mut evaluate);
            let found = found.and_then(|found| probes.into_iter().rev().find(|(probe, ..)| probe.step == found.step));
            let Some((probe, trial, gradient_there)) = found else {
                if fresh {
                    break if trials.taken.len() >= self.iterations { Stop::Exhausted } else { Stop::Stalled };
                }
                memory = Memory { held, ..Memory::default() };
                before = None;
                continue;
            };
            let gain = probe.value - value;
            before = Some((probe.step, slope));
            (point, value) = (trial, probe.value);
            let next = gradient_there.unwrap_or_else(|| trials.objective.derivatives(&point).gradient);
            let step = region.held(along * probe.step).component_div(&units);
            // What is held makes no step, and how steep it is there says nothing of the others.
            let fall = DVector::from_fn(next.len(), |i, _| if held[i] { 0.0 } else { gradient[i] - next[i] });
            let pair = Pair { step, fall: fall.component_mul(&units) };
            self.direction.learn(&mut memory, pair, scaled, direction);
            gradient = next;
            if gain < self.gain_tolerance {
                break Stop::Converged;
            }
        };
        Some(trials.report(start, (value, point), stop))
    }
}
