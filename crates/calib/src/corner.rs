//! A chessboard corner seen closely: where the intensity has its saddle, and the two lines that cross there.

use crate::Image;
use nalgebra::{Point2, Vector2};
use std::f64::consts::{PI, TAU};
use std::sync::LazyLock;

/// A corner at the resolution of the level it was found on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Corner {
    /// Its place in the level.
    pub(crate) at: Point2<f64>,
    /// The four edges leaving it, as angles from x towards y, ascending from the first by less than a turn. Behind
    /// edges 0 and 2 (at slightly larger angles) lies a bright square, behind 1 and 3 a dark one.
    pub(crate) edges: [f64; 4],
    /// Bright minus dark.
    pub(crate) contrast: f32,
}

/// The radius of the ring the edges are read from, in pixels.
const RADIUS: f64 = 5.0;

/// Samples on the ring.
const SAMPLES: usize = 32;

/// Offsets of the samples.
static RING: LazyLock<[(f64, f64); SAMPLES]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let (sin, cos) = (TAU * i as f64 / SAMPLES as f64).sin_cos();
        (RADIUS * cos, RADIUS * sin)
    })
});

/// The least contrast of a corner.
const LEAST_CONTRAST: f32 = 0.02;

/// How far the two halves of a line may be from opposite, radians.
const BEND: f64 = 0.45;

/// The least angle between the two lines, radians.
const LEAST_ANGLE: f64 = 0.2;

/// How far the saddle may be from where the corner was expected, in pixels.
const DRIFT: f64 = 3.0;

impl Corner {
    /// The corner near a position, if there is one.
    pub(crate) fn measure(image: &Image, near: Point2<f64>) -> Option<Self> {
        let at = saddle(image, near)?;
        let (edges, contrast) = edges(image, &at)?;
        Some(Self { at, edges, contrast })
    }

    /// The edge whose direction is nearest to an angle, and how far off it is in radians.
    pub(crate) fn edge_towards(&self, angle: f64) -> (usize, f64) {
        let off = self.edges.map(|edge| turn(angle - edge).abs());
        let edge = (0..4).min_by(|a, b| off[*a].total_cmp(&off[*b])).unwrap_or(0);
        (edge, off[edge])
    }
}

/// An angle brought to −π … π.
pub(crate) fn turn(angle: f64) -> f64 {
    angle - TAU * (angle / TAU).round()
}

/// The stationary point of the quadratic surface fitted to 7×7 pixels, moved along until it lies within its window;
/// `None` if it is no saddle. (L. Lucchese & S. K. Mitra, *Using saddle points for subpixel feature detection in camera
/// calibration targets*, APCCAS 2002.)
fn saddle(image: &Image, near: Point2<f64>) -> Option<Point2<f64>> {
    const HALF: i32 = 3;
    let mut at = near;
    for _ in 0..4 {
        if !image.contains(at.x, at.y, f64::from(HALF) + 0.5) {
            return None;
        }
        let (column, row) = (at.x.round(), at.y.round());
        let mut sums = [0f32; 6];
        for dy in -HALF..=HALF {
            let start = (row as usize).wrapping_add_signed(dy as isize) * image.width() + column as usize;
            let values = &image.values()[start - HALF as usize..=start + HALF as usize];
            let y = dy as f32;
            for (value, dx) in values.iter().zip(-HALF..) {
                let x = dx as f32;
                for (sum, basis) in sums.iter_mut().zip([1.0, x, y, x * x, x * y, y * y]) {
                    *sum += value * basis;
                }
            }
        }
        // Over the window the mean of x² is 4; x² − 4 has the square norm 7·84, x the square norm 196, xy 784.
        let [one, x, y, xx, xy, yy] = sums.map(f64::from);
        let (gx, gy) = (x / 196.0, y / 196.0);
        let (hxx, hyy, hxy) = ((xx - 4.0 * one) / 294.0, (yy - 4.0 * one) / 294.0, xy / 784.0);
        let determinant = hxx * hyy - hxy * hxy;
        if determinant >= 0.0 {
            return None;
        }
        let step = Vector2::new(hxy * gy - hyy * gx, hxy * gx - hxx * gy) / determinant;
        let next = Point2::new(column, row) + step;
        if (next - near).norm() > DRIFT {
            return None;
        }
        at = next;
        if step.amax() <= 1.0 {
            return Some(at);
        }
    }
    None
}

/// The directions of the four edges from a ring of samples, and the contrast; `None` unless the ring is bright, dark,
/// bright, dark and opposite edges are in line.
fn edges(image: &Image, at: &Point2<f64>) -> Option<([f64; 4], f32)> {
    if !image.contains(at.x, at.y, RADIUS) {
        return None;
    }
    let angle = |i: f64| TAU * i / SAMPLES as f64;
    let raw: [f32; SAMPLES] = RING.map(|(x, y)| image.sample(at.x + x, at.y + y));
    let ring: [f32; SAMPLES] =
        std::array::from_fn(|i| 0.25 * (raw[(i + SAMPLES - 1) % SAMPLES] + raw[(i + 1) % SAMPLES]) + 0.5 * raw[i]);
    let low = ring.iter().fold(f32::INFINITY, |m, v| m.min(*v));
    let high = ring.iter().fold(f32::NEG_INFINITY, |m, v| m.max(*v));
    let (middle, contrast) = (0.5 * (low + high), high - low);
    if contrast < LEAST_CONTRAST {
        return None;
    }
    let mut crossings = [(0.0, false); 4];
    let mut count = 0;
    for i in 0..SAMPLES {
        let (a, b) = (ring[i] - middle, ring[(i + 1) % SAMPLES] - middle);
        if (a >= 0.0) != (b >= 0.0) {
            *crossings.get_mut(count)? = (angle(i as f64 + f64::from(a / (a - b))), b >= 0.0);
            count += 1;
        }
    }
    if count != 4 {
        return None;
    }
    // Rising and falling crossings alternate; start with a rising one.
    let first = usize::from(!crossings[0].1);
    let mut angles: [f64; 4] = std::array::from_fn(|i| crossings[(i + first) % 4].0);
    for i in 1..4 {
        if angles[i] < angles[i - 1] {
            angles[i] += TAU;
        }
    }
    let bend = |i: usize| angles[i + 2] - angles[i] - PI;
    if bend(0).abs() > BEND || bend(1).abs() > BEND {
        return None;
    }
    let (rising, falling) = (angles[0] + 0.5 * bend(0), angles[1] + 0.5 * bend(1));
    let between = falling - rising;
    let open = between > LEAST_ANGLE && between < PI - LEAST_ANGLE;
    open.then_some(([rising, falling, rising + PI, falling + PI], contrast))
}
