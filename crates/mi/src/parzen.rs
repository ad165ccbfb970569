//! The Parzen histogram with cubic B-spline windows over the photo values: D. Mattes et al., *PET-CT image registration
//! in the chest using free-form deformations*, IEEE TMI 22(1), 2003; P. Thévenaz and M. Unser, *Optimization of
//! mutual information for multiresolution image registration*, IEEE TIP 9(12), 2000.
//!
//! `p(u, v) = 1/N Σ_i [u_i = u] β(b_i − v)` with `β` the cubic B-spline and `b_i` the photo value in units of bins. `β`
//! is twice differentiable and its shifts sum to one, so the estimate moves smoothly with the values and keeps its mass.
//!
//! Between two bins the windows are cubic polynomials of the place `t` between them. So a pass over the samples adds
//! `(1, t, t², t³)` to the moments of an interval, and windows are weighed once an interval, not once a sample; on the way back
//! each interval has one polynomial of `t`.

use crate::{Density, Joint, Real, Samples, TwiceDifferentiable};
use fearless_simd::{Level, dispatch};
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

/// Samples summed by one task, or as many as there are cells if that is more: fixed, so that sums do not depend on the
/// number of threads.
const CHUNK: usize = 1 << 14;

/// Samples whose places are computed together.
const BLOCK: usize = 128;

/// The windows of the four bins around an interval as polynomials of the place in it: `WINDOWS[j][k]` counts `t^k` of bin `j`.
pub(crate) const WINDOWS: [[f64; 4]; 4] = [
    [1.0 / 6.0, -0.5, 0.5, -1.0 / 6.0],
    [2.0 / 3.0, 0.0, -1.0, 0.5],
    [1.0 / 6.0, 0.5, 0.5, -0.5],
    [0.0, 0.0, 0.0, 1.0 / 6.0],
];

impl Parzen {
    /// The photo value at the centre of each column: in units of bins they are `-1, 0, 1, …`, and that of the last, which is
    /// outside, is NaN.
    #[must_use]
    pub fn photo_values(&self) -> Vec<f64> {
        let value = |column: usize| (column as f64 - 1.0) / self.scale();
        (0..self.photo_bins).map(value).chain([f64::NAN]).collect()
    }

    fn columns(&self) -> usize {
        self.photo_bins + 1
    }

    /// Intervals between bins, each with four bins around it.
    fn intervals(&self) -> usize {
        self.photo_bins - 3
    }

    /// Bins per unit of photo value.
    fn scale(&self) -> f64 {
        self.intervals() as f64
    }

    /// The cells of a row of intervals: one more for the samples outside.
    fn stride(&self) -> usize {
        self.intervals() + 1
    }

    fn chunk(&self) -> usize {
        CHUNK.max(self.model_bins * self.stride())
    }

    /// The cells of the intervals that a block of samples is in, and the places there (0..=1).
    #[inline(always)]
    fn places<T: Real>(&self, model: &[u16; BLOCK], photo: &[T; BLOCK]) -> ([u32; BLOCK], [T; BLOCK]) {
        let scale = T::of(self.scale());
        let (stride, last) = (self.stride() as u32, self.intervals() as u32 - 1);
        let one = T::of(1.0);
        let (mut cells, mut places) = ([0; BLOCK], [T::default(); BLOCK]);
        for (((&u, &v), cell), place) in model.iter().zip(photo).zip(&mut cells).zip(&mut places) {
            let (interval, t) = (v.unit() * scale).split();
            // The upper end of the range belongs to the last interval.
            let is_end = interval > last;
            let (interval, t) = (if is_end { last } else { interval }, if is_end { one } else { t });
            let is_outside = v.is_missing();
            *cell = u32::from(u) * stride + if is_outside { stride - 1 } else { interval };
            *place = t;
        }
        (cells, places)
    }

