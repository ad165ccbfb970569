//! The place of a corner to a small fraction of a pixel: a model of the blurred corner, fitted to the pixels around it.
//!
//! With d the offset from the corner, n₁ and n₂ the normals of its two lines and s the blur,
//!
//! ```text
//! I(d) = b + g·d + a erf(n₁·d / s) erf(n₂·d / s)
//! ```
//!
//! is fitted by Gauss–Newton over the corner, the lines' angles, s, a, b and g (uneven light). The model and the image
//! of a corner are both symmetric about the corner, so blur of any kind and a difference in exposure do not move it. For
//! small windows it is the maximum-likelihood estimate that saddle points and gradient methods approximate.
//!
//! The error function is Abramowitz & Stegun's 7.1.27, within 5·10⁻⁴.

use crate::Image;
use crate::corner::Corner;
use nalgebra::{Point2, SMatrix, SVector};

/// Unknowns: x, y, two angles, ln s, a, b, g.
const N: usize = 9;

/// Pixels handled at once.
const LANES: usize = 8;

/// The most steps.
const STEPS: usize = 12;

/// A step of less than this many pixels is the last.
const SETTLED: f64 = 2e-3;

/// The place of a corner in an image, given roughly, with the angles of its lines, from the pixels within a radius;
/// `None` if the fit leaves the window's middle or the window leaves the image.
pub(crate) fn refine(image: &Image, corner: &Corner, radius: f64) -> Option<Point2<f64>> {
    let window = Window::new(image, &corner.at, radius)?;
    let mut fit = Fit {
        at: [corner.at.x - window.origin.x, corner.at.y - window.origin.y],
        angles: [corner.edges[0], corner.edges[1]],
        blur: 1.2,
    };
    // The brightness is linear in a, b and g: the first step finds them.
    let mut linear = [-0.5 * f64::from(corner.contrast), window.mean(), 0.0, 0.0];
    for _ in 0..STEPS {
        let step = window.step(&fit, &linear)?;
        let limit = |x: f64, most: f64| x.clamp(-most, most);
        fit.at[0] += limit(step[0], 1.0);
        fit.at[1] += limit(step[1], 1.0);
        fit.angles[0] += limit(step[2], 0.3);
        fit.angles[1] += limit(step[3], 0.3);
        fit.blur = (fit.blur * limit(step[4], 0.5).exp()).clamp(0.3, radius);
        for (value, step) in linear.iter_mut().zip(step.iter().skip(5)) {
            *value += step;
        }
        if fit.at[0].hypot(fit.at[1]) > 0.5 * radius {
            return None;
        }
        if step[0].abs().max(step[1].abs()) < SETTLED {
            break;
        }
    }
    Some(Point2::new(window.origin.x + fit.at[0], window.origin.y + fit.at[1]))
}

/// The nonlinear part of the model, relative to the window's middle.
struct Fit {
    at: [f64; 2],
    angles: [f64; 2],
    blur: f64,
}

/// The pixels within a radius of one of them, as offsets and values, filled up to whole lanes with weight 0.
struct Window {
    origin: Point2<f64>,
    count: usize,
    pixels: Vec<Pixels>,
}

/// A few pixels side by side.
struct Pixels {
    x: [f32; LANES],
    y: [f32; LANES],
    value: [f32; LANES],
    weight: [f32; LANES],
}

impl Window {
    fn new(image: &Image, middle: &Point2<f64>, radius: f64) -> Option<Self> {
        let reach = radius.floor();
        if !image.contains(middle.x, middle.y, reach + 1.0) {
            return None;
        }
        let origin = Point2::new(middle.x.round(), middle.y.round());
        let mut pixels = Vec::with_capacity((4.0 * (reach + 1.0) * (reach + 1.0)) as usize / LANES + 1);
        let mut count = 0;
        let reach = reach as i32;
        for dy in -reach..=reach {
            let start = (origin.y as usize).wrapping_add_signed(dy as isize) * image.width() + origin.x as usize;
            for dx in -reach..=reach {
                if f64::from(dx * dx + dy * dy) > radius * radius {
                    continue;
                }
                let lane = count % LANES;
                if lane == 0 {
                    let none = [0.0; LANES];
                    pixels.push(Pixels { x: none, y: none, value: none, weight: none });
                }
                if let Some(last) = pixels.last_mut() {
                    last.x[lane] = dx as f32;
                    last.y[lane] = dy as f32;
                    last.value[lane] = image.values()[start.wrapping_add_signed(dx as isize)];
                    last.weight[lane] = 1.0;
                }
                count += 1;
            }
        }
        Some(Self { origin, count, pixels })
    }

