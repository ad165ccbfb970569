//! Methods that ask for values alone, as baselines: BOBYQA (M. Powell, *The BOBYQA algorithm for bound constrained optimization
//! without derivatives*, 2009; the crate `bobyqa`, a port of PRIMA) and the simplex of J. Nelder & R. Mead, *A simplex method
//! for function minimization*, Comp. J. 7, 1965, with the coefficients of F. Gao & L. Han, *Implementing the Nelder–Mead simplex
//! algorithm with adaptive parameters*, Comput. Optim. Appl. 51, 2012.
//!
//! Both work in one chart, around the start, in units of the curvature's diagonal there (1 where it is not known).

use crate::ascent::units;
use crate::solver::Trials;
use crate::{Iteration, Manifold, Objective, Region, Report, Solver, Stop};
use nalgebra::DVector;

/// Powell's BOBYQA.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bobyqa {
    /// The most evaluations: at least `2 n + 2` for n dimensions.
    pub iterations: usize,
    /// The first radius of the trust region, in units of the curvature.
    pub radius: f64,
    /// The last.
    pub tolerance: f64,
}

/// The simplex of Nelder and Mead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NelderMead {
    /// The most evaluations.
    pub iterations: usize,
    /// The edge of the first simplex, in units of the curvature.
    pub radius: f64,
    /// Stops when the values of the simplex differ by less than this.
    pub gain_tolerance: f64,
}

impl Default for Bobyqa {
    fn default() -> Self {
        Self { iterations: 1000, radius: 0.5, tolerance: 1e-7 }
    }
}

impl Default for NelderMead {
    fn default() -> Self {
        Self { iterations: 2000, radius: 0.5, gain_tolerance: 1e-14 }
    }
}

/// Evaluates steps from the start, and keeps the best. Steps beyond the region count as the nearest inside.
struct Chart<'a, Point> {
    trials: Trials<'a, Point>,
    origin: Point,
    region: Region,
    units: DVector<f64>,
    start: f64,
    best: (f64, Point),
}

impl<'a, Point: Clone> Chart<'a, Point> {
    fn new(
        manifold: &'a dyn Manifold<Point>,
        objective: &'a mut dyn Objective<Point>,
        origin: Point,
        observer: &'a mut dyn FnMut(&Iteration),
    ) -> Option<Self> {
        let trials = Trials::new(manifold, objective, observer);
        let start = trials.objective.value(&origin)?;
        let units = units(&trials.objective.derivatives(&origin).curvature, manifold.dimension());
        Some(Self { region: manifold.region(&origin), best: (start, origin.clone()), trials, origin, units, start })
    }

    /// The value a step away, in units; minus infinity where it is not defined.
    fn value(&mut self, step: &[f64]) -> f64 {
        let step = self.region.held(DVector::from_column_slice(step).component_mul(&self.units));
        let Some(trial) = self.trials.take(&self.origin, &step, 0.0, self.best.0) else { return f64::NEG_INFINITY };
        let value = trial.0;
        if value > self.best.0 {
            self.best = trial;
        }
        value
    }

    fn report(self, stop: Stop) -> Report<Point> {
        self.trials.report(self.start, self.best, stop)
    }
}

/// What BOBYQA is told where nothing is defined: its models need finite values.
const NOWHERE: f64 = 1e30;

impl<Point: Clone> Solver<Point> for Bobyqa {
    fn maximize(
        &self,
        manifold: &dyn Manifold<Point>,
        objective: &mut dyn Objective<Point>,
        start: Point,
        observer: &mut dyn FnMut(&Iteration),
    ) -> Option<Report<Point>> {
        let n = manifold.dimension();
        let mut chart = Chart::new(manifold, objective, start, observer)?;
        let (low, high) = chart.region.boxed(n);
        // The first radius must fit into the box twice: where it is narrow, units are smaller.
        for (unit, width) in chart.units.iter_mut().zip((&high - &low).iter()) {
            *unit = unit.min(0.45 * width / self.radius);
        }
        let (low, high) = (low.component_div(&chart.units), high.component_div(&chart.units));
        let mut config = bobyqa::Config::new(n);
        config.rho_begin = self.radius;
        config.rho_end = self.tolerance.min(self.radius);
        config.max_fun = self.iterations.max(config.npt + 1);
        let mut solver = bobyqa::Bobyqa::new(n, config).ok()?;
        let mut at = vec![0.0; n];
        let outcome = solver.minimize(|x| (-chart.value(x)).min(NOWHERE), &mut at, low.as_slice(), high.as_slice());
        Some(chart.report(match outcome.status {
            bobyqa::Status::MaxFunReached => Stop::Exhausted,
            bobyqa::Status::Converged => Stop::Converged,
            _ => Stop::Stalled,
        }))
    }
}

impl<Point: Clone> Solver<Point> for NelderMead {
    fn maximize(
        &self,
        manifold: &dyn Manifold<Point>,
        objective: &mut dyn Objective<Point>,
        start: Point,
        observer: &mut dyn FnMut(&Iteration),
    ) -> Option<Report<Point>> {
        let n = manifold.dimension();
        let mut chart = Chart::new(manifold, objective, start, observer)?;
        let mut simplex = vec![(DVector::zeros(n), chart.start)];
        for k in 0..n {
            let mut corner = DVector::zeros(n);
            corner[k] = self.radius;
            let value = chart.value(corner.as_slice());
            simplex.push((corner, value));
        }
        let size = (n as f64).max(2.0);
        let (expand, contract, shrink) = (1.0 + 2.0 / size, 0.75 - 0.5 / size, 1.0 - 1.0 / size);
        let stop = loop {
            simplex.sort_by(|a, b| b.1.total_cmp(&a.1));
            if simplex[0].1 - simplex[n].1 < self.gain_tolerance {
                break Stop::Converged;
            }
            if chart.trials.taken.len() >= self.iterations {
                break Stop::Exhausted;
            }
            let middle = simplex[..n].iter().fold(DVector::zeros(n), |sum, (corner, _)| sum + corner) / n as f64;
            let away = &middle - &simplex[n].0;
            let mut probe = |factor: f64| {
                let corner = &middle + &away * factor;
                let value = chart.value(corner.as_slice());
                (corner, value)
            };
            let reflected = probe(1.0);
            let replaced = if reflected.1 > simplex[0].1 {
                let expanded = probe(expand);
                Some(if expanded.1 > reflected.1 { expanded } else { reflected })
            } else if reflected.1 > simplex[n - 1].1 {
                Some(reflected)
            } else {
                let outside = reflected.1 > simplex[n].1;
                let contracted = probe(if outside { contract } else { -contract });
                Some(contracted).filter(|contracted| contracted.1 > simplex[n].1.max(reflected.1))
            };
            match replaced {
                Some(corner) => simplex[n] = corner,
                None => {
                    let best = simplex[0].0.clone();
                    for (corner, value) in &mut simplex[1..] {
                        *corner = &best + (&*corner - &best) * shrink;
                        *value = chart.value(corner.as_slice());
                    }
                }
            }
        };
        Some(chart.report(stop))
    }
}