    /// Adds up the moments of samples, interval by interval.
    #[inline(always)]
    fn sum<T: Real>(&self, model: &[u16], photo: &[T], moments: impl Fn(usize, T) -> [T; 4], table: &mut [[T; 4]]) {
        let mut rest = ([0; BLOCK], [T::default(); BLOCK]);
        let mut terms = [[T::default(); 4]; BLOCK];
        for (index, (model, photo)) in model.chunks(BLOCK).zip(photo.chunks(BLOCK)).enumerate() {
            let (at, places) = self.places(block(model, &mut rest.0), block(photo, &mut rest.1));
            for (i, (terms, &t)) in terms.iter_mut().zip(&places[..model.len()]).enumerate() {
                *terms = moments(index * BLOCK + i, t);
            }
            terms[model.len()..].fill([T::default(); 4]);
            for (terms, &at) in terms.iter().zip(&at) {
                let cell = &mut table[at as usize];
                *cell = std::array::from_fn(|k| cell[k] + terms[k]);
            }
        }
    }

    /// Adds up moments over the samples, interval by interval, and weighs the windows: `Σ_i rate_i β^(order)(b_i − v)`.
    fn pass<T: Real>(
        &self,
        samples: &Samples<T>,
        moments: impl Fn(usize, T) -> [T; 4] + Sync,
        windows: &[[f64; 4]; 4],
    ) -> Vec<f64> {
        assert!(self.photo_bins >= 4, "a cubic window spans four photo bins");
        let (chunk, stride) = (self.chunk(), self.stride());
        let cells = self.model_bins * stride;
        let level = Level::new();
        let tables: Vec<Vec<[T; 4]>> = (samples.model.par_chunks(chunk), samples.photo.par_chunks(chunk))
            .into_par_iter()
            .enumerate()
            .map(|(index, (model, photo))| {
                let mut table = vec![[T::default(); 4]; cells];
                dispatch!(level, _simd => self.sum(model, photo, |i, t| moments(index * chunk + i, t), &mut table));
                table
            })
            .collect();
        let mut sums = vec![[0.0; 4]; cells];
        for table in &tables {
            dispatch!(level, _simd => merge(&mut sums, table));
        }
        let columns = self.columns();
        let mut masses = vec![0.0; self.model_bins * columns];
        for (row, cells) in masses.chunks_exact_mut(columns).zip(sums.chunks_exact(stride)) {
            // Most cells of a large table are empty.
            for (interval, cell) in cells[..stride - 1].iter().enumerate().filter(|(_, cell)| **cell != [0.0; 4]) {
                for (mass, window) in row[interval..].iter_mut().zip(windows) {
                    *mass += (0..4).map(|k| window[k] * cell[k]).sum::<f64>();
                }
            }
            row[self.photo_bins] = cells[stride - 1][0];
        }
        masses
    }

    /// The polynomial `Σ_v D(u, v) β^(order)(b − v)` of the place in each interval, for each sample at its own place; zero
    /// outside the photo and where the value was clamped.
    fn pull_back<T: Real>(&self, samples: &Samples<T>, derivative: &[f64], windows: &[[f64; 4]; 4]) -> Vec<T> {
        let (columns, stride) = (self.columns(), self.stride());
        assert_eq!(derivative.len(), self.model_bins * columns, "one derivative for each cell of the estimate");
        let mut polynomials = vec![[T::default(); 4]; self.model_bins * stride];
        for (row, cells) in derivative.chunks_exact(columns).zip(polynomials.chunks_exact_mut(stride)) {
            for (interval, cell) in cells[..stride - 1].iter_mut().enumerate() {
                let around = &row[interval..interval + 4];
                *cell = std::array::from_fn(|k| T::of((0..4).map(|j| around[j] * windows[j][k]).sum()));
            }
        }
        let zero = T::default();
        let level = Level::new();
        let mut scores = vec![zero; samples.len()];
        let chunk = self.chunk();
        (samples.model.par_chunks(chunk), samples.photo.par_chunks(chunk), scores.par_chunks_mut(chunk))
            .into_par_iter()
            .for_each(|(model, photo, scores)| {
                dispatch!(level, _simd => self.look_up(&polynomials, model, photo, scores));
            });
        scores
    }

