//! A density that is soft in the model's attribute too, for attributes that move: a normal in the camera's frame turns with
//! the camera. The windows are those of the generalized partial volume (H. Chen and P. Varshney, *Mutual information-based CT-MR
//! brain image registration using generalized partial volume joint histogram estimation*, IEEE TMI 22(9), 2003): B-splines of
//! second order along each component of the attribute, and the cubic one along the photo's values.
//!
//! `p(c, a, v) = 1/N Σ_i [c_i = c] β²(x_i − a₁) β²(y_i − a₂) β³(b_i − v)` for samples of class `c_i` and attribute `(x_i, y_i)`.

use crate::spline::{cubic, quadratic};
use crate::{Density, Joint, Real};
use rayon::prelude::*;

/// Samples whose model attribute is a pair of numbers, within a class.
#[derive(Clone, Copy, Debug)]
pub struct SoftSamples<'a, T = f32> {
    /// The class of each sample; one of `classes` or more has no attribute and a row of its own.
    pub class: &'a [u16],
    /// The attribute, each component in `0.0..=1.0`.
    pub attribute: &'a [[T; 2]],
    /// What the photo shows, in `0.0..=1.0` (values outside are clamped); NaN where the sample fell outside the photo.
    pub photo: &'a [T],
}

/// A joint histogram that is soft on both sides.
///
/// Rows are classes of `steps × steps` bins of the attribute (the second component major), then those of the classes without
/// attributes. Components of `0..=1` are mapped to the bins `1..=steps − 2`. A score holds the derivatives by both components of
/// the attribute and by the photo value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SoftParzen {
    /// Classes with an attribute.
    pub classes: usize,
    /// Bins of each component, at least 4.
    pub steps: usize,
    /// Classes without an attribute.
    pub others: usize,
    /// The number of photo bins, at least 4.
    pub photo_bins: usize,
}

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1 << 14;

/// Where a number's window lies, and what it weighs.
struct Window<T, const N: usize> {
    first: usize,
    weights: [T; N],
    slopes: [T; N],
}

impl SoftParzen {
    /// The number of rows.
    #[must_use]
    pub fn model_bins(&self) -> usize {
        self.classes * self.steps * self.steps + self.others
    }

    fn attribute<T: Real>(&self, value: T) -> Window<T, 3> {
        let scale = T::of((self.steps - 3) as f64);
        let place = T::of(1.0) + value.unit() * scale;
        let middle = (place + T::of(0.5)).whole().clamp(1, self.steps - 2);
        let (weights, slopes) = quadratic(place - T::of(middle as f64));
        let moves = value >= T::default() && value <= T::of(1.0);
        let slopes = slopes.map(|slope| if moves { slope * scale } else { T::default() });
        Window { first: middle - 1, weights, slopes }
    }

    fn photo<T: Real>(&self, value: T) -> Window<T, 4> {
        let zero = T::default();
        if value.is_missing() {
            return Window { first: self.photo_bins, weights: [T::of(1.0), zero, zero, zero], slopes: [zero; 4] };
        }
        let scale = T::of((self.photo_bins - 3) as f64);
        let place = value.unit() * scale;
        let first = place.whole().min(self.photo_bins - 4);
        let (weights, slopes) = cubic(place - T::of(first as f64));
        let moves = value >= zero && value <= T::of(1.0);
        Window { first, weights, slopes: slopes.map(|slope| if moves { slope * scale } else { zero }) }
    }

    /// The rows a sample touches, with their weights and the derivatives of these.
    fn rows<T: Real>(&self, class: u16, attribute: [T; 2], mut visit: impl FnMut(usize, T, [T; 2])) {
        let class = usize::from(class);
        let square = self.steps * self.steps;
        if class >= self.classes {
            visit(self.classes * square + class - self.classes, T::of(1.0), [T::default(); 2]);
            return;
        }
        let (x, y) = (self.attribute(attribute[0]), self.attribute(attribute[1]));
        for j in 0..3 {
            for i in 0..3 {
                let row = class * square + (y.first + j) * self.steps + x.first + i;
                visit(row, x.weights[i] * y.weights[j], [x.slopes[i] * y.weights[j], x.weights[i] * y.slopes[j]]);
            }
        }
    }
}

impl<T: Real> Density<SoftSamples<'_, T>> for SoftParzen {
    type Score = [T; 3];

    fn estimate(&self, samples: &SoftSamples<T>) -> Joint {
        assert!(self.steps >= 4 && self.photo_bins >= 4, "windows span three bins and four");
        let columns = self.photo_bins + 1;
        let SoftSamples { class, attribute, photo } = samples;
        let tables: Vec<Vec<T>> = (class.par_chunks(CHUNK), attribute.par_chunks(CHUNK), photo.par_chunks(CHUNK))
            .into_par_iter()
            .map(|(class, attribute, photo)| {
                let mut table = vec![T::default(); self.model_bins() * columns];
                for ((&class, &attribute), &v) in class.iter().zip(attribute).zip(photo) {
                    let window = self.photo(v);
                    self.rows(class, attribute, |row, weight, _| {
                        let cells = &mut table[row * columns..][window.first..columns];
                        cells.iter_mut().zip(window.weights).for_each(|(cell, w)| *cell += weight * w);
                    });
                }
                table
            })
            .collect();
        let mut masses = vec![0.0; self.model_bins() * columns];
        for table in tables {
            masses.iter_mut().zip(table).for_each(|(sum, mass)| *sum += mass.into());
        }
        Joint::from_masses(self.model_bins(), masses)
    }

    fn scores(&self, samples: &SoftSamples<T>, derivative: &[f64]) -> Vec<[T; 3]> {
        let columns = self.photo_bins + 1;
        assert_eq!(derivative.len(), self.model_bins() * columns, "one derivative for each cell of the estimate");
        let table: Vec<T> = derivative.iter().map(|&d| T::of(d)).collect();
        let SoftSamples { class, attribute, photo } = samples;
        let score = |((&class, &attribute), &v): ((&u16, &[T; 2]), &T)| {
            let window = self.photo(v);
            let mut score = [T::default(); 3];
            self.rows(class, attribute, |row, weight, slopes| {
                let cells = &table[row * columns..][window.first..columns];
                let (mut level, mut slope) = (T::default(), T::default());
                for ((&cell, w), s) in cells.iter().zip(window.weights).zip(window.slopes) {
                    level += cell * w;
                    slope += cell * s;
                }
                score[0] += slopes[0] * level;
                score[1] += slopes[1] * level;
                score[2] += weight * slope;
            });
            score
        };
        class.par_iter().zip(*attribute).zip(*photo).with_min_len(CHUNK).map(score).collect()
    }
}
