//! The surroundings of the silhouette: an exact Euclidean distance transform with the nearest pixel, bounded to a band.
//!
//! P. F. Felzenszwalb and D. P. Huttenlocher, *Distance transforms of sampled functions*, Theory of Computing 8, 2012:
//! columns first, then for every row the lower envelope of the parabolas `(x − q)² + f(q)` that its pixels q send up.

use crate::gbuffer::{GBuffer, NO_FACE};
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;
use std::ops::Range;

/// A background pixel near the silhouette.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HaloPixel {
    /// Its index in the buffer, `y * width + x`.
    pub pixel: u32,
    /// Index of the nearest pixel that sees the surface: a pixel of the outline.
    pub nearest: u32,
    /// Distance between the two centres in pixels, at least 1.
    pub distance: f32,
}

/// All background pixels at most `band` pixels away from the surface's picture, row by row. `f32::INFINITY` takes in all of
/// the background; nothing comes back where nothing is covered. Bands end at 65,534 pixels.
///
/// Among several nearest pixels one is chosen, always the same one.
pub fn outline(gbuffer: &GBuffer, band: f32) -> Vec<HaloPixel> {
    let (width, height) = (gbuffer.width as usize, gbuffer.height as usize);
    if width == 0 {
        return Vec::new();
    }
    let band = f64::from(band.max(0.0)).min(f64::from(FAR - 1));
    let rows = STRIP.max(4 * band as usize);
    let strip = |top: usize| {
        let rows = top..height.min(top + rows);
        dispatch!(Level::new(), _simd => strip(&gbuffer.face, width, rows, band))
    };
    if rows >= height {
        return strip(0);
    }
    let tops: Vec<usize> = (0..height).step_by(rows).collect();
    tops.into_par_iter().map(strip).collect::<Vec<_>>().concat()
}

/// The fewest rows that are worth a task.
const STRIP: usize = 256;

/// The halo in some rows of a picture.
#[inline(always)]
fn strip(faces: &[u32], width: usize, rows: Range<usize>, band: f64) -> Vec<HaloPixel> {
    let (limit, reach) = ((band * band) as i64, band as u16);
    let reaching = rows.start.saturating_sub(reach.into())..(rows.end + usize::from(reach)).min(faces.len() / width);
    let row = |y: usize| &faces[y * width..][..width];
    // For each pixel the number of rows down to the next surface pixel of its column.
    let mut below = vec![FAR; rows.len() * width];
    let mut last = vec![FAR; width];
    for y in (rows.start..reaching.end).rev() {
        count(&mut last, row(y));
        if y < rows.end {
            below[(y - rows.start) * width..][..width].copy_from_slice(&last);
        }
    }
    let mut above = vec![FAR; width];
    (reaching.start..rows.start).for_each(|y| count(&mut above, row(y)));
    let mut nearest = vec![FAR; width];
    let mut envelope = Vec::new();
    let mut halo = Vec::new();
    for (y, below) in rows.zip(below.chunks_exact(width)) {
        let faces = row(y);
        count(&mut above, faces);
        for ((nearest, &above), &below) in nearest.iter_mut().zip(&above).zip(below) {
            *nearest = below.min(above);
        }
        build_envelope(&nearest, reach, &mut envelope);
        for (k, parabola) in envelope.iter().enumerate() {
            let height = parabola.rows * parabola.rows;
            let half = ((limit - height) as f64).sqrt() as i64;
            let next = envelope.get(k + 1).map_or(width as i64, |next| next.start);
            let start = parabola.start.max(parabola.x - half).max(0);
            let end = next.min(parabola.x + half + 1).min(width as i64);
            let rows_up = i64::from(above[parabola.x as usize]);
            let row = if rows_up == parabola.rows { y as i64 - rows_up } else { y as i64 + parabola.rows };
            let nearest = (row * width as i64 + parabola.x) as u32;
            for x in start..end {
                if faces[x as usize] == NO_FACE {
                    let squared = height + (x - parabola.x) * (x - parabola.x);
                    let pixel = (y * width) as u32 + x as u32;
                    halo.push(HaloPixel { pixel, nearest, distance: (squared as f32).sqrt() });
                }
            }
        }
    }
    halo
}

/// More rows than are counted.
const FAR: u16 = u16::MAX;

/// Counts the rows since the last surface pixel of each column one row on.
#[inline(always)]
fn count(away: &mut [u16], faces: &[u32]) {
    for (away, &face) in away.iter_mut().zip(faces) {
        *away = if face == NO_FACE { away.saturating_add(1) } else { 0 };
    }
}

/// `(x − self.x)² + rows²`, the lowest of a row's parabolas from `start` to the start of the next.
#[derive(Clone, Copy)]
struct Parabola {
    x: i64,
    rows: i64,
    start: i64,
}

/// The lower envelope of the parabolas of a row whose pixels are so many rows away from the surface.
fn build_envelope(rows_away: &[u16], reach: u16, envelope: &mut Vec<Parabola>) {
    /// Pixels passed over together where there is nothing to see.
    const STEP: usize = 32;
    envelope.clear();
    let mut before = FAR;
    for (k, pixels) in rows_away.chunks(STEP).enumerate() {
        // Background out of reach, and the inside of the surface's picture.
        let dull = pixels.iter().fold(true, |dull, &away| dull & (away > reach))
            || (before == 0 && rows_away.get((k + 1) * STEP) == Some(&0) && pixels.iter().all(|&away| away == 0));
        if !dull {
            for (x, &away) in (k * STEP..).zip(pixels) {
                let inside = away == 0 && before == 0 && rows_away.get(x + 1) == Some(&0);
                before = away;
                if away <= reach && !inside {
                    push_parabola(envelope, x as i64, i64::from(away));
                }
            }
        }
        before = pixels[pixels.len() - 1];
    }
}

/// Adds a parabola to the right of all others.
fn push_parabola(envelope: &mut Vec<Parabola>, x: i64, rows: i64) {
    let mut start = 0;
    while let Some(last) = envelope.last() {
        // The first integer at which the new one is strictly lower.
        let rise = (rows * rows + x * x) - (last.rows * last.rows + last.x * last.x);
        start = rise.div_euclid(2 * (x - last.x)) + 1;
        if start > last.start {
            break;
        }
        envelope.pop();
        start = 0;
    }
    envelope.push(Parabola { x, rows, start });
}
