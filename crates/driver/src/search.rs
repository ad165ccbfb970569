//! Looking for the basin of the right view around a rough one: the cross-entropy method (R. Rubinstein, *The cross-entropy
//! method for combinatorial and continuous optimization*, Methodology and Computing in Applied Probability 1, 1999).
//!
//! Views are drawn from a normal distribution over the tangent space of the start's pose; the best of each round give
//! mean and covariance for the next.

use crate::overview::Workspace;
use nalgebra::{Cholesky, Matrix6, Vector3, Vector6};
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
    /// The standard deviation of the first round: radians of rotation, and shares of the model's diagonal.
    pub(crate) deviation: f64,
    /// The seed.
    pub(crate) seed: u64,
}

/// What a view's squared distance from the start costs, in standard deviations and nats: far views must be that much better.
const DOUBT: f64 = 0.003;

impl Default for Search {
    fn default() -> Self {
        Self { rounds: 5, views: 40, elite: 10, deviation: 0.08, seed: 0 }
    }
}

impl Search {
    /// The views that were looked at and what they scored, less a doubt that grows with the distance from the start, the best
    /// first. Views are of the model's frame, about whose origin they turn; `diagonal` is the model's.
    pub(crate) fn around(
        &self,
        start: &View,
        diagonal: f64,
        score: impl Fn(&mut Workspace, &View) -> Option<f64> + Sync,
    ) -> Vec<(f64, View)> {
        let mut random = StdRng::seed_from_u64(self.seed);
        let mut mean = Vector6::zeros();
        let mut covariance = Matrix6::identity() * self.deviation.powi(2);
        let mut all: Vec<(f64, View)> = Vec::new();
        for round in 0..self.rounds {
            let Some(factor) = Cholesky::new(covariance) else { break };
            let drawn: Vec<Vector6<f64>> = (0..self.views)
                .map(|i| if round == 0 && i == 0 { mean } else { mean + factor.l() * normal(&mut random) })
                .collect();
            let mut scored: Vec<(f64, Vector6<f64>, View)> = drawn
                .into_par_iter()
                .map_init(Workspace::default, |workspace, step| {
                    let view = moved(start, &step, diagonal);
                    let doubt = DOUBT * step.norm_squared() / self.deviation.powi(2);
                    Some((score(workspace, &view)? - doubt, step, view))
                })
                .flatten()
                .collect();
            scored.sort_by(|a, b| b.0.total_cmp(&a.0));
            let elite = &scored[..self.elite.min(scored.len())];
            if elite.len() < 8 {
                break;
            }
            let count = elite.len() as f64;
            mean = elite.iter().map(|(_, step, _)| step).sum::<Vector6<f64>>() / count;
            let spread: Matrix6<f64> = elite.iter().map(|(_, step, _)| (step - mean) * (step - mean).transpose()).sum();
            // Directions stay open that a small elite happens to agree on.
            let floor = (0.1 * self.deviation).powi(2) * 0.5f64.powi(round as i32);
            covariance = spread / count + Matrix6::from_diagonal_element(floor);
            all.extend(scored.into_iter().map(|(score, _, view)| (score, view)));
        }
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all
    }
}

/// The view that a step leads to: a rotation vector about the model's origin, and a shift in units of its diagonal.
fn moved(start: &View, step: &Vector6<f64>, diagonal: f64) -> View {
    let turn: Vector3<f64> = step.fixed_rows::<3>(0).into_owned();
    let shift: Vector3<f64> = step.fixed_rows::<3>(3) * diagonal;
    let pose = Pose::new(so3::exp(&turn) * start.pose.rotation, start.pose.translation + shift);
    View { camera: start.camera, pose }
}

/// Six standard normal numbers (G. Box and M. Muller, 1958).
fn normal(random: &mut StdRng) -> Vector6<f64> {
    Vector6::from_fn(|_, _| {
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    })
}
