//! Mutual information of two photos: a density that is soft in both arguments, as both values move with their cameras.
//!
//! `p(a, b) = 1/N Σ_i β(a_i − a) β(b_i − b)` with `β` the cubic B-spline (P. Thévenaz and M. Unser, *Optimization of mutual
//! information for multiresolution image registration*, IEEE TIP 9(12), 2000). Both marginals move, so no term of the
//! derivative is constant along a row or a column: `∂I/∂p(a, b) = ln(p(a, b) / (p(a) p(b)))` up to one constant for the table.

use crate::Joint;
use crate::spline::cubic;
use rayon::prelude::*;

/// A joint histogram of two photos, smoothed by a cubic B-spline along both axes.
///
/// Values `0..=1` are mapped to the bins `1..=bins - 2`, so that no window reaches past the table; one more row and column
/// take the samples outside the first and the second photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PhotoPair {
    /// The number of bins of each photo, at least 4.
    pub bins: usize,
}

/// Mutual information of two photos, and how it follows their values.
#[derive(Clone, Debug, PartialEq)]
pub struct Mutual {
    /// The mutual information, in nats.
    pub value: f64,
    /// `N · ∂value/∂a_i` for each of the `N` samples, zero where the first photo does not show it.
    pub first: Vec<f32>,
    /// `N · ∂value/∂b_i`.
    pub second: Vec<f32>,
}

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 4096;

/// Where a value's window lies, and what it weighs.
struct Window {
    first: usize,
    weights: [f64; 4],
    slopes: [f64; 4],
}

impl PhotoPair {
    /// The mutual information of the values that the same surface points have in two photos, `0.0..=1.0` (values outside are
    /// clamped), NaN where a photo does not show the point.
    ///
    /// # Panics
    /// If the two slices differ in length, or there are fewer than four bins.
    #[must_use]
    pub fn mutual_information(self, first: &[f32], second: &[f32]) -> Mutual {
        assert_eq!(first.len(), second.len(), "samples come in pairs");
        assert!(self.bins >= 4, "a cubic window spans four bins");
        let joint = self.estimate(first, second);
        let (value, table) = information(&joint);
        let mut scores = vec![[0.0f32; 2]; first.len()];
        (first.par_chunks(CHUNK), second.par_chunks(CHUNK), scores.par_chunks_mut(CHUNK)).into_par_iter().for_each(
            |(first, second, scores)| {
                for ((&a, &b), score) in first.iter().zip(second).zip(scores) {
                    *score = self.slopes(a, b, &table);
                }
            },
        );
        let (first, second) = scores.into_iter().map(|[a, b]| (a, b)).unzip();
        Mutual { value, first, second }
    }

    /// The joint density: a row for each bin of the first photo and one for what is outside it, columns likewise.
    fn estimate(self, first: &[f32], second: &[f32]) -> Joint {
        let columns = self.bins + 1;
        let tables: Vec<Vec<f64>> = (first.par_chunks(CHUNK), second.par_chunks(CHUNK))
            .into_par_iter()
            .map(|(first, second)| {
                let mut table = vec![0.0; columns * columns];
                for (&a, &b) in first.iter().zip(second) {
                    let (a, b) = (self.window(a), self.window(b));
                    for (row, wa) in (a.first..columns).zip(a.weights) {
                        for (column, wb) in (b.first..columns).zip(b.weights) {
                            table[row * columns + column] += wa * wb;
                        }
                    }
                }
                table
            })
            .collect();
        let mut masses = vec![0.0; columns * columns];
        for table in tables {
            masses.iter_mut().zip(table).for_each(|(sum, mass)| *sum += mass);
        }
        Joint::from_masses(columns, masses)
    }

    /// The derivatives of one pair's share by its two values.
    fn slopes(self, a: f32, b: f32, table: &[f64]) -> [f32; 2] {
        let columns = self.bins + 1;
        let (a, b) = (self.window(a), self.window(b));
        let (mut by_a, mut by_b) = (0.0, 0.0);
        for i in 0..4.min(columns - a.first) {
            for j in 0..4.min(columns - b.first) {
                let cell = table[(a.first + i) * columns + b.first + j];
                by_a += a.slopes[i] * b.weights[j] * cell;
                by_b += a.weights[i] * b.slopes[j] * cell;
            }
        }
        [by_a as f32, by_b as f32]
    }

