//! Triangles larger than those of a [`Batch`](crate::batch::Batch), by the same rules in 64 bits.

use crate::band::{Band, key};
use crate::corner::{Corner, SUBPIXEL_BITS, first_pixel, twice_area};

/// As in a batch.
struct Side {
    edge: i64,
    rest: i64,
    right: i64,
    down: i64,
}

impl Side {
    fn new(p: Corner, q: Corner, x: i32, y: i32) -> Self {
        let (dx, dy) = (i64::from(q.x - p.x), i64::from(q.y - p.y));
        let e = dx * i64::from((y << SUBPIXEL_BITS) - p.y) - dy * i64::from((x << SUBPIXEL_BITS) - p.x);
        let top_or_left = dy < 0 || (dy == 0 && dx > 0);
        let edge = (e - i64::from(!top_or_left)) >> SUBPIXEL_BITS;
        Self { edge, rest: e - (edge << SUBPIXEL_BITS), right: -dy, down: dx }
    }
}

/// Draws a triangle that has area: finds the covered span of every row by division.
#[inline(always)]
pub(crate) fn fill(face: u32, [a, b, c]: [Corner; 3], band: &mut Band) {
    let (left, right) = (a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x));
    let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
    let x = [first_pixel(left).max(0), (right >> SUBPIXEL_BITS).min(band.width - 1)];
    let y = [first_pixel(top).max(band.top), (bottom >> SUBPIXEL_BITS).min(band.top + band.height - 1)];
    let area = twice_area(a, b, c);
    if x[0] > x[1] || y[0] > y[1] {
        return;
    }
    let (b, c) = if area < 0 { (c, b) } else { (b, c) };
    let side = |p, q| Side::new(p, q, x[0], y[0]);
    let sides = [side(b, c), side(c, a), side(a, b)];
    let w = [a, b, c].map(|corner| f64::from(corner.w) * f64::from(1 << SUBPIXEL_BITS) / area.abs() as f64);
    let sum = |value: &dyn Fn(&Side) -> i64| (0..3).map(|k| value(&sides[k]) as f64 * w[k]).sum::<f64>();
    let slope = sum(&|side| side.right);
    let rest = sum(&|side| side.rest) / f64::from(1 << SUBPIXEL_BITS);
    let range = [a.w.min(b.w).min(c.w), a.w.max(b.w).max(c.w)];
    for row in y[0]..=y[1] {
        let edge = |side: &Side| side.edge + i64::from(row - y[0]) * side.down;
        let (mut first, mut last) = (0, i64::from(x[1] - x[0]));
        for side in &sides {
            let edge = edge(side);
            match side.right {
                1.. => first = first.max(-edge.div_euclid(side.right)),
                ..0 => last = last.min(edge.div_euclid(-side.right)),
                0 if edge < 0 => last = -1,
                0 => {}
            }
        }
        if first > last {
            continue;
        }
        let base = sum(&edge) + rest;
        let start = (i64::from(row - band.top) * i64::from(band.stride) + i64::from(x[0])) as usize;
        let span = start + first as usize..start + last as usize + 1;
        for (there, x) in band.keys[span].iter_mut().zip(first as i32..) {
            // Long slivers cancel; no pixel lies beyond the corners.
            let here = ((base + slope * f64::from(x)) as f32).max(range[0]).min(range[1]);
            *there = (*there).max(key(here, face));
        }
    }
}
