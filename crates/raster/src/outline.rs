//! The surroundings of the silhouette: an exact Euclidean distance transform with the nearest pixel, bounded to a band.
//!
//! P. F. Felzenszwalb and D. P. Huttenlocher, *Distance transforms of sampled functions*, Theory of Computing 8, 2012:
//! columns first, then for every row the lower envelope of the parabolas `(x − q)² + f(q)` that its pixels q send up.

use crate::gbuffer::{GBuffer, NO_FACE};

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
/// the background; nothing comes back where nothing is covered.
///
/// Among several nearest pixels one is chosen, always the same one.
pub fn outline(gbuffer: &GBuffer, band: f32) -> Vec<HaloPixel> {
    let width = gbuffer.width as usize;
    let mut halo = Vec::new();
    if width == 0 {
        return halo;
    }
    let limit = (f64::from(band) * f64::from(band)) as i64;
    let rows_away = column_distances(gbuffer, band as i32);
    let mut envelope = Envelope::default();
    let rows = rows_away.chunks_exact(width).zip(gbuffer.face.chunks_exact(width));
    for (y, (rows_away, faces)) in rows.enumerate() {
        envelope.build(rows_away);
        if envelope.parabolas.is_empty() {
            continue;
        }
        let mut lowest = 0;
        for (x, _) in faces.iter().enumerate().filter(|&(_, &face)| face == NO_FACE) {
            let nearest = envelope.at(x, &mut lowest);
            let squared = nearest.height + square(x as i64 - nearest.x as i64);
            if squared <= limit {
                let nearest_y = y as i64 + i64::from(rows_away[nearest.x]);
                halo.push(HaloPixel {
                    pixel: (y * width + x) as u32,
                    nearest: (nearest_y as usize * width + nearest.x) as u32,
                    distance: (squared as f32).sqrt(),
                });
            }
        }
    }
    halo
}

/// No surface pixel in this column within reach.
const FAR: i32 = i32::MAX;

/// For each pixel the signed number of rows to the nearest surface pixel of its column (the upper one where equal), or
/// [`FAR`] where that is more than `reach`.
fn column_distances(gbuffer: &GBuffer, reach: i32) -> Vec<i32> {
    let width = gbuffer.width as usize;
    let height = gbuffer.height as i32;
    let reach = reach.min(height);
    let mut distances = vec![FAR; gbuffer.face.len()];
    let rows = distances.chunks_exact_mut(width).zip(gbuffer.face.chunks_exact(width));
    let rows: Vec<_> = (0..height).zip(rows).collect();
    let mut above = vec![-height - 1; width];
    let mut below = vec![2 * height + 1; width];
    let mut rows = rows;
    for (y, (distances, faces)) in rows.iter_mut() {
        for ((distance, above), &face) in distances.iter_mut().zip(&mut above).zip(*faces) {
            *above = if face == NO_FACE { *above } else { *y };
            let away = *y - *above;
            *distance = if away <= reach { -away } else { FAR };
        }
    }
    for (y, (distances, faces)) in rows.iter_mut().rev() {
        for ((distance, below), &face) in distances.iter_mut().zip(&mut below).zip(*faces) {
            *below = if face == NO_FACE { *below } else { *y };
            let away = *below - *y;
            let nearer = away <= reach && (away as u32) < distance.unsigned_abs();
            *distance = if nearer { away } else { *distance };
        }
    }
    distances
}

/// The lower envelope of a row's parabolas, from left to right.
#[derive(Default)]
struct Envelope {
    parabolas: Vec<Parabola>,
}

/// `(x − self.x)² + height`, the lowest from `start` on.
#[derive(Clone, Copy)]
struct Parabola {
    x: usize,
    height: i64,
    start: i64,
}

impl Envelope {
    fn build(&mut self, rows_away: &[i32]) {
        self.parabolas.clear();
        for (x, &away) in rows_away.iter().enumerate() {
            // Inside the surface's picture no background pixel is nearest.
            let inside = x > 0 && away == 0 && rows_away[x - 1] == 0;
            if away == FAR || (inside && rows_away.get(x + 1) == Some(&0)) {
                continue;
            }
            let mut new = Parabola { x, height: square(i64::from(away)), start: 0 };
            while let Some(last) = self.parabolas.last() {
                new.start = last.overtaken_by(&new);
                if new.start > last.start {
                    break;
                }
                self.parabolas.pop();
                new.start = 0;
            }
            self.parabolas.push(new);
        }
    }

    /// The lowest parabola at x, asked for from left to right; `lowest` remembers where the last answer was.
    fn at(&self, x: usize, lowest: &mut usize) -> Parabola {
        while self.parabolas.get(*lowest + 1).is_some_and(|next| next.start <= x as i64) {
            *lowest += 1;
        }
        self.parabolas[*lowest]
    }
}

impl Parabola {
    /// The first integer from which a parabola farther right is strictly lower.
    fn overtaken_by(&self, right: &Self) -> i64 {
        let (p, q) = (self.x as i64, right.x as i64);
        let rise = (right.height + q * q) - (self.height + p * p);
        rise.div_euclid(2 * (q - p)) + 1
    }
}

fn square(x: i64) -> i64 {
    x * x
}
