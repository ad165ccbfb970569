//! Which triangles cover a pixel centre at all, sixteen at a time.
//!
//! Most triangles of a scan are about as large as a pixel or smaller and lie between the centres, or cover one or two. So
//! the boxes of all triangles are tested first; what is left and small is then tested pixel by pixel with a triangle in each
//! lane, and only larger triangles are drawn one by one.

use crate::Triangles;
use crate::clip::{Vertex, clip};
use crate::corner::{CLIP, Corner, Projected, SUBPIXEL_BITS, first_pixel, twice_area};
use crate::prefetch::prefetch;
use crate::projector::Projector;
use crate::three::each;
use fearless_simd::{Level, dispatch, f32x16, i32x16, mask32x16, prelude::*};

/// Triangles looked at together.
const LANES: usize = 16;

/// How many triangles ahead vertices are prefetched.
const AHEAD: usize = 4 * LANES;

/// How many triangles ahead their indices are prefetched: in a cache line there are five.
const FAR_AHEAD: usize = 128 * LANES;

/// Edge functions of a triangle in a box of this many units fit in an i32.
const SMALL: i32 = 7 << SUBPIXEL_BITS;

/// A small triangle's box has at most this many pixels a side.
const SMALL_PIXELS: i32 = 6;

/// Where visible pieces of triangles go.
pub(crate) trait Sink {
    /// The picture of a triangle at one pixel.
    fn fragment(&mut self, fragment: Fragment, y: u32);
    /// A triangle to be drawn.
    fn triangle<S: Simd>(&mut self, simd: S, face: u32, corners: [Corner; 3]);
    /// A piece of a triangle to be drawn.
    fn piece<S: Simd>(&mut self, simd: S, face: u32, corners: [Corner; 3]);
}

/// What a triangle shows at a pixel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fragment {
    /// Index of the pixel in the picture.
    pub(crate) pixel: u32,
    pub(crate) face: u32,
    /// 1/z.
    pub(crate) w: f32,
}

/// Decides which triangles are worth drawing.
pub(crate) struct Sieve<'a> {
    pub(crate) mesh: &'a Triangles<'a>,
    pub(crate) projector: &'a Projector<'a>,
    pub(crate) projected: &'a Projected,
    pub(crate) cull: bool,
    /// Width and height of the picture.
    pub(crate) bounds: [i32; 2],
}

/// Sixteen triangles: faces and corner positions.
#[derive(Clone, Copy)]
struct Batch<S: Simd> {
    face: i32x16<S>,
    x: [i32x16<S>; 3],
    y: [i32x16<S>; 3],
}

/// Triangles on their way to be drawn: room for those left of one batch and all of the next.
#[derive(Default)]
struct Queue {
    count: usize,
    face: [[i32; LANES]; 2],
    x: [[[i32; LANES]; 2]; 3],
    y: [[[i32; LANES]; 2]; 3],
}

/// Their boxes and what pixels those may cover within the picture.
struct Boxes<S: Simd> {
    left: i32x16<S>,
    width: i32x16<S>,
    height: i32x16<S>,
    first: [i32x16<S>; 2],
    last: [i32x16<S>; 2],
}

