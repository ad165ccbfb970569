//! Grey images, borrowed, and their half-size copies.

/// A grey image: row-major from the top left, brighter is larger, black about 0 and white about 1.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    width: usize,
    height: usize,
    values: &'a [f32],
}

impl<'a> Image<'a> {
    /// `None` if the values are not `width · height` many.
    pub fn new(width: usize, height: usize, values: &'a [f32]) -> Option<Self> {
        (width.checked_mul(height) == Some(values.len())).then_some(Self { width, height, values })
    }

    /// In pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// In pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Row-major.
    pub fn values(&self) -> &'a [f32] {
        self.values
    }

    /// Whether a position is at least `margin` pixels from the outermost pixels' centres.
    #[inline]
    pub(crate) fn contains(&self, x: f64, y: f64, margin: f64) -> bool {
        x >= margin && y >= margin && x <= self.width as f64 - 1.0 - margin && y <= self.height as f64 - 1.0 - margin
    }

    /// The bilinear value, the border repeated outside.
    #[inline]
    pub(crate) fn sample(&self, x: f64, y: f64) -> f32 {
        let x = x.clamp(0.0, self.width as f64 - 1.0);
        let y = y.clamp(0.0, self.height as f64 - 1.0);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (fx, fy) = ((x - left as f64) as f32, (y - top as f64) as f32);
        let at = |x: usize, y: usize| self.values[y * self.width + x];
        let upper = at(left, top) + fx * (at(right, top) - at(left, top));
        let lower = at(left, bottom) + fx * (at(right, bottom) - at(left, bottom));
        upper + fy * (lower - upper)
    }

    /// The means of 2×2 pixels: `(half width, half height, values)`. A position x here is (x + 0.5)/2 − 0.5 there.
    pub(crate) fn halved(&self) -> (usize, usize, Vec<f32>) {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut values = Vec::with_capacity(width * height);
        for rows in self.values.chunks_exact(2 * self.width.max(1)).take(height) {
            let (upper, lower) = rows.split_at(self.width);
            let pairs = upper.as_chunks::<2>().0.iter().zip(lower.as_chunks::<2>().0);
            values.extend(pairs.map(|(a, b)| 0.25 * (a[0] + a[1] + b[0] + b[1])));
        }
        (width, height, values)
    }
}
