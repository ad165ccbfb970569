//! The affine part of a camera: distorted normalized coordinates to pixels.

use nalgebra::{Matrix2, Matrix2x5, Matrix3, Point2, Vector2};

/// `u = fx x + skew y + cx`, `v = fy y + cy`, for distorted normalized coordinates (x, y) and pixels (u, v).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point's u, pixels.
    pub cx: f64,
    /// Principal point's v, pixels.
    pub cy: f64,
    /// Pixels u moves per unit of normalized y.
    pub skew: f64,
}

impl Intrinsics {
    /// Square pixels, no skew.
    pub fn new(focal: f64, cx: f64, cy: f64) -> Self {
        Self { fx: focal, fy: focal, cx, cy, skew: 0.0 }
    }

    /// Distorted normalized coordinates to pixels.
    #[inline]
    pub fn apply(&self, p: &Vector2<f64>) -> Point2<f64> {
        Point2::new(self.fx * p.x + self.skew * p.y + self.cx, self.fy * p.y + self.cy)
    }

    /// Pixels to distorted normalized coordinates.
    #[inline]
    pub fn invert(&self, pixel: &Point2<f64>) -> Vector2<f64> {
        let y = (pixel.y - self.cy) / self.fy;
        Vector2::new((pixel.x - self.cx - self.skew * y) / self.fx, y)
    }

    /// ∂(u, v)/∂(x, y).
    #[inline]
    pub fn linear(&self) -> Matrix2<f64> {
        Matrix2::new(self.fx, self.skew, 0.0, self.fy)
    }

    /// ∂(u, v)/∂(fx, fy, cx, cy, skew) at distorted normalized coordinates.
    #[rustfmt::skip]
    pub fn jacobian(&self, p: &Vector2<f64>) -> Matrix2x5<f64> {
        Matrix2x5::new(
            p.x, 0.0, 1.0, 0.0, p.y,
            0.0, p.y, 0.0, 1.0, 0.0,
        )
    }

    /// The calibration matrix K.
    #[rustfmt::skip]
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(
            self.fx, self.skew, self.cx,
            0.0, self.fy, self.cy,
            0.0, 0.0, 1.0,
        )
    }

    /// The intrinsics of the same image resized by `factor`, pixel centres at integers before and after:
    /// `u' = (u + 0.5) factor − 0.5`.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            fx: self.fx * factor,
            fy: self.fy * factor,
            cx: (self.cx + 0.5) * factor - 0.5,
            cy: (self.cy + 0.5) * factor - 0.5,
            skew: self.skew * factor,
        }
    }

    /// `[fx, fy, cx, cy, skew]`, the order of the Jacobian's columns.
    pub fn to_array(&self) -> [f64; 5] {
        [self.fx, self.fy, self.cx, self.cy, self.skew]
    }
}

/// From `[fx, fy, cx, cy, skew]`.
impl From<[f64; 5]> for Intrinsics {
    fn from([fx, fy, cx, cy, skew]: [f64; 5]) -> Self {
        Self { fx, fy, cx, cy, skew }
    }
}