impl Sieve<'_> {
    /// Passes on whatever a range of triangles may show.
    pub(crate) fn sift(&self, level: Level, range: std::ops::Range<usize>, sink: &mut impl Sink) {
        dispatch!(level, simd => self.sift_with(simd, range, sink));
    }

    #[inline(always)]
    fn sift_with<S: Simd>(&self, simd: S, range: std::ops::Range<usize>, sink: &mut impl Sink) {
        let lanes = i32x16::load_array(simd, std::array::from_fn(|lane| lane as i32));
        let mut queue = Queue::default();
        for start in range.clone().step_by(LANES) {
            let triangles = &self.mesh.indices[start..range.end.min(start + LANES)];
            for triangle in [0, 5, 10, 15] {
                prefetch(self.mesh.indices, start + FAR_AHEAD + triangle);
            }
            let ahead = start + AHEAD..range.end.min(start + AHEAD + LANES);
            for vertex in self.mesh.indices.get(ahead).unwrap_or_default().as_flattened() {
                prefetch(&self.projected.xy, *vertex as usize);
            }
            let mut xy = [[[CLIP; 2]; LANES]; 3];
            for (lane, triangle) in triangles.iter().enumerate().take(LANES) {
                for k in 0..3 {
                    xy[k][lane] = self.projected.position(triangle[k]);
                }
            }
            let batch = Batch::new(simd, &xy, lanes + start as i32);
            let (small, rest) = self.classify(simd, &batch);
            queue.push(&batch, small);
            if let Some(batch) = queue.pop(simd) {
                self.cover(simd, &batch, LANES, sink);
            }
            let valid = (1 << triangles.len()) - 1;
            for lane in bits(rest.to_bitmask() & valid) {
                self.pass_on(simd, (start + lane) as u32, triangles[lane], sink);
            }
        }
        self.cover(simd, &queue.first(simd), queue.count, sink);
    }

    /// The small triangles whose boxes hold pixel centres, and the others that may be seen. Lanes without a triangle come
    /// as [`CLIP`] and are among the others.
    #[inline(always)]
    fn classify<S: Simd>(&self, simd: S, batch: &Batch<S>) -> (mask32x16<S>, mask32x16<S>) {
        let boxes = batch.boxes(simd, self.bounds);
        let clipped = boxes.left.simd_eq(CLIP);
        let seen = boxes.last[0].simd_ge(boxes.first[0]) & boxes.last[1].simd_ge(boxes.first[1]);
        let pixels = (boxes.last[0] - boxes.first[0]).max(boxes.last[1] - boxes.first[1]);
        let longest = SMALL.min(self.projector.lens.longest_edge);
        let small = boxes.width.max(boxes.height).simd_lt(longest) & pixels.simd_lt(SMALL_PIXELS);
        let area = batch.twice_area();
        let facing = if self.cull { area.simd_lt(0) } else { !area.simd_eq(0) };
        (seen & small & facing & !clipped, clipped | (seen & !small))
    }

    /// Draws small triangles, one a lane, pixel by pixel of their boxes.
    #[inline(always)]
    fn cover<S: Simd>(&self, simd: S, batch: &Batch<S>, count: usize, sink: &mut impl Sink) {
        let mut batch = *batch;
        let faces: [i32; LANES] = batch.face.into();
        let mut w = [[0.0; LANES]; 3];
        for (lane, &face) in faces.iter().enumerate().take(count) {
            let triangle = self.mesh.indices[face as u32 as usize];
            for k in 0..3 {
                w[k][lane] = self.projected.w[triangle[k] as usize];
            }
        }
        let mut w = [f32x16::load_array(simd, w[0]), f32x16::load_array(simd, w[1]), f32x16::load_array(simd, w[2])];
        let Boxes { first, last, .. } = batch.boxes(simd, self.bounds);
        let area = batch.twice_area();
        let turned = area.simd_lt(0);
        for values in [&mut batch.x, &mut batch.y] {
            (values[1], values[2]) = (turned.select(values[2], values[1]), turned.select(values[1], values[2]));
        }
        (w[1], w[2]) = (turned.select(w[2], w[1]), turned.select(w[1], w[2]));
        let scale = f32x16::splat(simd, 1.0) / area.max(-area).to_float::<f32x16<S>>();
        let w = [w[0] * scale, w[1] * scale, w[2] * scale];
        // Edge k is opposite to corner k; `edge` is its function at the pixel, `open` is −1 where its points do not belong.
        let start = [first[0] << SUBPIXEL_BITS, first[1] << SUBPIXEL_BITS];
        let sides = each(
            [(1, 2), (2, 0), (0, 1)],
            #[inline(always)]
            |(p, q): (usize, usize)| {
                let (dx, dy) = (batch.x[q] - batch.x[p], batch.y[q] - batch.y[p]);
                let edge = dx * (start[1] - batch.y[p]) - dy * (start[0] - batch.x[p]);
                let closed = dy.simd_lt(0) | (dy.simd_eq(0) & dx.simd_gt(0));
                let open = closed.select(i32x16::splat(simd, 0), i32x16::splat(simd, -1));
                (edge, open, dx << SUBPIXEL_BITS, dy << SUBPIXEL_BITS)
            },
        );
        let valid = (1_u64 << count) - 1;
        let [columns, rows] = [last[0] - first[0], last[1] - first[1]];
        let origin: [i32; LANES] = (first[1] * self.bounds[0] + first[0]).into();
        let top: [i32; LANES] = first[1].into();
        for row in 0..SMALL_PIXELS {
            let in_row = rows.simd_ge(row);
            if in_row.to_bitmask() & valid == 0 {
                break;
            }
            let mut edges = each(
                sides,
                #[inline(always)]
                |(edge, _, dx, _)| edge + dx * row,
            );
            for column in 0..SMALL_PIXELS {
                let in_box: mask32x16<S> = in_row & columns.simd_ge(column);
                if in_box.to_bitmask() & valid == 0 {
                    break;
                }
                let signs = (edges[0] + sides[0].1) | (edges[1] + sides[1].1) | (edges[2] + sides[2].1);
                let covered = (in_box & signs.simd_ge(0)).to_bitmask() & valid;
                if covered != 0 {
                    let [a, b, c] = each(
                        edges,
                        #[inline(always)]
                        |edge| edge.to_float::<f32x16<S>>(),
                    );
                    let here: [f32; LANES] = (a * w[0] + b * w[1] + c * w[2]).into();
                    for lane in bits(covered) {
                        let pixel = (origin[lane] + row * self.bounds[0] + column) as u32;
                        let fragment = Fragment { pixel, face: faces[lane] as u32, w: here[lane] };
                        sink.fragment(fragment, (top[lane] + row) as u32);
                    }
                }
                for (edge, side) in edges.iter_mut().zip(&sides) {
                    *edge -= side.3;
                }
            }
        }
    }

    /// Passes on a triangle that is not small, through the clipper where needed.
    #[inline(always)]
    fn pass_on<S: Simd>(&self, simd: S, face: u32, triangle: [u32; 3], sink: &mut impl Sink) {
        let corners = each(
            triangle,
            #[inline(always)]
            |i| self.projected.corner(i),
        );
        let [a, b, c] = corners;
        let long =
            |p: Corner, q: Corner| p.x.abs_diff(q.x).max(p.y.abs_diff(q.y)) > self.projector.lens.longest_edge as u32;
        if corners.iter().any(|corner| corner.x == CLIP) || long(a, b) || long(b, c) || long(c, a) {
            self.cut(simd, face, corners, sink);
        } else if self.faces_us(corners) {
            sink.triangle(simd, face, corners);
        }
    }

    /// Passes on what the clipper leaves of a triangle.
    fn cut<S: Simd>(&self, simd: S, face: u32, corners: [Corner; 3], sink: &mut impl Sink) {
        let Some(positions) = self.mesh.corners(face) else { return };
        let vertices = std::array::from_fn(|k| Vertex {
            point: self.projector.in_camera(positions[k]),
            corner: Some(corners[k]).filter(|corner| corner.x != CLIP),
        });
        clip(self.projector, vertices, &mut |piece| {
            if self.faces_us(piece) && self.may_show(piece) {
                sink.piece(simd, face, piece);
            }
        });
    }

    /// Whether a triangle has area, seen from a side that is to be drawn.
    fn faces_us(&self, [a, b, c]: [Corner; 3]) -> bool {
        let area = twice_area(a, b, c);
        area < 0 || (area > 0 && !self.cull)
    }

    /// Whether a triangle's box holds a pixel centre of the picture.
    fn may_show(&self, [a, b, c]: [Corner; 3]) -> bool {
        let holds = |a: i32, b: i32, c: i32, size: i32| {
            first_pixel(a.min(b).min(c)).max(0) <= (a.max(b).max(c) >> SUBPIXEL_BITS).min(size - 1)
        };
        holds(a.x, b.x, c.x, self.bounds[0]) && holds(a.y, b.y, c.y, self.bounds[1])
    }
}

