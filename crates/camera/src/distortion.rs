//! Brown–Conrady lens distortion in Bouguet's and OpenCV's order (D. C. Brown, *Close-range camera calibration*, 1971).
//!
//! With `x, y` the undistorted normalized coordinates, `s = x² + y²` and `g(s) = 1 + k1 s + k2 s² + k3 s³`:
//!
//! ```text
//! x_d = x g(s) + 2 p1 x y + p2 (s + 2 x²)
//! y_d = y g(s) + p1 (s + 2 y²) + 2 p2 x y
//! ```
//!
//! The model is used only where it is one to one: the distorted radius must grow with the undistorted one all the way
//! out to the point, `1 + 3 k1 s + 5 k2 s² + 7 k3 s³ > 0` on [0, s], and the Jacobian there must keep its orientation.

use nalgebra::{Matrix2, Matrix2x5, Vector2};

/// The coefficients; all zero (the default) is a lens without distortion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Distortion {
    /// Radial, times s.
    pub k1: f64,
    /// Radial, times s².
    pub k2: f64,
    /// Tangential, along y.
    pub p1: f64,
    /// Tangential, along x.
    pub p2: f64,
    /// Radial, times s³.
    pub k3: f64,
}

impl Distortion {
    /// Whether all coefficients are zero.
    #[inline]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Undistorted to distorted normalized coordinates; `None` outside the domain.
    #[inline]
    pub fn apply(&self, p: &Vector2<f64>) -> Option<Vector2<f64>> {
        if self.is_none() { Some(*p) } else { self.apply_with_jacobian(p).map(|(distorted, _)| distorted) }
    }

    /// [`apply`](Self::apply), and ∂(x_d, y_d)/∂(x, y).
    pub fn apply_with_jacobian(&self, p: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        if self.is_none() {
            return Some((*p, Matrix2::identity()));
        }
        let (distorted, jacobian) = self.evaluate(p);
        (self.is_monotone(p.norm_squared()) && jacobian.determinant() > 0.0).then_some((distorted, jacobian))
    }

    /// The formulas themselves, wherever they are asked for: what [`apply_with_jacobian`](Self::apply_with_jacobian) gives within
    /// the domain. For loops over many points, which check the domain themselves.
    #[inline(always)]
    pub fn evaluate(&self, p: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let Self { k1, k2, p1, p2, k3 } = *self;
        let (x, y, s) = (p.x, p.y, p.norm_squared());
        let g = 1.0 + s * (k1 + s * (k2 + s * k3));
        let dg = 2.0 * (k1 + s * (2.0 * k2 + s * 3.0 * k3));
        let xy = x * y;
        let distorted = Vector2::new(
            x * g + 2.0 * p1 * xy + p2 * (s + 2.0 * x * x),
            y * g + p1 * (s + 2.0 * y * y) + 2.0 * p2 * xy,
        );
        let mixed = dg * xy + 2.0 * (p1 * x + p2 * y);
        let jacobian = Matrix2::new(
            g + dg * x * x + 2.0 * p1 * y + 6.0 * p2 * x,
            mixed,
            mixed,
            g + dg * y * y + 6.0 * p1 * y + 2.0 * p2 * x,
        );
        (distorted, jacobian)
    }

    /// ∂(x_d, y_d)/∂(k1, k2, p1, p2, k3) at undistorted normalized coordinates.
    #[rustfmt::skip]
    pub fn jacobian(&self, p: &Vector2<f64>) -> Matrix2x5<f64> {
        let (x, y, s) = (p.x, p.y, p.norm_squared());
        Matrix2x5::new(
            x * s, x * s * s, 2.0 * x * y, s + 2.0 * x * x, x * s * s * s,
            y * s, y * s * s, s + 2.0 * y * y, 2.0 * x * y, y * s * s * s,
        )
    }

    /// Distorted to undistorted normalized coordinates, to full precision; `None` if nothing in the domain maps there.
    ///
    /// Newton's method in the plane finds nearly all points at once. For the others the radial part alone is inverted first, by
    /// Newton's method kept inside a bracket.
    #[inline]
    pub fn invert(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        if self.is_none() {
            return Some(*distorted);
        }
        let from_itself = self.invert_from(*distorted, distorted);
        from_itself.filter(|p| self.is_plainly_monotone(p.norm_squared())).or_else(|| self.invert_by_radius(distorted))
    }

    fn invert_by_radius(&self, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let r_d = distorted.norm();
        let start = if r_d == 0.0 { *distorted } else { distorted * (self.invert_radius(r_d)? / r_d) };
        self.invert_from(start, distorted).filter(|p| self.is_monotone(p.norm_squared()))
    }

