//! Sixteen triangles that are looked at together, one in each lane.
//!
//! Edge functions (J. Pineda, *A parallel algorithm for polygon rasterization*, SIGGRAPH 1988) in exact integers decide
//! which pixels a triangle covers; a centre on an edge belongs to the triangle whose top or left edge it is. What a pixel
//! gets depends on the triangle and the pixel alone, never on the band, nor on which of the two ways to fill is taken.

use crate::band::{Band, COLUMNS};
use crate::corner::{CLIP, Corner, SUBPIXEL_BITS};
use crate::three::each;
use fearless_simd::{f32x16, i32x16, i64x8, mask32x16, prelude::*};

/// Triangles looked at together.
pub(crate) const LANES: usize = 16;

/// All numbers of a triangle in a box of fewer units a side fit in an i32.
pub(crate) const SMALL: i32 = 64 << SUBPIXEL_BITS;

/// Boxes of at most so many pixels a side are filled with a triangle in each lane, larger ones row by row.
const TINY: i32 = 2;

/// The fraction of a pixel in fixed point.
const FRACTION: i32 = (1 << SUBPIXEL_BITS) - 1;

/// Sixteen triangles.
#[derive(Clone, Copy)]
pub(crate) struct Batch<S: Simd> {
    /// x, y and the bits of 1/z of the three corners, as in [`Corner`].
    pub(crate) corners: [[i32x16<S>; 3]; 3],
    /// The bits of their indices in the mesh.
    pub(crate) faces: i32x16<S>,
}

/// What there is to be done with sixteen triangles.
pub(crate) struct Classes<S: Simd> {
    /// To be set up and filled with a triangle in each lane.
    pub(crate) tiny: mask32x16<S>,
    /// To be set up and filled row by row.
    pub(crate) small: mask32x16<S>,
    /// Large, or in need of the clipper.
    pub(crate) rest: mask32x16<S>,
}

/// The pixels that triangles may cover within a band.
struct Boxes<S: Simd> {
    first: [i32x16<S>; 2],
    last: [i32x16<S>; 2],
}

/// Sixteen small triangles prepared for drawing.
pub(crate) struct Setup<S: Simd> {
    faces: i32x16<S>,
    sides: [Side<S>; 3],
    /// 1/z at the corners over the doubled area in units of 4096 square units.
    w: [f32x16<S>; 3],
    /// What [`Side::rest`] adds to 1/z.
    rest: f32x16<S>,
    /// The index in the band of the box's first pixel, and where from there its last column and row are.
    origin: i32x16<S>,
    last: [i32x16<S>; 2],
}

/// The sides opposite to a corner, in front of which the triangles' insides lie. With e the edge function, in square units,
/// and b = −1 if the side's own points belong to the neighbour, else 0:
#[derive(Clone, Copy)]
struct Side<S: Simd> {
    /// ⌊(e + b) / 4096⌋ at the first pixel: not negative inside. Steps between pixels are multiples of 4096.
    edge: i32x16<S>,
    /// e − 4096 · `edge`, the same at all pixels.
    rest: i32x16<S>,
    /// What `edge` gains by one pixel to the right and one down.
    right: i32x16<S>,
    down: i32x16<S>,
}

impl<S: Simd> Batch<S> {
    /// One triangle, in every lane.
    #[inline(always)]
    pub(crate) fn splat(simd: S, face: u32, corners: [Corner; 3]) -> Self {
        let splat = |value: i32| i32x16::splat(simd, value);
        let corner = |k: usize| [splat(corners[k].x), splat(corners[k].y), splat(corners[k].w.to_bits() as i32)];
        Self { corners: [corner(0), corner(1), corner(2)], faces: splat(face as i32) }
    }

    /// Tells triangles apart that may show something in a band. Edges from `longest` units on are not drawn straight.
    #[inline(always)]
    pub(crate) fn classify(&self, simd: S, longest: i32, cull: bool, band: &Band) -> Classes<S> {
        let ([left, right], [top, bottom]) = (self.range(0), self.range(1));
        let clipped = left.simd_eq(CLIP);
        let Boxes { first, last } = self.boxes(simd, band);
        let (columns, rows) = (last[0] - first[0] + 1, last[1] - first[1] + 1);
        let seen = columns.min(rows).simd_gt(0);
        let is_small = (right - left).max(bottom - top).simd_lt(SMALL.min(longest));
        let [high, low] = self.twice_area();
        let facing = if cull { high.simd_lt(0) } else { !(high | low).simd_eq(0) };
        let is_tiny = columns.max(rows).simd_le(TINY);
        let small = seen & is_small & facing & !clipped;
        Classes { tiny: small & is_tiny, small: small & !is_tiny, rest: clipped | (seen & !is_small) }
    }

