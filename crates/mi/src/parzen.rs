//! The Parzen histogram with cubic B-spline windows over the photo values: D. Mattes et al., *PET-CT image registration
//! in the chest using free-form deformations*, IEEE TMI 22(1), 2003; P. Thévenaz and M. Unser, *Optimization of
//! mutual information for multiresolution image registration*, IEEE TIP 9(12), 2000.
//!
//! `p(u, v) = 1/N Σ_i [u_i = u] β(b_i − v)` with `β` the cubic B-spline and `b_i` the photo value in units of bins. `β`
//! is twice differentiable and its shifts sum to one, so the estimate moves smoothly with the values and keeps its mass.

use crate::{Density, Joint, Samples};
use rayon::prelude::*;

/// A joint histogram, hard in the model's bins and smoothed by a cubic B-spline in the photo's.
///
/// Photo values `0..=1` are mapped to the bins `1..=photo_bins - 2`, so that no window reaches past the table. Column
/// `photo_bins` of the estimate takes the samples outside the photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Parzen {
    /// The number of model bins.
    pub model_bins: usize,
    /// The number of photo bins, at least 4.
    pub photo_bins: usize,
}

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 8192;

impl Parzen {
    fn columns(self) -> usize {
        self.photo_bins + 1
    }

    /// Bins per unit of photo value.
    fn scale(self) -> f64 {
        (self.photo_bins - 3) as f64
    }

    /// The first of the four bins that `value` touches, and its place (0..=1) between the second and the third.
    #[inline]
    fn place(self, value: f32) -> (usize, f64) {
        let bin = 1.0 + f64::from(value.clamp(0.0, 1.0)) * self.scale();
        let below = (bin as usize).min(self.photo_bins - 3);
        (below - 1, bin - below as f64)
    }
}

impl Density for Parzen {
    fn estimate(&self, samples: &Samples) -> Joint {
        assert!(self.photo_bins >= 4, "a cubic window spans four photo bins");
        let columns = self.columns();
        let tables: Vec<Vec<f64>> = (samples.model.par_chunks(CHUNK), samples.photo.par_chunks(CHUNK))
            .into_par_iter()
            .map(|(model, photo)| {
                let mut table = vec![0.0; self.model_bins * columns];
                for (&u, &v) in model.iter().zip(photo) {
                    let row = &mut table[usize::from(u) * columns..][..columns];
                    if v.is_nan() {
                        row[self.photo_bins] += 1.0;
                        continue;
                    }
                    let (first, t) = self.place(v);
                    row[first..first + 4].iter_mut().zip(window(t)).for_each(|(cell, weight)| *cell += weight);
                }
                table
            })
            .collect();
        let mut masses = vec![0.0; self.model_bins * columns];
        for table in tables {
            masses.iter_mut().zip(table).for_each(|(sum, mass)| *sum += mass);
        }
        Joint::from_masses(self.model_bins, masses)
    }

    fn scores(&self, samples: &Samples, derivative: &[f64]) -> Vec<f32> {
        let columns = self.columns();
        assert_eq!(derivative.len(), self.model_bins * columns, "one derivative for each cell of the estimate");
        let scale = self.scale();
        let mut scores = vec![0.0; samples.len()];
        (samples.model.par_chunks(CHUNK), samples.photo.par_chunks(CHUNK), scores.par_chunks_mut(CHUNK))
            .into_par_iter()
            .for_each(|(model, photo, scores)| {
                for ((&u, &v), score) in model.iter().zip(photo).zip(scores) {
                    if !(0.0..=1.0).contains(&v) {
                        continue; // outside the photo, or clamped: no derivative
                    }
                    let (first, t) = self.place(v);
                    let row = &derivative[usize::from(u) * columns + first..][..4];
                    let slope: f64 = row.iter().zip(window_derivative(t)).map(|(d, w)| d * w).sum();
                    *score = (slope * scale) as f32;
                }
            });
        scores
    }
}

/// The cubic B-spline at the four bins around a value that lies `t` (0..=1) after the second.
#[inline]
pub(crate) fn window(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [s * s * s / 6.0, 2.0 / 3.0 - t * t * (1.0 - 0.5 * t), 2.0 / 3.0 - s * s * (1.0 - 0.5 * s), t * t * t / 6.0]
}

/// The derivative of [`window`] by `t`.
#[inline]
pub(crate) fn window_derivative(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [-0.5 * s * s, t * (1.5 * t - 2.0), -s * (1.5 * s - 2.0), 0.5 * t * t]
}
