//! Entropies without bins, from two random samples: P. Viola and W. Wells, *Alignment by maximization of mutual information*,
//! IJCV 24(2), 1997 (their EMMA).
//!
//! The density at a point is a sum of Gaussian windows over the samples of `A`, and an entropy the mean of its logarithm over those
//! of `B`: `h(z) ≈ −1/|B| Σ_j ln 1/|A| Σ_i G(z_j − z_i)`. There is no table; so it serves metrics of the three entropies.
//! Differential entropies can be negative: MI and conditional entropy make sense here, ratios of entropies do not.

use crate::{Entropies, EntropyFunction, EntropyMetric};
use rayon::prelude::*;

/// One of the two random samples: for each point the model's attribute of `D` components and the photo's value.
#[derive(Clone, Copy, Debug)]
pub struct Points<'a, const D: usize> {
    /// The model's attributes.
    pub model: &'a [[f64; D]],
    /// What the photo shows.
    pub photo: &'a [f64],
}

/// The windows' standard deviations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emma {
    /// Of each component of the model's attribute.
    pub model_deviation: f64,
    /// Of the photo's value.
    pub photo_deviation: f64,
}

/// A metric's value and its derivatives by the photo values of both samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Evaluation {
    /// The value.
    pub value: f64,
    /// The derivatives by the photo values of `A`.
    pub windows: Vec<f64>,
    /// The derivatives by the photo values of `B`.
    pub points: Vec<f64>,
}

/// Points of `B` taken by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 32;

impl Emma {
    /// Evaluates a metric of the entropies of `b` by windows over `a`, at the cost of `|A| × |B|` windows.
    ///
    /// A point of `b` that is far from every window of `a` counts as if one were five deviations away.
    ///
    /// # Panics
    /// If attributes and values differ in number, or a sample is empty.
    #[must_use]
    pub fn evaluate<const D: usize>(&self, metric: &dyn EntropyMetric, a: Points<D>, b: Points<D>) -> Evaluation {
        assert!(a.model.len() == a.photo.len() && b.model.len() == b.photo.len(), "points come in pairs");
        assert!(!a.model.is_empty() && !b.model.is_empty(), "two samples are needed");
        let chunks: Vec<[Sums; 3]> = b
            .model
            .par_chunks(CHUNK)
            .zip(b.photo.par_chunks(CHUNK))
            .map(|(model, photo)| self.chunk(a, Points { model, photo }))
            .collect();
        let count = b.photo.len() as f64;
        let share = |k: usize| {
            let log: f64 = chunks.iter().map(|chunk| chunk[k].log).sum();
            -(log / count - (a.photo.len() as f64).ln())
        };
        let log_scale = |deviation: f64| (deviation * std::f64::consts::TAU.sqrt()).ln();
        let (scale_u, scale_v) = (D as f64 * log_scale(self.model_deviation), log_scale(self.photo_deviation));
        let entropies =
            Entropies { model: share(0) + scale_u, photo: share(1) + scale_v, both: share(2) + scale_u + scale_v };
        let EntropyFunction { value, first, .. } = metric.at(&entropies);
        let weight = |k: usize| first[k] / (count * self.photo_deviation * self.photo_deviation);
        let mut evaluation = Evaluation { value, windows: vec![0.0; a.photo.len()], points: Vec::new() };
        for chunk in &chunks {
            let points = chunk[1].points.iter().zip(&chunk[2].points);
            evaluation.points.extend(points.map(|(v, both)| weight(1) * v + weight(2) * both));
            let windows = chunk[1].windows.iter().zip(&chunk[2].windows);
            for (sum, (v, both)) in evaluation.windows.iter_mut().zip(windows) {
                *sum -= weight(1) * v + weight(2) * both;
            }
        }
        evaluation
    }

    /// The sums over some points for `u`, `v` and both.
    fn chunk<const D: usize>(&self, a: Points<D>, b: Points<D>) -> [Sums; 3] {
        let mut sums = [(); 3].map(|()| Sums { log: 0.0, points: Vec::new(), windows: vec![0.0; a.photo.len()] });
        let mut weights = vec![[0.0; 3]; a.photo.len()];
        let square = |x: f64, deviation: f64| (x / deviation).powi(2);
        // Beyond this the logarithm would only follow a single far window.
        let floor = (-0.5 * 25.0f64).exp();
        for (model, &photo) in b.model.iter().zip(b.photo) {
            let mut totals = [0.0; 3];
            for (weight, (other, &value)) in weights.iter_mut().zip(a.model.iter().zip(a.photo)) {
                let distance: f64 = model.iter().zip(other).map(|(x, y)| square(x - y, self.model_deviation)).sum();
                let u = (-0.5 * distance).exp();
                let v = (-0.5 * square(photo - value, self.photo_deviation)).exp();
                *weight = [u, v, u * v];
                (0..3).for_each(|k| totals[k] += weight[k]);
            }
            for k in 0..3 {
                sums[k].log += (totals[k] + floor).ln();
                let share = 1.0 / (totals[k] + floor);
                let mut pull = 0.0;
                for ((weight, &value), window) in weights.iter().zip(a.photo).zip(&mut sums[k].windows) {
                    let term = share * weight[k] * (photo - value);
                    pull += term;
                    *window += term;
                }
                sums[k].points.push(pull);
            }
        }
        sums
    }
}

/// Sums over points of `B`: the logarithms of their densities, and what pulls at the points and at the windows.
struct Sums {
    log: f64,
    points: Vec<f64>,
    windows: Vec<f64>,
}
