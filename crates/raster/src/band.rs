//! A strip of image rows and the drawing of triangles into it.
//!
//! Edge functions (J. Pineda, *A parallel algorithm for polygon rasterization*, SIGGRAPH 1988) in exact integers decide
//! which pixels a triangle covers; a centre on an edge belongs to the triangle whose top or left edge it is. What a pixel
//! gets depends on the triangle and the pixel alone, never on the strip.

use crate::corner::{Corner, SUBPIXEL_BITS};
use crate::gbuffer::NO_FACE;

/// Triangles that fit in a box of this many units have edge functions that fit in an i32.
const SMALL: i32 = 7 << 12;

const ONE: i32 = 1 << SUBPIXEL_BITS;

/// Rows `top..top + height` of the picture. While drawing, `w` holds 1/z (0 is background).
pub(crate) struct Band<'a> {
    pub(crate) top: i32,
    pub(crate) width: i32,
    pub(crate) height: i32,
    pub(crate) w: &'a mut [f32],
    pub(crate) face: &'a mut [u32],
}

impl Band<'_> {
    pub(crate) fn clear(&mut self) {
        self.w.fill(0.0);
        self.face.fill(NO_FACE);
    }

    /// Draws a triangle, nearest first, the lower face where depths are equal.
    pub(crate) fn draw(&mut self, face: u32, [a, b, c]: [Corner; 3]) {
        let (left, right) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
        let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let x0 = first_pixel(left).max(0);
        let x1 = (right >> SUBPIXEL_BITS).min(self.width - 1);
        let y0 = first_pixel(top).max(self.top);
        let y1 = (bottom >> SUBPIXEL_BITS).min(self.top + self.height - 1);
        if x0 > x1 || y0 > y1 {
            return;
        }
        let area = twice_area(a, b, c);
        if area == 0 {
            return;
        }
        // Clockwise in the picture (y down) from here on.
        let (b, c) = if area < 0 { (c, b) } else { (b, c) };
        let area = area.abs();
        let scale = 1.0 / area as f32;
        let pixels = [x0, x1, y0, y1];
        if (right - left) < SMALL && (bottom - top) < SMALL {
            self.fill::<i32>(face, [a, b, c], scale, pixels);
        } else {
            self.fill::<i64>(face, [a, b, c], scale, pixels);
        }
    }

    fn fill<I: Int>(&mut self, face: u32, corners: [Corner; 3], scale: f32, pixels: [i32; 4]) {
        let [x0, x1, y0, y1] = pixels;
        let [a, b, c] = corners;
        // Edge k is opposite to corner k.
        let edges = [(b, c), (c, a), (a, b)];
        let step_x = edges.map(|(p, q)| I::from(p.y - q.y) * I::from(ONE));
        let step_y = edges.map(|(p, q)| I::from(q.x - p.x) * I::from(ONE));
        let bias = edges.map(|(p, q)| I::from(bias(p, q)));
        let (px, py) = (x0 << SUBPIXEL_BITS, y0 << SUBPIXEL_BITS);
        let mut row =
            edges.map(|(p, q)| I::from(q.x - p.x) * I::from(py - p.y) - I::from(q.y - p.y) * I::from(px - p.x));
        let w = [a.w * scale, b.w * scale, c.w * scale];
        for y in y0..=y1 {
            let start = ((y - self.top) * self.width) as usize;
            let span = start + x0 as usize..=start + x1 as usize;
            let mut e = row;
            for (depth, id) in self.w[span.clone()].iter_mut().zip(&mut self.face[span]) {
                if I::covers([e[0] + bias[0], e[1] + bias[1], e[2] + bias[2]]) {
                    let here = e[0].f32() * w[0] + e[1].f32() * w[1] + e[2].f32() * w[2];
                    if here > *depth || (here == *depth && face < *id) {
                        *depth = here;
                        *id = face;
                    }
                }
                for k in 0..3 {
                    e[k] = e[k] + step_x[k];
                }
            }
            for k in 0..3 {
                row[k] = row[k] + step_y[k];
            }
        }
    }
}

/// Twice the signed area, positive for corners that run clockwise in the picture.
pub(crate) fn twice_area(a: Corner, b: Corner, c: Corner) -> i64 {
    i64::from(b.x - a.x) * i64::from(c.y - a.y) - i64::from(b.y - a.y) * i64::from(c.x - a.x)
}

/// The first pixel whose centre is not before a coordinate.
pub(crate) fn first_pixel(coordinate: i32) -> i32 {
    (coordinate + (ONE - 1)) >> SUBPIXEL_BITS
}

/// 0 for a top or left edge of a clockwise triangle, −1 for the others, whose own points do not belong to it.
fn bias(p: Corner, q: Corner) -> i32 {
    if q.y < p.y || (q.y == p.y && q.x > p.x) { 0 } else { -1 }
}

/// The integers edge functions are computed in.
trait Int:
    Copy + From<i32> + std::ops::Mul<Output = Self> + std::ops::Add<Output = Self> + std::ops::Sub<Output = Self>
{
    fn covers(edges: [Self; 3]) -> bool;
    fn f32(self) -> f32;
}

impl Int for i32 {
    fn covers([a, b, c]: [Self; 3]) -> bool {
        a | b | c >= 0
    }
    fn f32(self) -> f32 {
        self as f32
    }
}

impl Int for i64 {
    fn covers([a, b, c]: [Self; 3]) -> bool {
        a | b | c >= 0
    }
    fn f32(self) -> f32 {
        self as f32
    }
}
