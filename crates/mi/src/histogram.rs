//! The hard joint histogram.

use crate::{Density, Joint, Real, Samples};
use rayon::prelude::*;

/// A joint histogram with hard bins on both sides: photo values `0..=1` in equal steps, and one more column for the samples
/// outside. (For steps of equal frequency see [`ranks`](crate::ranks).)
///
/// It is a staircase in the photo's values: its scores are zero, and only methods without derivatives can climb on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Histogram {
    /// The number of model bins.
    pub model_bins: usize,
    /// The number of photo bins.
    pub photo_bins: usize,
}

/// Samples counted by one task.
const CHUNK: usize = 1 << 15;

impl<T: Real> Density<Samples<'_, T>> for Histogram {
    type Score = T;

    fn estimate(&self, samples: &Samples<T>) -> Joint {
        let columns = self.photo_bins + 1;
        let scale = T::of(self.photo_bins as f64);
        let counts = (samples.model.par_chunks(CHUNK), samples.photo.par_chunks(CHUNK))
            .into_par_iter()
            .map(|(model, photo)| {
                let mut counts = vec![0u32; self.model_bins * columns];
                for (&u, &v) in model.iter().zip(photo) {
                    let is_outside = v.is_missing();
                    let bin = (v.unit() * scale).whole().min(self.photo_bins - 1);
                    counts[usize::from(u) * columns + if is_outside { self.photo_bins } else { bin }] += 1;
                }
                counts
            })
            // Whole numbers: their sum does not depend on the order.
            .reduce_with(|mut a, b| {
                a.iter_mut().zip(b).for_each(|(sum, count)| *sum += count);
                a
            });
        let counts = counts.unwrap_or_else(|| vec![0; self.model_bins * columns]);
        Joint::from_masses(self.model_bins, counts.into_iter().map(f64::from).collect())
    }

    fn scores(&self, samples: &Samples<T>, _derivative: &[f64]) -> Vec<T> {
        vec![T::default(); samples.len()]
    }
}
