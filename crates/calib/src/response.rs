//! Candidates for chessboard corners by the ChESS response: S. Bennett & J. Lasenby, *ChESS – Quick and robust detection
//! of chess-board features*, CVIU 118, 2014.
//!
//! Sixteen samples `I_0 … I_15` on a ring of radius 5 see a corner as bright, dark, bright, dark:
//!
//! ```text
//! SR = Σ_{n<4} |(I_n + I_{n+8}) − (I_{n+4} + I_{n+12})|      large at a corner
//! DR = Σ_{n<8} |I_n − I_{n+8}|                               large at an edge
//! R  = SR − DR
//! ```
//!
//! The paper's third term, the mean response against lines, is left to the closer look every candidate gets.

use crate::Image;
use rayon::prelude::*;

/// The ring's radius in pixels.
pub(crate) const RADIUS: usize = 5;

/// Offsets (x, y) of the ring, a sixteenth of a turn apart.
const RING: [(isize, isize); 16] = [
    (0, -5),
    (2, -5),
    (3, -3),
    (5, -2),
    (5, 0),
    (5, 2),
    (3, 3),
    (2, 5),
    (0, 5),
    (-2, 5),
    (-3, 3),
    (-5, 2),
    (-5, 0),
    (-5, -2),
    (-3, -3),
    (-2, -5),
];

/// White in the integers the response is computed in: sums of eight differences still fit 16 bits.
const WHITE: f32 = 4095.0;

/// The least response: an ideal corner between squares that differ by about 3 % of white.
const LEAST: i16 = 800;

/// A candidate is the largest response this many pixels around.
const REACH: usize = 3;

/// No more candidates than this are handed on, the strongest first.
const MOST: usize = 4000;

/// The pixels (x, y) of local maxima of the response, strongest first.
pub(crate) fn candidates(image: &Image) -> Vec<(usize, usize)> {
    let (width, height) = (image.width(), image.height());
    if width <= 2 * RADIUS || height <= 2 * RADIUS {
        return Vec::new();
    }
    let response = response(image);
    let mut found = Vec::new();
    let margin = RADIUS + REACH;
    for y in margin..height.saturating_sub(margin) {
        let row = &response[y * width..][..width];
        let Some(inner) = row.get(margin..width.saturating_sub(margin)) else { continue };
        for (chunk, values) in inner.chunks(16).enumerate() {
            // Few pixels are candidates: most chunks end here.
            if values.iter().fold(i16::MIN, |m, v| m.max(*v)) < LEAST {
                continue;
            }
            for (i, &value) in values.iter().enumerate() {
                let x = margin + 16 * chunk + i;
                if value >= LEAST && is_peak(&response, width, x, y, value) {
                    found.push((value, x, y));
                }
            }
        }
    }
    found.sort_by_key(|&(value, x, y)| (std::cmp::Reverse(value), y, x));
    found.truncate(MOST);
    found.into_iter().map(|(_, x, y)| (x, y)).collect()
}

/// Whether no pixel around has a larger response; of equal ones, the first in reading order counts.
fn is_peak(response: &[i16], width: usize, x: usize, y: usize, value: i16) -> bool {
    (y - REACH..=y + REACH).all(|v| {
        let row = &response[v * width + x - REACH..=v * width + x + REACH];
        row.iter().enumerate().all(|(i, &other)| {
            let before = (v, i) < (y, REACH);
            other < value || (other == value && !before)
        })
    })
}

/// A grey value as a whole number, NaN as black. 2²³ added to a number leaves its whole part in the lowest bits, which is
/// many times faster than a conversion that must mind every float.
#[inline]
fn quantized(value: f32) -> i16 {
    let value = if value > 0.0 { value.min(1.0) } else { 0.0 };
    (value * WHITE + 8_388_608.0).to_bits() as i16
}

/// R at every pixel, 0 near the border.
fn response(image: &Image) -> Vec<i16> {
    let (width, height) = (image.width(), image.height());
    let grey: Vec<i16> = image.values().iter().map(|v| quantized(*v)).collect();
    let mut response = vec![0; width * height];
    let count = width - 2 * RADIUS;
    response.par_chunks_mut(width).enumerate().with_min_len(32).for_each(|(y, row)| {
        if y < RADIUS || y >= height - RADIUS {
            return;
        }
        let ring: [&[i16]; 16] = RING.map(|(dx, dy)| {
            let start = y.wrapping_add_signed(dy) * width + RADIUS.wrapping_add_signed(dx);
            &grey[start..start + count]
        });
        for (x, out) in row[RADIUS..RADIUS + count].iter_mut().enumerate() {
            let i = |n: usize| ring[n][x];
            let mut sum = 0;
            for n in 0..4 {
                sum += ((i(n) + i(n + 8)) - (i(n + 4) + i(n + 12))).abs();
            }
            for n in 0..8 {
                sum -= (i(n) - i(n + 8)).abs();
            }
            *out = sum;
        }
    });
    response
}