impl<S: Simd> Batch<S> {
    #[inline(always)]
    fn new(simd: S, xy: &[[[i32; 2]; LANES]; 3], face: i32x16<S>) -> Self {
        let [a, b, c] = xy.each_ref().map(|xy| xy.as_flattened().split_at(LANES));
        let load = |half: &[i32]| i32x16::from_slice(simd, half);
        let a = load(a.0).deinterleave(load(a.1));
        let b = load(b.0).deinterleave(load(b.1));
        let c = load(c.0).deinterleave(load(c.1));
        Self { face, x: [a.0, b.0, c.0], y: [a.1, b.1, c.1] }
    }

    #[inline(always)]
    fn boxes(&self, simd: S, [width, height]: [i32; 2]) -> Boxes<S> {
        let (left, right) = range(self.x);
        let (top, bottom) = range(self.y);
        let zero = i32x16::splat(simd, 0);
        let last = [i32x16::splat(simd, width - 1), i32x16::splat(simd, height - 1)];
        let round_up = (1 << SUBPIXEL_BITS) - 1;
        Boxes {
            left,
            width: right - left,
            height: bottom - top,
            first: [((left + round_up) >> SUBPIXEL_BITS).max(zero), ((top + round_up) >> SUBPIXEL_BITS).max(zero)],
            last: [(right >> SUBPIXEL_BITS).min(last[0]), (bottom >> SUBPIXEL_BITS).min(last[1])],
        }
    }

