//! The solvers by name, made for one level of the pyramid, and the batches a stochastic one draws.

use crate::SolverName;
use crate::objective::{PhotoObjective, Prior};
use crate::parameters::ViewSpace;
use crate::pyramid::Level;
use crate::samples::SurfaceSamples;
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use texreg_camera::View;
use texreg_mi::Parzen;
use texreg_optim::{
    Ascent, Bobyqa, Derivatives, Direction, LevenbergMarquardt, LineSearch, NelderMead, Objective, Solver,
    StochasticGradient,
};

/// Evaluations of a line search, and of methods without derivatives, for one step of Levenberg–Marquardt.
const SEARCHING: usize = 6;
const BLIND: usize = 30;

/// Samples of a stochastic solver's batch, and its steps.
const BATCH: usize = 1_000;
const STOCHASTIC_STEPS: usize = 120;

impl SolverName {
    /// The solver of this name, for the views of so many photos: for so many steps of Levenberg–Marquardt, until a step gains less
    /// than `gain`.
    pub(crate) fn solver<Point: Clone>(self, photos: usize, steps: usize, gain: f64) -> Box<dyn Solver<Point>> {
        let ascent = |direction, search| {
            Box::new(Ascent { direction, search, iterations: SEARCHING * steps, gain_tolerance: gain })
        };
        match self {
            Self::LevenbergMarquardt => {
                Box::new(LevenbergMarquardt { iterations: steps, damping: 1e-2, gain_tolerance: gain })
            }
            Self::Gradient => ascent(Direction::Gradient, LineSearch::Backtracking),
            Self::ConjugateGradient => ascent(Direction::ConjugateGradient, LineSearch::StrongWolfe),
            Self::Bfgs => ascent(Direction::Bfgs, LineSearch::StrongWolfe),
            Self::LimitedBfgs => ascent(Direction::LimitedBfgs { memory: 8 }, LineSearch::StrongWolfe),
            Self::StochasticGradient => {
                Box::new(StochasticGradient { iterations: STOCHASTIC_STEPS, ..StochasticGradient::default() })
            }
            // In units of the curvature: an object that fills the photo moves by about a pixel in a hundredth.
            Self::Bobyqa => Box::new(Bobyqa { iterations: photos * BLIND * steps, radius: 0.1, tolerance: 1e-3 }),
            Self::NelderMead => {
                Box::new(NelderMead { iterations: photos * BLIND * steps, radius: 0.1, gain_tolerance: 0.1 * gain })
            }
        }
    }
}

/// The metric over random batches of the samples.
pub(crate) struct Batches<'a> {
    pub(crate) samples: &'a SurfaceSamples,
    pub(crate) level: &'a Level,
    pub(crate) density: &'a Parzen,
    pub(crate) space: &'a ViewSpace<'a>,
    pub(crate) prior: Prior,
    pub(crate) seed: u64,
    pub(crate) batch: SurfaceSamples,
}

impl Batches<'_> {
    fn over_batch(&self) -> PhotoObjective<'_> {
        PhotoObjective::new(&self.batch, self.level, self.density, self.space, self.prior)
    }
}

impl Objective<View> for Batches<'_> {
    fn value(&mut self, at: &View) -> Option<f64> {
        self.over_batch().value(at)
    }

    fn derivatives(&mut self, at: &View) -> Derivatives {
        self.over_batch().derivatives(at)
    }

    fn redraw(&mut self, round: usize) -> bool {
        let mut random = StdRng::seed_from_u64(self.seed ^ (round as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15));
        let count = self.samples.points.len();
        let mut chosen: Vec<usize> = (0..BATCH.min(count)).map(|_| random.random_range(0..count)).collect();
        // Surface points come first: they alone have a shading.
        chosen.sort_unstable();
        let shading = chosen.iter().map_while(|&i| self.samples.shading.get(i).copied()).collect();
        self.batch = SurfaceSamples {
            points: chosen.iter().map(|&i| self.samples.points[i]).collect(),
            bins: chosen.iter().map(|&i| self.samples.bins[i]).collect(),
            covered: self.samples.covered,
            metric: self.samples.metric,
            shading,
            needles: self.samples.needles.clone(),
            contour: self.samples.contour.clone(),
        };
        true
    }
}
