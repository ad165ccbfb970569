//! A strip of image rows and the drawing of triangles into it.
//!
//! Edge functions (J. Pineda, *A parallel algorithm for polygon rasterization*, SIGGRAPH 1988) in exact integers decide
//! which pixels a triangle covers; a centre on an edge belongs to the triangle whose top or left edge it is. What a pixel
//! gets depends on the triangle and the pixel alone, never on the strip.

use crate::corner::{Corner, SUBPIXEL_BITS, first_pixel, twice_area};
use crate::gbuffer::NO_FACE;
use crate::sieve::{Fragment, Sink};
use fearless_simd::{f32x8, i32x8, prelude::*, u32x8};

/// Pixels looked at together.
const LANES: usize = 8;

/// Whole-pixel edge functions of a triangle in a box of this many units fit in an i32.
const MEDIUM: i32 = 256 << SUBPIXEL_BITS;

/// Rows `top..top + height` of the picture. While drawing, `w` holds 1/z (0 is background).
pub(crate) struct Band<'a> {
    pub(crate) top: i32,
    pub(crate) width: i32,
    pub(crate) height: i32,
    pub(crate) w: &'a mut [f32],
    pub(crate) face: &'a mut [u32],
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
    pub(crate) fn clear(&mut self) {
        self.w.fill(0.0);
        self.face.fill(NO_FACE);
    }

    /// Shows a triangle at a pixel of this band unless something nearer is there, or as near with a lower face.
    #[inline(always)]
    pub(crate) fn put(&mut self, fragment: Fragment) {
        let index = fragment.pixel as usize - (self.top * self.width) as usize;
        if let (Some(w), Some(face)) = (self.w.get_mut(index), self.face.get_mut(index))
            && fragment.w >= *w
            && (fragment.w > *w || fragment.face < *face)
        {
            (*w, *face) = (fragment.w, fragment.face);
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
        let lanes = i32x8::from_fn(simd, |lane| lane as i32);
        let across = [0, 1, 2].map(|k| lanes * sides[k].right);
        let mut row = [0, 1, 2].map(|k| sides[k].edge as i32);
        let faces = u32x8::splat(simd, face);
        for y in y[0]..=y[1] {
            for x_lane in (x[0]..=x[1]).step_by(LANES) {
                // The last pixels of a row are looked at together with some before them.
                let start = x_lane.min(self.width - LANES as i32);
                let edges: [i32x8<S>; 3] =
                    std::array::from_fn(|k| across[k] + (row[k] + (start - x[0]) * sides[k].right));
                let covered = (edges[0] | edges[1] | edges[2]).simd_ge(0);
                if !covered.any_true() {
                    continue;
                }
                let [e0, e1, e2] = edges.map(|edge| edge.to_float::<f32x8<S>>());
                let here = e0 * w[0] + e1 * w[1] + e2 * w[2] + *rest;
                let index = ((y - self.top) * self.width + start) as usize;
                let w_there = &mut self.w[index..index + LANES];
                let faces_there = &mut self.face[index..index + LANES];
                let there = f32x8::from_slice(simd, w_there);
                let ids = u32x8::from_slice(simd, faces_there);
                let wins = here.simd_gt(there) | (here.simd_eq(there) & faces.simd_lt(ids));
                let wins = covered & wins;
                wins.select(here, there).store_slice(w_there);
                wins.select(faces, ids).store_slice(faces_there);
            }
            for k in 0..3 {
                row[k] += sides[k].down;
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
            for ((w, id), x) in self.w[span.clone()].iter_mut().zip(&mut self.face[span]).zip(first..) {
                // Long slivers cancel; no pixel lies beyond the corners.
                let here = ((base + slope * x as f64) as f32).clamp(range[0], range[1]);
                if here > *w || (here == *w && face < *id) {
                    (*w, *id) = (here, face);
                }
            }
        }
    }
}

impl Sink for Band<'_> {
    #[inline(always)]
    fn fragment(&mut self, fragment: Fragment, _y: u32) {
        self.put(fragment);
    }

    #[inline(always)]
    fn triangle<S: Simd>(&mut self, simd: S, face: u32, corners: [Corner; 3]) {
        simd.vectorize(
            #[inline(always)]
            || self.draw(simd, face, corners),
        );
    }

    #[inline(always)]
    fn piece<S: Simd>(&mut self, simd: S, face: u32, corners: [Corner; 3]) {
        self.triangle(simd, face, corners);
    }
}