    /// Prepares triangles; what comes of those that are not small or have no area means nothing.
    #[inline(always)]
    pub(crate) fn setup(&self, simd: S, band: &Band) -> Setup<S> {
        let Boxes { first, last } = self.boxes(simd, band);
        let [high, low] = self.twice_area();
        // So that all run clockwise in the picture.
        let turned = high.simd_lt(0);
        let [a, b, c] = self.corners;
        let swap = |k: usize| [a[k], turned.select(c[k], b[k]), turned.select(b[k], c[k])];
        let (x, y, w) = (swap(0), swap(1), swap(2));
        let area = high.to_float::<f32x16<S>>() * 512.0 + low.to_float::<f32x16<S>>();
        let scale = f32x16::splat(simd, (1 << SUBPIXEL_BITS) as f32) / area.abs();
        let w = each(
            w,
            #[inline(always)]
            |w| w.bitcast::<f32x16<S>>() * scale,
        );
        let start = [first[0] << SUBPIXEL_BITS, first[1] << SUBPIXEL_BITS];
        let sides = each(
            [(1, 2), (2, 0), (0, 1)],
            #[inline(always)]
            |(p, q): (usize, usize)| {
                let (dx, dy) = (x[q] - x[p], y[q] - y[p]);
                let (to_x, to_y) = (start[0] - x[p], start[1] - y[p]);
                let top_or_left = dy.simd_lt(0) | (dy.simd_eq(0) & dx.simd_gt(0));
                let b = top_or_left.select(i32x16::splat(simd, 0), i32x16::splat(simd, -1));
                // The whole pixels of the way from p apart, so that nothing overflows.
                let low = dx * (to_y & FRACTION) - dy * (to_x & FRACTION) + b;
                let edge = dx * (to_y >> SUBPIXEL_BITS) - dy * (to_x >> SUBPIXEL_BITS) + (low >> SUBPIXEL_BITS);
                Side { edge, rest: (low & FRACTION) - b, right: -dy, down: dx }
            },
        );
        let rest = |k: usize| sides[k].rest.to_float::<f32x16<S>>() * w[k];
        Setup {
            faces: self.faces,
            sides,
            w,
            rest: (rest(0) + rest(1) + rest(2)) * (1.0 / (1 << SUBPIXEL_BITS) as f32),
            origin: (first[1] - band.top) * band.stride + first[0],
            last: [last[0] - first[0], last[1] - first[1]],
        }
    }

    #[inline(always)]
    fn boxes(&self, simd: S, band: &Band) -> Boxes<S> {
        let ([left, right], [top, bottom]) = (self.range(0), self.range(1));
        let end = |position: i32, size: i32| [i32x16::splat(simd, position), i32x16::splat(simd, position + size - 1)];
        let (x, y) = (end(0, band.width), end(band.top, band.height));
        let round_up = |coordinate: i32x16<S>| (coordinate + FRACTION) >> SUBPIXEL_BITS;
        Boxes {
            first: [round_up(left).max(x[0]), round_up(top).max(y[0])],
            last: [(right >> SUBPIXEL_BITS).min(x[1]), (bottom >> SUBPIXEL_BITS).min(y[1])],
        }
    }

    /// The least and the greatest x or y.
    #[inline(always)]
    fn range(&self, axis: usize) -> [i32x16<S>; 2] {
        let [a, b, c] = [self.corners[0][axis], self.corners[1][axis], self.corners[2][axis]];
        [a.min(b).min(c), a.max(b).max(c)]
    }

    /// Twice the signed areas of small triangles: multiples of 512, and what is left, which is not negative.
    #[inline(always)]
    fn twice_area(&self) -> [i32x16<S>; 2] {
        let [[ax, ay, _], [bx, by, _], [cx, cy, _]] = self.corners;
        let (ux, uy, vx, vy) = (bx - ax, by - ay, cx - ax, cy - ay);
        let high = (ux >> 9) * vy - (uy >> 9) * vx;
        let low = (ux & 511) * vy - (uy & 511) * vx;
        [high + (low >> 9), low & 511]
    }
}

