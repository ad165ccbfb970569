//! Partial volume: no photo value is interpolated; each sample is shared out among the bins of the pixels around its place.
//!
//! Sources: F. Maes et al., *Multimodality image registration by maximization of mutual information*, IEEE TMI 16(2), 1997
//! (bilinear shares); H. Chen and P. Varshney, *Mutual information-based CT-MR brain image registration using generalized partial
//! volume joint histogram estimation*, IEEE TMI 22(9), 2003 (B-splines of higher order, which remove the artefacts at whole
//! pixels). `p(u, v) = 1/N Σ_i [u_i = u] Σ_n w(x_i − n) [v_n = v]` over the pixels `n`.

use crate::spline::cubic;
use crate::{Density, Joint, Real};
use rayon::prelude::*;

/// A photo as bins, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BinnedPhoto {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The bin of each pixel.
    pub bins: Vec<u16>,
}

/// Samples at places of a binned photo.
#[derive(Clone, Copy, Debug)]
pub struct Places<'a, T = f64> {
    /// The model's bins, `0..model_bins`.
    pub model: &'a [u16],
    /// Where the photo shows each sample, `(x, y)` with pixel centres at whole numbers.
    pub places: &'a [[T; 2]],
    /// The photo.
    pub photo: &'a BinnedPhoto,
}

/// How a sample is shared out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Sharing {
    /// Bilinear, among 2 × 2 pixels: Maes' partial volume.
    #[default]
    Linear,
    /// By cubic B-splines, among 4 × 4 pixels: the generalized partial volume of third order. Twice differentiable.
    Cubic,
}

/// A joint histogram by partial volume; a score holds the derivatives by `x` and `y`. Column `photo_bins` takes the samples
/// outside the photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PartialVolume {
    /// The number of model bins.
    pub model_bins: usize,
    /// The number of photo bins.
    pub photo_bins: usize,
    /// The kernel.
    pub sharing: Sharing,
}

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1 << 14;

impl PartialVolume {
    /// The bins around a place, with their weights and the derivatives of these. Beyond its border the photo goes on as there.
    #[inline]
    fn around<T: Real>(&self, photo: &BinnedPhoto, [x, y]: [T; 2], mut visit: impl FnMut(usize, T, [T; 2])) {
        let margin = T::of(-0.5);
        let limit = |side: usize| T::of(side as f64 - 0.5);
        let inside = x >= margin && y >= margin && x <= limit(photo.width) && y <= limit(photo.height);
        let one = T::of(1.0);
        if !inside {
            visit(self.photo_bins, one, [T::default(); 2]);
            return;
        }
        let place = |value: T| {
            let shifted = (value + one).whole();
            (shifted, value + one - T::of(shifted as f64))
        };
        let ((column, tx), (row, ty)) = (place(x), place(y));
        let (skip, (wx, dx), (wy, dy)) = match self.sharing {
            Sharing::Linear => {
                let zero = T::default();
                let linear = |t: T| ([zero, one - t, t, zero], [zero, zero - one, one, zero]);
                (1, linear(tx), linear(ty))
            }
            Sharing::Cubic => (0, cubic(tx), cubic(ty)),
        };
        for j in skip..4 - skip {
            let line = (row + j).saturating_sub(2).min(photo.height - 1) * photo.width;
            for i in skip..4 - skip {
                let bin = photo.bins[line + (column + i).saturating_sub(2).min(photo.width - 1)];
                visit(usize::from(bin), wx[i] * wy[j], [dx[i] * wy[j], wx[i] * dy[j]]);
            }
        }
    }
}

impl<T: Real> Density<Places<'_, T>> for PartialVolume {
    type Score = [T; 2];

    fn estimate(&self, samples: &Places<T>) -> Joint {
        let columns = self.photo_bins + 1;
        let tables: Vec<Vec<T>> = (samples.model.par_chunks(CHUNK), samples.places.par_chunks(CHUNK))
            .into_par_iter()
            .map(|(model, places)| {
                let mut table = vec![T::default(); self.model_bins * columns];
                for (&u, &place) in model.iter().zip(places) {
                    let row = &mut table[usize::from(u) * columns..][..columns];
                    self.around(samples.photo, place, |bin, weight, _| row[bin] += weight);
                }
                table
            })
            .collect();
        let mut masses = vec![0.0; self.model_bins * columns];
        for table in tables {
            masses.iter_mut().zip(table).for_each(|(sum, mass)| *sum += mass.into());
        }
        Joint::from_masses(self.model_bins, masses)
    }

    fn scores(&self, samples: &Places<T>, derivative: &[f64]) -> Vec<[T; 2]> {
        let columns = self.photo_bins + 1;
        assert_eq!(derivative.len(), self.model_bins * columns, "one derivative for each cell of the estimate");
        let score = |(&u, &place): (&u16, &[T; 2])| {
            let row = &derivative[usize::from(u) * columns..][..columns];
            let mut score = [T::default(); 2];
            self.around(samples.photo, place, |bin, _, [dx, dy]| {
                let cell = T::of(row[bin]);
                score[0] += cell * dx;
                score[1] += cell * dy;
            });
            score
        };
        samples.model.par_iter().zip(samples.places).with_min_len(CHUNK).map(score).collect()
    }
}
