//! A strip of image rows and the drawing of triangles into it.
//!
//! Edge functions (J. Pineda, *A parallel algorithm for polygon rasterization*, SIGGRAPH 1988) in exact integers decide
//! which pixels a triangle covers; a centre on an edge belongs to the triangle whose top or left edge it is. What a pixel
//! gets depends on the triangle and the pixel alone, never on the strip.

use crate::corner::{Corner, SUBPIXEL_BITS, first_pixel, twice_area};
use crate::three::each;
use fearless_simd::{f32x8, i32x8, prelude::*, u32x8, u64x4};
use std::ops::Range;

/// Pixels looked at together.
const LANES: usize = 8;

/// Pixels a side of the tiles by which depths are summed up.
pub(crate) const TILE: usize = 8;

/// Whole-pixel edge functions of a triangle in a box of this many units fit in an i32.
const MEDIUM: i32 = 256 << SUBPIXEL_BITS;

/// What a pixel shows, so that the greater key is seen: the bits of 1/z, which order like the numbers, above those of the
/// face, inverted so that the lower face wins where depths are equal. Background is 0: 1/z = 0 and [`NO_FACE`].
#[inline(always)]
pub(crate) fn key(w: f32, face: u32) -> u64 {
    u64::from(w.to_bits()) << 32 | u64::from(!face)
}

/// 1/z and face of a key.
#[inline(always)]
pub(crate) fn unlock(key: u64) -> (f32, u32) {
    (f32::from_bits((key >> 32) as u32), !(key as u32))
}

/// Rows `top..top + height` of the picture.
pub(crate) struct Band<'a> {
    pub(crate) top: i32,
    pub(crate) width: i32,
    pub(crate) height: i32,
    pub(crate) keys: &'a mut [u64],
    /// Which columns of each row of tiles may show anything; elsewhere the keys mean nothing.
    pub(crate) spans: &'a mut Vec<Range<usize>>,
}

/// The side of a triangle in front of which its inside lies. With e the edge function, in square units, and b = −1 if
/// the side's own points belong to the neighbour, else 0:
struct Side {
    /// ⌊(e + b) / 4096⌋ at the first pixel: not negative inside. Steps between pixels are multiples of 4096.
    edge: i64,
    /// e − 4096 · `edge`, the same at all pixels.
    rest: i64,
    /// What `edge` gains by one pixel to the right and one down.
    right: i32,
    down: i32,
}

impl Side {
    #[inline(always)]
    fn new(p: Corner, q: Corner, x: i32, y: i32) -> Self {
        let (dx, dy) = (q.x - p.x, q.y - p.y);
        let e = i64::from(dx) * i64::from((y << SUBPIXEL_BITS) - p.y)
            - i64::from(dy) * i64::from((x << SUBPIXEL_BITS) - p.x);
        let top_or_left = dy < 0 || (dy == 0 && dx > 0);
        let edge = (e - i64::from(!top_or_left)) >> SUBPIXEL_BITS;
        Self { edge, rest: e - (edge << SUBPIXEL_BITS), right: -dy, down: dx }
    }
}

/// A triangle prepared for drawing into a box of pixels.
struct Setup {
    /// Side k is opposite to corner k.
    sides: [Side; 3],
    /// 1/z at the corners over the doubled area in units of 4096 square units.
    w: [f32; 3],
    /// What `Side::rest` adds to 1/z.
    rest: f32,
    /// 1/z of the farthest and the nearest corner.
    range: [f32; 2],
    /// First and last pixel of the box.
    x: [i32; 2],
    y: [i32; 2],
}