    /// The polynomials at the samples' places.
    #[inline(always)]
    fn look_up<T: Real>(&self, polynomials: &[[T; 4]], model: &[u16], photo: &[T], scores: &mut [T]) {
        let mut rest = ([0; BLOCK], [T::default(); BLOCK]);
        let mut found = [[T::default(); 4]; BLOCK];
        let (zero, one) = (T::default(), T::of(1.0));
        for ((model, photo), scores) in model.chunks(BLOCK).zip(photo.chunks(BLOCK)).zip(scores.chunks_mut(BLOCK)) {
            let (at, places) = self.places(block(model, &mut rest.0), block(photo, &mut rest.1));
            for (found, &cell) in found.iter_mut().zip(&at) {
                *found = polynomials[cell as usize];
            }
            for (((score, [a, b, c, _]), &t), &v) in scores.iter_mut().zip(&found).zip(&places).zip(photo) {
                let slope = *a + t * (*b + t * *c);
                *score = if (v >= zero) & (v <= one) { slope } else { zero };
            }
        }
    }
}

/// Adds a table to another.
#[inline(always)]
fn merge<T: Real>(sums: &mut [[f64; 4]], table: &[[T; 4]]) {
    for (sum, cell) in sums.as_flattened_mut().iter_mut().zip(table.as_flattened()) {
        *sum += (*cell).into();
    }
}

/// A block of samples; what is missing is zero.
#[inline(always)]
fn block<'a, T: Copy + Default>(part: &'a [T], padded: &'a mut [T; BLOCK]) -> &'a [T; BLOCK] {
    match part.try_into() {
        Ok(whole) => whole,
        Err(_) => {
            padded[..part.len()].copy_from_slice(part);
            padded
        }
    }
}

/// The windows' derivatives by the place, times a factor, `order` times.
fn differentiated(factor: f64, order: usize) -> [[f64; 4]; 4] {
    let slope = |w: [f64; 4]| [factor * w[1], factor * 2.0 * w[2], factor * 3.0 * w[3], 0.0];
    let mut windows = WINDOWS;
    for _ in 0..order {
        windows = windows.map(slope);
    }
    windows
}

impl<T: Real> Density<Samples<'_, T>> for Parzen {
    type Score = T;

    fn estimate(&self, samples: &Samples<T>) -> Joint {
        let one = T::of(1.0);
        let mut masses = self.pass(samples, |_, t| [one, t, t * t, t * t * t], &WINDOWS);
        // Moments round: an empty cell can come out below zero by the last digit.
        masses.iter_mut().for_each(|mass| *mass = mass.max(0.0));
        Joint::from_masses(self.model_bins, masses)
    }

    fn scores(&self, samples: &Samples<T>, derivative: &[f64]) -> Vec<T> {
        self.pull_back(samples, derivative, &differentiated(self.scale(), 1))
    }
}

impl<T: Real> TwiceDifferentiable<Samples<'_, T>> for Parzen {
    fn along(&self, samples: &Samples<T>, rates: &[f64]) -> Vec<f64> {
        assert_eq!(rates.len(), samples.len(), "one rate a sample");
        let (zero, one) = (T::default(), T::of(1.0));
        let moments = |i: usize, t: T| {
            let v = samples.photo[i];
            let rate = if v >= zero && v <= one { T::of(rates[i]) } else { zero };
            [rate, rate * t, rate * t * t, zero]
        };
        let mut table = self.pass(samples, moments, &differentiated(self.scale(), 1));
        let share = 1.0 / samples.len().max(1) as f64;
        for row in table.chunks_exact_mut(self.columns()) {
            row.iter_mut().for_each(|cell| *cell *= share);
            row[self.photo_bins] = 0.0;
        }
        table
    }

    fn second_scores(&self, samples: &Samples<T>, derivative: &[f64]) -> Vec<T> {
        self.pull_back(samples, derivative, &differentiated(self.scale(), 2))
    }
}
