//! The photo as the metric reads it: values in `0..=1` at full, half, quarter … size, interpolated by cubic B-splines.

use crate::contour::Silhouette;
use crate::grid::Grid;
use rayon::prelude::*;
use texreg_camera::Camera;
use texreg_mi::Real;

/// One size of a photo's values.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    /// Pixels of this level per pixel of the photo: 1, ½, ¼ …
    pub scale: f64,
    /// Pixels a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The values.
    pub grid: Grid<f32>,
    /// Where the photo shows the object, if that is known.
    pub silhouette: Option<Silhouette>,
}

impl Level {
    /// A level from `width × height` values, row by row.
    pub(crate) fn new(scale: f64, width: usize, height: usize, values: &[f32]) -> Self {
        Self { scale, width, height, grid: Grid::new(width, height, values), silhouette: None }
    }

    /// The camera that sees this level, from the one that sees the photo.
    pub(crate) fn camera(&self, photo: &Camera) -> Camera {
        Camera { width: self.width as u32, height: self.height as u32, ..photo.scaled(self.scale) }
    }

    /// The values of one row.
    pub(crate) fn row(&self, y: usize) -> &[f32] {
        self.grid.row(y)
    }

    /// Value and gradient `(v, ∂v/∂x, ∂v/∂y)` at a place in this level's pixels; `None` outside the picture.
    #[inline(always)]
    pub(crate) fn sample<T: Real>(&self, x: f64, y: f64) -> Option<[T; 3]> {
        self.grid.sample(x, y)
    }

    /// The level of half the size: means of blocks of 2×2 pixels (an odd last row or column is dropped).
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut values = vec![0.0; width * height];
        values.par_chunks_mut(width).enumerate().for_each(|(y, out)| {
            let (above, below) = (self.row(2 * y), self.row(2 * y + 1));
            for (x, value) in out.iter_mut().enumerate() {
                *value = 0.25 * (above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1]);
            }
        });
        Self::new(0.5 * self.scale, width, height, &values)
    }
}

/// The levels of a photo's values, full size first, each half the size of the one before, down to `smallest` pixels on the
/// longer side.
pub(crate) fn pyramid(width: usize, height: usize, values: &[f32], smallest: usize) -> Vec<Level> {
    let mut levels = vec![Level::new(1.0, width, height, values)];
    while let Some(last) =
        levels.last().filter(|last| last.width.max(last.height) >= 2 * smallest && last.width.min(last.height) >= 8)
    {
        levels.push(last.halved());
    }
    levels
}

/// Spreads values so that their distribution, but for the outermost tails, fills `0..=1`.
///
/// The map is linear between the quantiles `tail` and `1 − tail` and clamps beyond them.
pub(crate) fn spread(values: &mut [f32], tail: f64) {
    let mut sorted: Vec<f32> = values.iter().step_by(values.len() / 20_000 + 1).copied().collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let quantile = |share: f64| sorted[((sorted.len() - 1) as f64 * share).round() as usize];
    let (low, high) = (quantile(tail), quantile(1.0 - tail));
    let range = (high - low).max(1e-6);
    values.par_iter_mut().for_each(|value| *value = ((*value - low) / range).clamp(0.0, 1.0));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize) -> Vec<f32> {
        let at = |x: f32, y: f32| 0.5 + 0.3 * (0.4 * x).sin() * (0.3 * y).cos() + 0.01 * x;
        (0..width * height).map(|i| at((i % width) as f32, (i / width) as f32)).collect()
    }

    #[test]
    fn the_gradient_is_the_slope_of_the_value() {
        let level = Level::new(1.0, 31, 23, &picture(31, 23));
        for (x, y) in [(10.3, 7.8), (0.1, 22.2), (-0.3, 0.0), (29.99, 3.5), (15.0, 11.0)] {
            let h = 1.0 / 64.0;
            let value = |x: f64, y: f64| level.sample::<f64>(x, y).unwrap()[0];
            let [_, dx, dy] = level.sample::<f64>(x, y).unwrap();
            assert!((dx - (value(x + h, y) - value(x - h, y)) / (2.0 * h)).abs() < 1e-4, "x at {x}, {y}");
            assert!((dy - (value(x, y + h) - value(x, y - h)) / (2.0 * h)).abs() < 1e-4, "y at {x}, {y}");
        }
    }

    #[test]
    fn outside_is_outside() {
        let level = Level::new(1.0, 31, 23, &picture(31, 23));
        for (x, y) in [(-0.51, 5.0), (30.51, 5.0), (5.0, -0.51), (5.0, 22.51), (f64::NAN, 5.0), (1e30, 5.0)] {
            assert!(level.sample::<f32>(x, y).is_none(), "{x}, {y}");
        }
        assert!(level.sample::<f32>(-0.5, 22.5).is_some());
    }

    #[test]
    fn halves_stay_in_place() {
        // A linear ramp: the same surface point has the same value in every level.
        let values: Vec<f32> = (0..64 * 48).map(|i| (i % 64) as f32 / 64.0).collect();
        let levels = pyramid(64, 48, &values, 16);
        assert_eq!(levels.iter().map(|l| l.width).collect::<Vec<_>>(), [64, 32, 16]);
        for level in &levels {
            let (x, y) = ((20.2 + 0.5) * level.scale - 0.5, (17.0 + 0.5) * level.scale - 0.5);
            assert!((level.sample::<f32>(x, y).unwrap()[0] - 20.2 / 64.0).abs() < 1e-5);
        }
    }

    #[test]
    fn spreading_fills_the_range() {
        let mut values: Vec<f32> = (0..1000).map(|i| 0.4 + 0.0001 * i as f32).collect();
        spread(&mut values, 0.01);
        assert_eq!((values[0], values[999]), (0.0, 1.0));
        assert!((values[500] - 0.5).abs() < 0.01);
        let mut flat = vec![0.3; 10];
        spread(&mut flat, 0.01);
        assert!(flat.iter().all(|v| (0.0..=1.0).contains(v)));
    }
}