impl<S: Simd> Setup<S> {
    /// Draws the triangles that a mask selects, all at once, into two columns of two rows.
    #[inline(always)]
    pub(crate) fn fill_lanes(&self, mask: u64, band: &mut Band) {
        let (mut covered, mut here) = (0, [[0.0; LANES]; 4]);
        for (pixel, here) in here.iter_mut().enumerate() {
            let edges = each(
                self.sides,
                #[inline(always)]
                |side| side.edge + side.right * (pixel % 2) as i32 + side.down * (pixel / 2) as i32,
            );
            covered |= ((edges[0] | edges[1] | edges[2]).simd_ge(0).to_bitmask() & mask) << (LANES * pixel);
            *here = self.inverse_depth(edges).into();
        }
        let (faces, origin): ([i32; LANES], [i32; LANES]) = (self.faces.into(), self.origin.into());
        let steps = [0, 1, band.stride, band.stride + 1];
        for bit in bits(covered) {
            let (pixel, lane) = (bit / LANES, bit % LANES);
            band.put((origin[lane] + steps[pixel]) as usize, here[pixel][lane], faces[lane] as u32);
        }
    }

    /// 1/z where the sides' functions have these values.
    #[inline(always)]
    fn inverse_depth(&self, edges: [i32x16<S>; 3]) -> f32x16<S> {
        let [a, b, c] = each(
            edges,
            #[inline(always)]
            |edge| edge.to_float::<f32x16<S>>(),
        );
        a * self.w[0] + b * self.w[1] + c * self.w[2] + self.rest
    }

    /// Draws the triangles that a mask selects, one by one, eight columns of two rows at a time.
    #[inline(always)]
    pub(crate) fn fill_rows(&self, simd: S, mask: u64, band: &mut Band) {
        let store = |values: i32x16<S>| -> [i32; LANES] { values.into() };
        let (faces, origin) = (store(!self.faces), store(self.origin));
        let (chunks, pairs) = (store((self.last[0] >> 3) + 1), store((self.last[1] >> 1) + 1));
        let sides = each(
            self.sides,
            #[inline(always)]
            |side| [store(side.edge), store(side.right), store(side.down)],
        );
        let w = each(
            self.w,
            #[inline(always)]
            |w| -> [f32; LANES] { w.into() },
        );
        let rest: [f32; LANES] = self.rest.into();
        let columns = i32x16::load_array(simd, [0, 1, 2, 3, 4, 5, 6, 7, 0, 1, 2, 3, 4, 5, 6, 7]);
        let rows = i32x16::load_array(simd, [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1]);
        let (stride, keys) = (band.stride as u32, &mut *band.keys);
        for lane in bits(mask) {
            let lane = lane % LANES;
            let splat = |values: &[i32; LANES]| i32x16::splat(simd, values[lane]);
            let [a, b, c] = each(
                [0, 1, 2],
                #[inline(always)]
                |k: usize| {
                    let [edge, right, down] = &sides[k];
                    let (right, down) = (splat(right), splat(down));
                    (splat(edge) + columns * right + rows * down, right << 3, down << 1)
                },
            );
            let mut starts = [a.0, b.0, c.0];
            let mut start = origin[lane] as u32;
            for _ in 0..chunks[lane] {
                let (mut edges, mut index) = (starts, start);
                for _ in 0..pairs[lane] {
                    let [ea, eb, ec] = each(
                        edges,
                        #[inline(always)]
                        |edge| edge.to_float::<f32x16<S>>(),
                    );
                    let here = ea * w[0][lane] + eb * w[1][lane] + ec * w[2][lane] + rest[lane];
                    // Outside, the key becomes negative and never wins.
                    let outside = (edges[0] | edges[1] | edges[2]) & i32::MIN;
                    let (first, second) = splat(&faces).interleave(here.bitcast::<i32x16<S>>() | outside);
                    for (at, here) in [(index, first), (index.wrapping_add(stride), second)] {
                        if let Some(there) = keys.get_mut(at as usize..at as usize + COLUMNS) {
                            let here: i64x8<S> = here.bitcast();
                            here.max(i64x8::from_slice(simd, there)).store_slice(there);
                        }
                    }
                    edges = [edges[0] + a.2, edges[1] + b.2, edges[2] + c.2];
                    index = index.wrapping_add(2 * stride);
                }
                starts = [starts[0] + a.1, starts[1] + b.1, starts[2] + c.1];
                start += COLUMNS as u32;
            }
        }
    }
}

/// The positions of the bits that are set, lowest first.
#[inline(always)]
pub(crate) fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        (mask != 0).then(|| {
            mask &= mask - 1;
            lane
        })
    })
}