    /// The window of a value; all of the last bin where the photo does not show it.
    fn window(self, value: f32) -> Window {
        if value.is_nan() {
            return Window { first: self.bins, weights: [1.0, 0.0, 0.0, 0.0], slopes: [0.0; 4] };
        }
        let scale = (self.bins - 3) as f64;
        let bin = 1.0 + f64::from(value.clamp(0.0, 1.0)) * scale;
        let below = (bin as usize).min(self.bins - 3);
        let t = bin - below as f64;
        let inside = (0.0..=1.0).contains(&value);
        let (weights, slopes) = cubic(t);
        let slopes = if inside { slopes.map(|slope| scale * slope) } else { [0.0; 4] };
        Window { first: below - 1, weights, slopes }
    }
}

/// Mutual information, and the table of its derivatives by cell up to one constant.
fn information(joint: &Joint) -> (f64, Vec<f64>) {
    let (rows, columns) = (joint.model_marginal(), joint.photo_marginal());
    let mut value = 0.0;
    let mut table = Vec::with_capacity(joint.cells().len());
    for (row, p_row) in joint.rows().zip(rows) {
        for (&p, p_column) in row.iter().zip(&columns) {
            let cell = if p > 0.0 { (p / (p_row * p_column)).ln() } else { 0.0 };
            value += p * cell;
            table.push(cell);
        }
    }
    (value, table)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two photos of one surface under different light, each with its own noise.
    fn values(count: u32) -> (Vec<f32>, Vec<f32>) {
        let noise = |i: u32, k: f32| (k * i as f32).sin();
        let pair = |i: u32| {
            let shade = 0.5 + 0.3 * noise(i, 0.731);
            let second = 0.9 - 0.8 * shade * shade + 0.06 * noise(i, 3.33);
            (shade + 0.05 * noise(i, 1.77), second)
        };
        (0..count).map(pair).unzip()
    }

    #[test]
    fn scores_agree_with_differences() {
        let (mut first, mut second) = values(500);
        first[7] = f32::NAN;
        second[11] = f32::NAN;
        let pair = PhotoPair { bins: 12 };
        let at = pair.mutual_information(&first, &second);
        for i in [0, 3, 7, 11, 123, 499] {
            for (which, score) in [(0, at.first[i]), (1, at.second[i])] {
                let moved = |step: f32| {
                    let (mut first, mut second) = (first.clone(), second.clone());
                    let value = if which == 0 { &mut first[i] } else { &mut second[i] };
                    *value += step;
                    let place = f64::from(*value);
                    (place, pair.mutual_information(&first, &second).value)
                };
                let ((x0, y0), (x1, y1)) = (moved(-1e-3), moved(1e-3));
                let slope = if x0.is_nan() { 0.0 } else { 500.0 * (y1 - y0) / (x1 - x0) };
                assert!((slope - f64::from(score)).abs() < 1e-4 * (1.0 + slope.abs()), "{i}: {score} against {slope}");
            }
        }
    }

    #[test]
    fn the_order_of_the_photos_does_not_matter() {
        let (first, second) = values(3_000);
        let pair = PhotoPair { bins: 16 };
        let (one, other) = (pair.mutual_information(&first, &second), pair.mutual_information(&second, &first));
        assert!((one.value - other.value).abs() < 1e-12 && one.value > 0.3);
        assert_eq!(one.first.len(), other.second.len());
        assert!(one.first.iter().zip(&other.second).all(|(a, b)| (a - b).abs() < 1e-5));
    }

    #[test]
    fn unrelated_photos_share_nothing() {
        let (first, _) = values(40_000);
        let second: Vec<f32> = (0..40_000).map(|i| 0.5 + 0.4 * (0.119 * i as f32).cos()).collect();
        assert!(PhotoPair { bins: 12 }.mutual_information(&first, &second).value < 0.02);
    }
}
