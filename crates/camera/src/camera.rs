//! A camera: intrinsics and distortion, between points of the camera frame and pixels.

use crate::{Distortion, Intrinsics};
use nalgebra::{Matrix2, Matrix2x3, Matrix2x5, Point2, Point3, Vector2, Vector3};

/// F(K, C): the projection `(X, Y, Z) → (X/Z, Y/Z) → distortion → intrinsics → pixel`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Image width in pixels.
    pub width: u32,
    /// Image height in pixels.
    pub height: u32,
    /// K.
    pub intrinsics: Intrinsics,
    /// C.
    pub distortion: Distortion,
}

/// A projected point and every derivative of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// The pixel.
    pub pixel: Point2<f64>,
    /// ∂pixel/∂(X, Y, Z) in the camera frame.
    pub point: Matrix2x3<f64>,
    /// ∂pixel/∂(fx, fy, cx, cy, skew).
    pub intrinsics: Matrix2x5<f64>,
    /// ∂pixel/∂(k1, k2, p1, p2, k3).
    pub distortion: Matrix2x5<f64>,
}

impl Camera {
    /// A camera without distortion, square pixels, principal point at the image's centre.
    pub fn ideal(width: u32, height: u32, focal: f64) -> Self {
        let center = |size: u32| 0.5 * (f64::from(size) - 1.0);
        Self {
            width,
            height,
            intrinsics: Intrinsics::new(focal, center(width), center(height)),
            distortion: Distortion::default(),
        }
    }

    /// The pixel of a point in the camera frame; `None` for points not in front of the camera, outside the distortion's
    /// domain, or not finite. The pixel may lie outside the image, see [`contains`](Self::contains).
    #[inline]
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let p = normalized(point)?;
        Some(self.intrinsics.apply(&self.distortion.apply(&p)?))
    }

    /// [`project`](Self::project), and ∂pixel/∂(X, Y, Z).
    #[inline]
    pub fn project_with_jacobian(&self, point: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let p = normalized(point)?;
        if self.distortion.is_none() {
            return Some((self.intrinsics.apply(&p), point_jacobian(&self.intrinsics.linear(), &p, point.z)));
        }
        self.distorted_with_jacobian(&p, point.z)
    }

    fn distorted_with_jacobian(&self, p: &Vector2<f64>, z: f64) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let (distorted, slope) = self.distortion.apply_with_jacobian(p)?;
        let jacobian = point_jacobian(&(self.intrinsics.linear() * slope), p, z);
        Some((self.intrinsics.apply(&distorted), jacobian))
    }

    /// [`project`](Self::project), and the derivatives with respect to the point and every parameter of the camera.
    pub fn project_with_jacobians(&self, point: &Point3<f64>) -> Option<Projection> {
        let p = normalized(point)?;
        let (distorted, slope) = self.distortion.apply_with_jacobian(&p)?;
        let linear = self.intrinsics.linear();
        Some(Projection {
            pixel: self.intrinsics.apply(&distorted),
            point: point_jacobian(&(linear * slope), &p, point.z),
            intrinsics: self.intrinsics.jacobian(&distorted),
            distortion: linear * self.distortion.jacobian(&p),
        })
    }

    /// The direction (x, y, 1) in the camera frame that is seen at a pixel, or `None` where the distortion has no inverse.
    #[inline]
    pub fn unproject(&self, pixel: &Point2<f64>) -> Option<Vector3<f64>> {
        let p = self.distortion.invert(&self.intrinsics.invert(pixel))?;
        (p.x.is_finite() && p.y.is_finite()).then(|| p.push(1.0))
    }

    /// Whether a pixel lies inside the image, −0.5 … W − 0.5 by −0.5 … H − 0.5.
    pub fn contains(&self, pixel: &Point2<f64>) -> bool {
        let inside = |x: f64, size: u32| x >= -0.5 && x < f64::from(size) - 0.5;
        inside(pixel.x, self.width) && inside(pixel.y, self.height)
    }

    /// The camera of the same image resized by `factor`, sizes rounded, pixel centres at integers before and after.
    pub fn scaled(&self, factor: f64) -> Self {
        let size = |n: u32| ((f64::from(n) * factor).round() as u32).max(1);
        Self {
            width: size(self.width),
            height: size(self.height),
            intrinsics: self.intrinsics.scaled(factor),
            distortion: self.distortion,
        }
    }
}

/// (X/Z, Y/Z) for finite points with Z > 0.
#[inline]
fn normalized(point: &Point3<f64>) -> Option<Vector2<f64>> {
    let inverse = 1.0 / point.z;
    let p = Vector2::new(point.x * inverse, point.y * inverse);
    (point.z > 0.0 && p.x.is_finite() && p.y.is_finite()).then_some(p)
}

/// The chain rule through (X/Z, Y/Z): ∂pixel/∂(x, y) to ∂pixel/∂(X, Y, Z).
#[inline]
fn point_jacobian(plane: &Matrix2<f64>, p: &Vector2<f64>, z: f64) -> Matrix2x3<f64> {
    let scaled = plane * (1.0 / z);
    let depth = -(scaled * p);
    Matrix2x3::from_columns(&[scaled.column(0).into_owned(), scaled.column(1).into_owned(), depth])
}
