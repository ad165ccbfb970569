//! Looking for the basin of the right view around a rough one: the cross-entropy method (R. Rubinstein, *The cross-entropy
//! method for combinatorial and continuous optimization*, Methodology and Computing in Applied Probability 1, 1999).
//!
//! Views are drawn from a normal distribution over the tangent space of the start's pose; the best of each round give
//! mean and covariance for the next.

use crate::overview::Workspace;
use nalgebra::{Cholesky, Matrix6, Point3, Vector3, Vector6};
use rand::{Rng, SeedableRng, rngs::StdRng};
use rayon::prelude::*;
use texreg_camera::View;
use texreg_lie::{Pose, so3};

/// How far and how long to look.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Search {
    /// Rounds.
    pub(crate) rounds: usize,
    /// Views a round.
    pub(crate) views: usize,
    /// The best views of a round that shape the next.
    pub(crate) elite: usize,
    /// The standard deviation of the first round: radians of rotation, and shares of the region's
    /// diagonal.
    pub(crate) deviation: f64,
    /// The seed.
    pub(crate) seed: u64,
}

/// What a view's squared distance from the start costs, in standard deviations and nats: far views must be that much better.
const DOUBT: f64 = 0.01;

impl Default for Search {
    fn default() -> Self {
        Self { rounds: 5, views: 100, elite: 15, deviation: 0.08, seed: 0 }
    }
}

impl Search {
    /// For each criterion the views that were looked at and what they scored by it, less a doubt that grows with the distance from
    /// the start, the best first. Views are of the model's frame; the first round is the same for all criteria.
    pub(crate) fn around<E: Send, const N: usize>(
        &self,
        start: &View,
        region: &Region,
        look: impl Fn(&mut Workspace, &View) -> Option<E> + Sync,
        criteria: [fn(&E) -> f64; N],
    ) -> [Vec<(f64, View)>; N] {
        let mut random = StdRng::seed_from_u64(self.seed);
        let look = |steps: Vec<Vector6<f64>>| -> Vec<(E, Vector6<f64>, View)> {
            let looked = steps.into_par_iter().map_init(Workspace::default, |workspace, step| {
                let view = region.moved(start, &step);
                Some((look(workspace, &view)?, step, view))
            });
            looked.flatten().collect()
        };
        // The first round looks near the start as well as far.
        let near_and_far = (1..self.views).map(|i| normal(&mut random) * self.deviation * [1.0, 0.3][i % 2]);
        let first = look(std::iter::once(Vector6::zeros()).chain(near_and_far).collect());
        criteria.map(|criterion| {
            let score = |(seen, step, view): &(E, Vector6<f64>, View)| {
                (criterion(seen) - DOUBT * step.norm_squared() / self.deviation.powi(2), *step, *view)
            };
            let mut random = random.clone();
            let mut scored: Vec<_> = first.iter().map(score).collect();
            let mut all: Vec<(f64, View)> = Vec::new();
            for round in 0..self.rounds {
                scored.sort_by(|a, b| b.0.total_cmp(&a.0));
                all.extend(scored.iter().map(|(score, _, view)| (*score, *view)));
                let elite = &scored[..self.elite.min(scored.len())];
                if elite.len() < 8 || round + 1 == self.rounds {
                    break;
                }
                let count = elite.len() as f64;
                let mean = elite.iter().map(|(_, step, _)| step).sum::<Vector6<f64>>() / count;
                let spread: Matrix6<f64> =
                    elite.iter().map(|(_, step, _)| (step - mean) * (step - mean).transpose()).sum();
                // Directions stay open that a small elite happens to agree on.
                let floor = (0.1 * self.deviation).powi(2) * 0.5f64.powi(round as i32);
                let covariance = spread / count + Matrix6::from_diagonal_element(floor);
                let Some(factor) = Cholesky::new(covariance) else { break };
                let steps = (0..self.views).map(|_| mean + factor.l() * normal(&mut random)).collect();
                scored = look(steps).iter().map(score).collect();
            }
            all.sort_by(|a, b| b.0.total_cmp(&a.0));
            all
        })
    }
}

/// The part of the model that the start shows: what views are turned about, and the unit of their shifts.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Region {
    centre: Point3<f64>,
    /// The unit of distances.
    diagonal: f64,
    /// The units of shifts to the right, down and away.
    units: Vector3<f64>,
}

impl Region {
    /// The bounding box of points of the model; `None` without any.
    pub(crate) fn around(points: &[Point3<f64>]) -> Option<Self> {
        let first = *points.first()?;
        let (low, high) = points.iter().fold((first, first), |(low, high), p| (low.inf(p), high.sup(p)));
        let diagonal = (high - low).norm();
        Some(Self { centre: nalgebra::center(&low, &high), diagonal, units: Vector3::repeat(diagonal) })
    }

    /// The same for what is neither known of size nor of place: shifts away in units of the distance, and others, to which a
    /// picture is more sensitive, in half diagonals.
    pub(crate) fn by_size(self, view: &View) -> Self {
        let (aside, away) = (0.5 * self.diagonal, view.pose.transform_point(&self.centre).coords.norm());
        Self { units: Vector3::new(aside, aside, away), ..self }
    }

    /// How far a view is from another: radians, or the shift of the centre in units of the diagonal where that is more.
    pub(crate) fn step(&self, from: &View, to: &View) -> f64 {
        let turn = from.pose.rotation.angle_to(&to.pose.rotation);
        let shift = to.pose.transform_point(&self.centre) - from.pose.transform_point(&self.centre);
        turn.max(shift.norm() / self.diagonal)
    }

    /// The view that a step leads to: a rotation vector about the centre, and a shift in the region's units.
    fn moved(&self, start: &View, step: &Vector6<f64>) -> View {
        let turn: Vector3<f64> = step.fixed_rows::<3>(0).into_owned();
        let shift: Vector3<f64> = step.fixed_rows::<3>(3).component_mul(&self.units);
        let rotation = so3::exp(&turn) * start.pose.rotation;
        let centre = start.pose.transform_point(&self.centre).coords + shift;
        View { camera: start.camera, pose: Pose::new(rotation, centre - rotation * self.centre.coords) }
    }
}

/// Six standard normal numbers (G. Box and M. Muller, 1958).
fn normal(random: &mut StdRng) -> Vector6<f64> {
    Vector6::from_fn(|_, _| {
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use texreg_camera::Camera;

    #[test]
    fn a_view_is_as_far_as_the_step_that_leads_to_it() {
        let region = Region::around(&[Point3::new(1.0, 2.0, 0.5), Point3::new(3.0, -1.0, 2.0)]).unwrap();
        let pose = Pose::new(so3::exp(&Vector3::new(0.3, -0.2, 0.9)), Vector3::new(0.2, -0.4, 9.0));
        let start = View { camera: Camera::ideal(640, 480, 500.0), pose };
        for (turn, shift) in [(0.2, 0.05), (0.01, 0.3), (0.0, 0.0)] {
            let (turn_by, shift_by) = (Vector3::new(0.6, 0.0, -0.8) * turn, Vector3::new(0.0, 0.6, 0.8) * shift);
            let step = Vector6::from_iterator(turn_by.iter().chain(shift_by.iter()).copied());
            assert!((region.step(&start, &region.moved(&start, &step)) - turn.max(shift)).abs() < 1e-6);
        }
    }
}