    fn mean(&self) -> f64 {
        let sum: f32 = self.pixels.iter().flat_map(|p| p.value).sum();
        f64::from(sum) / self.count as f64
    }

    /// The Gauss–Newton step.
    fn step(&self, fit: &Fit, linear: &[f64; 4]) -> Option<SVector<f64, N>> {
        let [x0, y0] = fit.at.map(|v| v as f32);
        let line = |angle: f64| {
            let (sin, cos) = angle.sin_cos();
            ((-sin / fit.blur) as f32, (cos / fit.blur) as f32)
        };
        let ((ax, ay), (bx, by)) = (line(fit.angles[0]), line(fit.angles[1]));
        let [a, b, gx, gy] = linear.map(|v| v as f32);
        let mut sums = [[0f32; LANES]; N * (N + 1) / 2];
        let mut right = [[0f32; LANES]; N];
        for p in &self.pixels {
            let mut rows = [[0f32; LANES]; N];
            let mut residual = [0f32; LANES];
            for l in 0..LANES {
                let (dx, dy) = (p.x[l] - x0, p.y[l] - y0);
                let (u, v) = (ax * dx + ay * dy, bx * dx + by * dy);
                let ((e, de), (f, df)) = (erf(u), erf(v));
                let (du, dv) = (a * de * f, a * e * df);
                // Turning a line moves d along it: ∂(n·d)/∂θ = −t·d, with the tangent t = (n_y, −n_x).
                let w = p.weight[l];
                rows[0][l] = -w * (du * ax + dv * bx);
                rows[1][l] = -w * (du * ay + dv * by);
                rows[2][l] = -w * du * (ay * dx - ax * dy);
                rows[3][l] = -w * dv * (by * dx - bx * dy);
                rows[4][l] = -w * (du * u + dv * v);
                rows[5][l] = w * e * f;
                rows[6][l] = w;
                rows[7][l] = w * p.x[l];
                rows[8][l] = w * p.y[l];
                residual[l] = w * (p.value[l] - (a * e * f + b + gx * p.x[l] + gy * p.y[l]));
            }
            let mut k = 0;
            for i in 0..N {
                for j in 0..=i {
                    for l in 0..LANES {
                        sums[k][l] += rows[i][l] * rows[j][l];
                    }
                    k += 1;
                }
                for l in 0..LANES {
                    right[i][l] += rows[i][l] * residual[l];
                }
            }
        }
        let total = |lanes: &[f32; LANES]| f64::from(lanes.iter().sum::<f32>());
        let entry = |i: usize, j: usize| total(&sums[i.max(j) * (i.max(j) + 1) / 2 + i.min(j)]);
        // Scaled to a unit diagonal, with a trace of damping for angles that meet and blurs that vanish.
        let scale = SVector::<f64, N>::from_fn(|i, _| 1.0 / entry(i, i).max(1e-12).sqrt());
        let normal =
            SMatrix::<f64, N, N>::from_fn(|i, j| entry(i, j) * scale[i] * scale[j] + if i == j { 1e-5 } else { 0.0 });
        let right = SVector::<f64, N>::from_fn(|i, _| total(&right[i]) * scale[i]);
        let step = normal.cholesky()?.solve(&right).component_mul(&scale);
        step.iter().all(|x| x.is_finite()).then_some(step)
    }
}

/// The error function and its derivative, of one formula: `1 − (1 + c₁ u + c₂ u² + c₃ u³ + c₄ u⁴)⁻⁴` for u ≥ 0.
#[inline]
fn erf(u: f32) -> (f32, f32) {
    const C: [f32; 4] = [0.278_393, 0.230_389, 0.000_972, 0.078_108];
    let x = u.abs().min(8.0);
    let p = 1.0 + x * (C[0] + x * (C[1] + x * (C[2] + x * C[3])));
    let dp = C[0] + x * (2.0 * C[1] + x * (3.0 * C[2] + x * 4.0 * C[3]));
    let inverse = 1.0 / p;
    let square = inverse * inverse;
    let fourth = square * square;
    ((1.0 - fourth).copysign(u), 4.0 * dp * fourth * inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn erf_is_that_of_the_tables() {
        // Abramowitz & Stegun, table 7.1.
        for (x, y) in [(0.0, 0.0), (0.25, 0.276_326), (0.5, 0.520_500), (1.0, 0.842_701), (2.0, 0.995_322)] {
            assert!((erf(x).0 - y).abs() < 6e-4 && (erf(-x).0 + y).abs() < 6e-4);
            let difference = (erf(x + 0.01).0 - erf(x + 0.001).0) / 0.009;
            assert!((erf(x + 0.0055).1 - difference).abs() < 2e-3);
        }
    }
}