    #[inline(always)]
    fn twice_area(&self) -> i32x16<S> {
        let ([ax, bx, cx], [ay, by, cy]) = (self.x, self.y);
        (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    }
}

impl Queue {
    /// Appends the triangles a mask selects.
    #[inline(always)]
    fn push<S: Simd>(&mut self, batch: &Batch<S>, mask: mask32x16<S>) {
        let at = self.count..self.count + LANES;
        batch.face.compress(mask).store_slice(&mut self.face.as_flattened_mut()[at.clone()]);
        for k in 0..3 {
            batch.x[k].compress(mask).store_slice(&mut self.x[k].as_flattened_mut()[at.clone()]);
            batch.y[k].compress(mask).store_slice(&mut self.y[k].as_flattened_mut()[at.clone()]);
        }
        self.count += mask.to_bitmask().count_ones() as usize;
    }

    /// The first sixteen triangles, fewer if there are not as many.
    #[inline(always)]
    fn first<S: Simd>(&self, simd: S) -> Batch<S> {
        let load = |lanes: &[[i32; LANES]; 2]| i32x16::load_array(simd, lanes[0]);
        let ([x0, x1, x2], [y0, y1, y2]) = (&self.x, &self.y);
        Batch { face: load(&self.face), x: [load(x0), load(x1), load(x2)], y: [load(y0), load(y1), load(y2)] }
    }

    /// Takes out sixteen triangles once there are as many.
    #[inline(always)]
    fn pop<S: Simd>(&mut self, simd: S) -> Option<Batch<S>> {
        if self.count < LANES {
            return None;
        }
        let batch = self.first(simd);
        self.count -= LANES;
        self.face[0] = self.face[1];
        for k in 0..3 {
            self.x[k][0] = self.x[k][1];
            self.y[k][0] = self.y[k][1];
        }
        Some(batch)
    }
}

#[inline(always)]
fn range<S: Simd>([a, b, c]: [i32x16<S>; 3]) -> (i32x16<S>, i32x16<S>) {
    (a.min(b).min(c), a.max(b).max(c))
}

/// The positions of the bits that are set, lowest first.
#[inline(always)]
fn bits(mut mask: u64) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = mask.trailing_zeros() as usize;
        (mask != 0).then(|| {
            mask &= mask - 1;
            lane
        })
    })
}