    /// Newton's method in the plane, to full precision; `None` where it does not converge or the Jacobian turns over.
    fn invert_from(&self, mut p: Vector2<f64>, distorted: &Vector2<f64>) -> Option<Vector2<f64>> {
        let r_d = distorted.norm();
        let tolerance = 4.0 * f64::EPSILON * (r_d + f64::MIN_POSITIVE);
        let (mut value, mut jacobian) = self.evaluate(&p);
        for _ in 0..20 {
            let error = distorted - value;
            if error.norm() <= tolerance {
                break;
            }
            let step = jacobian.try_inverse()? * error;
            p += step;
            (value, jacobian) = self.evaluate(&p);
            if step.norm() <= tolerance {
                break;
            }
        }
        ((value - distorted).norm() <= 1e-12 * (1.0 + r_d) && jacobian.determinant() > 0.0).then_some(p)
    }

    /// The undistorted radius at which the radial part reaches `r_d > 0`.
    fn invert_radius(&self, r_d: f64) -> Option<f64> {
        let reach = |r: f64| {
            let s = r * r;
            r * (1.0 + s * (self.k1 + s * (self.k2 + s * self.k3)))
        };
        let (mut low, mut high) = (0.0, self.domain().sqrt());
        if high.is_infinite() {
            // Monotone without end, so every radius is reached.
            high = r_d;
            while reach(high) < r_d {
                high *= 2.0;
            }
        } else if reach(high) < r_d {
            // The tangential part may still bring a point near the rim inside.
            return Some(high * (1.0 - 1e-6)).filter(|_| self.p1 != 0.0 || self.p2 != 0.0);
        }
        let mut r = r_d.min(high);
        for _ in 0..100 {
            let error = reach(r) - r_d;
            if error > 0.0 {
                high = r;
            } else {
                low = r;
            }
            let newton = r - error / self.slope(r * r);
            let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
            if (next - r).abs() <= f64::EPSILON * r {
                return Some(next);
            }
            r = next;
        }
        Some(r)
    }

    /// d r_d / d r as a function of s = r².
    fn slope(&self, s: f64) -> f64 {
        1.0 + s * (3.0 * self.k1 + s * (5.0 * self.k2 + s * 7.0 * self.k3))
    }

    /// Whether the slope is positive on all of [0, s].
    fn is_monotone(&self, s: f64) -> bool {
        self.is_plainly_monotone(s) || (self.slope(s) > 0.0 && s < self.domain())
    }

    /// The same by the negative terms alone, which bound the slope from below and only fall; most points pass here.
    fn is_plainly_monotone(&self, s: f64) -> bool {
        1.0 + s * (3.0 * self.k1.min(0.0) + s * (5.0 * self.k2.min(0.0) + s * 7.0 * self.k3.min(0.0))) > 0.0
    }

    /// The squared undistorted radius up to which the radial part grows: the smallest positive root of the slope, or
    /// infinity.
    pub fn domain(&self) -> f64 {
        // Stationary points of the slope split [0, ∞) into pieces on which it is monotone.
        let (a, b, c) = (21.0 * self.k3, 10.0 * self.k2, 3.0 * self.k1);
        let mut knots = [f64::INFINITY; 3];
        if a == 0.0 {
            if b != 0.0 {
                knots[0] = -c / b;
            }
        } else {
            let discriminant = b * b - 4.0 * a * c;
            if discriminant >= 0.0 {
                let q = -0.5 * (b + discriminant.sqrt().copysign(b));
                knots[0] = q / a;
                knots[1] = if q == 0.0 { 0.0 } else { c / q };
            }
        }
        for knot in &mut knots {
            if knot.is_nan() || *knot <= 0.0 {
                *knot = f64::INFINITY;
            }
        }
        knots.sort_by(f64::total_cmp);
        let mut low = 0.0_f64;
        for knot in knots {
            let mut high = knot;
            if high.is_infinite() {
                // Beyond the last stationary point the slope goes to ±∞ or stays 1.
                let leading = [self.k3, self.k2, self.k1].into_iter().find(|k| *k != 0.0).unwrap_or(0.0);
                if leading >= 0.0 {
                    return f64::INFINITY;
                }
                high = (2.0 * low).max(1e-12);
                while self.slope(high) > 0.0 && high < f64::MAX {
                    high *= 2.0;
                }
            }
            if self.slope(high) <= 0.0 {
                while high - low > f64::EPSILON * high {
                    let middle = 0.5 * (low + high);
                    if middle <= low || middle >= high {
                        break;
                    }
                    if self.slope(middle) > 0.0 {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
                return low;
            }
            low = high;
        }
        f64::INFINITY
    }

    /// `[k1, k2, p1, p2, k3]`, the order of the Jacobian's columns.
    pub fn to_array(&self) -> [f64; 5] {
        [self.k1, self.k2, self.p1, self.p2, self.k3]
    }
}

/// From `[k1, k2, p1, p2, k3]`.
impl From<[f64; 5]> for Distortion {
    fn from([k1, k2, p1, p2, k3]: [f64; 5]) -> Self {
        Self { k1, k2, p1, p2, k3 }
    }
}