impl Band<'_> {
    /// Begins with background; negative tiles, row by row, are not going to be drawn into.
    #[inline(always)]
    pub(crate) fn clear(&mut self, tiles: &[f32]) {
        let width = self.width as usize;
        self.spans.clear();
        for (tiles, rows) in tiles.chunks(width.div_ceil(TILE)).zip(self.keys.chunks_mut(width * TILE)) {
            let first = tiles.iter().position(|&tile| tile >= 0.0).unwrap_or_default();
            let end = tiles.iter().rposition(|&tile| tile >= 0.0).map_or(0, |last| last + 1);
            let span = first * TILE..(end * TILE).min(width);
            rows.chunks_exact_mut(width).for_each(|row| row[span.clone()].fill(0));
            self.spans.push(span);
        }
    }

    /// Shows a triangle at a pixel, by its index in the band, unless something nearer is there.
    #[inline(always)]
    pub(crate) fn put(&mut self, pixel: usize, w: f32, face: u32) {
        if let Some(there) = self.keys.get_mut(pixel) {
            *there = (*there).max(key(w, face));
        }
    }

    /// Draws a triangle.
    #[inline(always)]
    pub(crate) fn draw<S: Simd>(&mut self, simd: S, face: u32, [a, b, c]: [Corner; 3]) {
        let (left, right) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
        let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let x = [first_pixel(left).max(0), (right >> SUBPIXEL_BITS).min(self.width - 1)];
        let y = [first_pixel(top).max(self.top), (bottom >> SUBPIXEL_BITS).min(self.top + self.height - 1)];
        let area = twice_area(a, b, c);
        if x[0] > x[1] || y[0] > y[1] || area == 0 {
            return;
        }
        let (b, c) = if area < 0 { (c, b) } else { (b, c) };
        let side = |p, q| Side::new(p, q, x[0], y[0]);
        let sides = [side(b, c), side(c, a), side(a, b)];
        let scale = (1 << SUBPIXEL_BITS) as f32 / area.abs() as f32;
        let w = [a.w * scale, b.w * scale, c.w * scale];
        let rest = |k: usize| sides[k].rest as f32 * (1.0 / (1 << SUBPIXEL_BITS) as f32) * w[k];
        let rest = rest(0) + rest(1) + rest(2);
        let range = [a.w.min(b.w).min(c.w), a.w.max(b.w).max(c.w)];
        let setup = Setup { sides, w, rest, range, x, y };
        if right - left < MEDIUM && bottom - top < MEDIUM && self.width >= LANES as i32 {
            self.fill_medium(simd, face, &setup);
        } else {
            self.fill_large(face, &setup);
        }
    }

    /// Goes through the box eight pixels at a time.
    #[inline(always)]
    fn fill_medium<S: Simd>(&mut self, simd: S, face: u32, setup: &Setup) {
        let Setup { sides, w, rest, x, y, .. } = setup;
        let lanes = i32x8::load_array(simd, [0, 1, 2, 3, 4, 5, 6, 7]);
        let faces = u32x8::splat(simd, !face);
        let none = u32x8::splat(simd, 0);
        for x_lane in (x[0]..=x[1]).step_by(LANES) {
            // The last pixels of a row are looked at together with some before them.
            let start = x_lane.min(self.width - LANES as i32);
            let mut edges = each(
                [0, 1, 2],
                #[inline(always)]
                |k: usize| lanes * sides[k].right + (sides[k].edge as i32 + (start - x[0]) * sides[k].right),
            );
            for y in y[0]..=y[1] {
                let [e0, e1, e2] = edges;
                for k in 0..3 {
                    edges[k] += sides[k].down;
                }
                let covered = (e0 | e1 | e2).simd_ge(0);
                if !covered.any_true() {
                    continue;
                }
                let [e0, e1, e2] = each(
                    [e0, e1, e2],
                    #[inline(always)]
                    |edge| edge.to_float::<f32x8<S>>(),
                );
                let here = e0 * w[0] + e1 * w[1] + e2 * w[2] + *rest;
                let index = ((y - self.top) * self.width + start) as usize;
                let there = &mut self.keys[index..index + LANES];
                // Uncovered pixels get the key of background, which never wins.
                let high = covered.select(here.to_bits(), none);
                let (low, high) = covered.select(faces, none).interleave(high);
                let (first, last) = there.split_at_mut(LANES / 2);
                for (there, here) in [(first, low), (last, high)] {
                    let here: u64x4<S> = here.bitcast();
                    here.max(u64x4::from_slice(simd, there)).store_slice(there);
                }
            }
        }
    }

    /// 1/z of the farthest pixel in each tile that may show anything, row by row of tiles; 0 where there is background.
    #[inline(always)]
    pub(crate) fn farthest(&self, tiles: &mut [f32]) {
        let width = self.width as usize;
        let rows = tiles.chunks_mut(width.div_ceil(TILE)).zip(self.keys.chunks(width * TILE));
        for ((tiles, rows), span) in rows.zip(self.spans.iter()) {
            let tiles = &mut tiles[span.start / TILE..span.end.div_ceil(TILE)];
            tiles.fill(f32::INFINITY);
            for row in rows.chunks_exact(width) {
                for (tile, keys) in tiles.iter_mut().zip(row[span.clone()].chunks(TILE)) {
                    let least = keys.iter().fold(u64::MAX, |least, &key| least.min(key));
                    *tile = tile.min(unlock(least).0);
                }
            }
        }
    }

    /// Finds the covered span of every row by division.
    fn fill_large(&mut self, face: u32, setup: &Setup) {
        let Setup { sides, w, rest, range, x, y } = setup;
        let slope: f64 = (0..3).map(|k| f64::from(w[k]) * f64::from(sides[k].right)).sum();
        for y in y[0]..=y[1] {
            let row = [0, 1, 2].map(|k| sides[k].edge + i64::from(y - setup.y[0]) * i64::from(sides[k].down));
            let (mut first, mut last) = (0, i64::from(x[1] - x[0]));
            for (edge, side) in row.iter().zip(sides) {
                let right = i64::from(side.right);
                match right.signum() {
                    1 => first = first.max((-edge).div_euclid(right) + i64::from((-edge).rem_euclid(right) > 0)),
                    -1 => last = last.min(edge.div_euclid(-right)),
                    _ if *edge < 0 => last = -1,
                    _ => {}
                }
            }
            if first > last {
                continue;
            }
            let base: f64 = (0..3).map(|k| row[k] as f64 * f64::from(w[k])).sum::<f64>() + f64::from(*rest);
            let start = (i64::from(y - self.top) * i64::from(self.width) + i64::from(x[0])) as usize;
            let span = start + first as usize..=start + last as usize;
            for (there, x) in self.keys[span].iter_mut().zip(first..) {
                // Long slivers cancel; no pixel lies beyond the corners.
                let here = ((base + slope * x as f64) as f32).clamp(range[0], range[1]);
                *there = (*there).max(key(here, face));
            }
        }
    }
}
