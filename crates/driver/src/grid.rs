//! A picture as a function of the place: values at whole pixels, weighted by the cubic B-spline.
//!
//! Without the prefilter that would make it interpolate: the slight smoothing (standard deviation 0.58 px) is wanted, and the
//! picture is twice continuously differentiable.

use rayon::prelude::*;
use texreg_mi::{Real, cubic};

/// A picture of coefficients of type `C`, with a margin of [`MARGIN`] repeated pixels on each side.
#[derive(Clone, Debug)]
pub(crate) struct Grid<C> {
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    padded: Vec<C>,
}

/// The cubic window reaches two pixels beyond the border.
const MARGIN: usize = 2;

impl<C: Real> Grid<C> {
    /// A picture of `width × height` coefficients, row by row.
    pub(crate) fn new(width: usize, height: usize, values: &[C]) -> Self {
        assert_eq!(values.len(), width * height, "one value a pixel");
        let stride = width + 2 * MARGIN;
        let mut padded = vec![C::default(); stride * (height + 2 * MARGIN)];
        padded.par_chunks_mut(stride).enumerate().for_each(|(y, row)| {
            let source = &values[y.saturating_sub(MARGIN).min(height - 1) * width..][..width];
            row[..MARGIN].fill(source[0]);
            row[MARGIN..MARGIN + width].copy_from_slice(source);
            row[MARGIN + width..].fill(source[width - 1]);
        });
        Self { width, height, padded }
    }

    /// The coefficients of one row, without the margin.
    pub(crate) fn row(&self, y: usize) -> &[C] {
        &self.padded[(y + MARGIN) * (self.width + 2 * MARGIN) + MARGIN..][..self.width]
    }

    /// Value and gradient `(v, ∂v/∂x, ∂v/∂y)` at a place, pixel centres at whole numbers; `None` outside the picture.
    #[inline(always)]
    pub(crate) fn sample<T: Real>(&self, x: f64, y: f64) -> Option<[T; 3]> {
        let (first, [tx, ty]) = self.place(x, y)?;
        let ((wx, dx), (wy, dy)) = (cubic(T::of(tx)), cubic(T::of(ty)));
        let [values, slopes] = self.columns(first, [wy, dy]);
        Some([dot(values, wx), dot(values, dx), dot(slopes, wx)])
    }

    /// The gradient at a place, and the second derivatives `(∂²v/∂x², ∂²v/∂x∂y, ∂²v/∂y²)`; `None` outside the picture.
    #[inline(always)]
    pub(crate) fn bend<T: Real>(&self, x: f64, y: f64) -> Option<([T; 2], [T; 3])> {
        let (first, [tx, ty]) = self.place(x, y)?;
        let ((wx, dx), (wy, dy)) = (cubic(T::of(tx)), cubic(T::of(ty)));
        let (bx, by) = (second(T::of(tx)), second(T::of(ty)));
        let [values, slopes, bends] = self.columns(first, [wy, dy, by]);
        let gradient = [dot(values, dx), dot(slopes, wx)];
        Some((gradient, [dot(values, bx), dot(slopes, dx), dot(bends, wx)]))
    }

    /// The four columns around a place, each weighed down the rows in several ways.
    #[inline(always)]
    fn columns<T: Real, const N: usize>(&self, first: usize, weights: [[T; 4]; N]) -> [[T; 4]; N] {
        let mut sums = [[T::default(); 4]; N];
        for j in 0..4 {
            let line = &self.padded[first + j * (self.width + 2 * MARGIN)..][..4];
            for (sums, weights) in sums.iter_mut().zip(&weights) {
                for (sum, &value) in sums.iter_mut().zip(line) {
                    *sum += weights[j] * T::of(value.into());
                }
            }
        }
        sums
    }

    /// The index of the first coefficient around a place, and the place between the second and the third.
    #[inline(always)]
    fn place(&self, x: f64, y: f64) -> Option<(usize, [f64; 2])> {
        let inside = x >= -0.5 && y >= -0.5 && x <= self.width as f64 - 0.5 && y <= self.height as f64 - 0.5;
        if !inside {
            return None;
        }
        // Both are at least -0.5: after adding the margin, truncation is the floor.
        let (x, y) = (x + MARGIN as f64, y + MARGIN as f64);
        let (column, row) = (x as usize, y as usize);
        Some(((row - 1) * (self.width + 2 * MARGIN) + column - 1, [x - column as f64, y - row as f64]))
    }
}

#[inline(always)]
fn dot<T: Real>(a: [T; 4], b: [T; 4]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]
}

/// The second derivative of [`cubic`].
#[inline(always)]
fn second<T: Real>(t: T) -> [T; 4] {
    let c = T::of;
    let s = c(1.0) - t;
    [s, c(3.0) * t - c(2.0), c(3.0) * s - c(2.0), t]
}
