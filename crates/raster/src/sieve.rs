//! Which triangles cover a pixel centre at all, sixteen at a time.
//!
//! Most triangles of a scan are about as large as a pixel or smaller and lie between the centres, or cover one or two. So
//! the boxes of all triangles are tested first; what is left and small is then tested pixel by pixel with a triangle in each
//! lane, and only larger triangles are drawn one by one.

use crate::band::Band;
use crate::clip::{Vertex, Window, clip};
use crate::corner::{CLIP, Corner, SUBPIXEL_BITS, twice_area};
use crate::meshlets::{Meshlet, VERTICES};
use crate::projector::Projector;
use crate::three::each;
use fearless_simd::{f32x16, i32x16, mask32x16, prelude::*};

/// Triangles looked at together.
const LANES: usize = 16;

/// Edge functions of a triangle in a box of this many units fit in an i32.
const SMALL: i32 = 7 << SUBPIXEL_BITS;

/// A small triangle's box holds at most this many pixel centres a side.
const SMALL_PIXELS: i32 = 7;

/// Decides which triangles of a meshlet are worth drawing, and draws them.
pub(crate) struct Sieve<'a> {
    pub(crate) projector: &'a Projector<'a>,
    pub(crate) cull: bool,
    queue: Queue,
    local: Local,
}

/// The vertices of a meshlet on the image plane.
struct Local {
    /// Positions as in [`Corner`].
    xy: [[i32; 2]; VERTICES],
    w: [f32; VERTICES],
}

impl Local {
    #[inline(always)]
    fn corner(&self, vertex: u8) -> Corner {
        let [x, y] = self.xy[usize::from(vertex)];
        Corner { x, y, w: self.w[usize::from(vertex)] }
    }
}

/// The corner positions of sixteen triangles.
#[derive(Clone, Copy)]
struct Batch<S: Simd> {
    x: [i32x16<S>; 3],
    y: [i32x16<S>; 3],
}

/// Sixteen small triangles: corner positions, faces and 1/z of the corners.
#[derive(Clone, Copy)]
struct Small<S: Simd> {
    batch: Batch<S>,
    face: [u32; LANES],
    w: [f32x16<S>; 3],
}

/// Triangles on their way to be drawn: room for those left of one batch and all of the next.
#[derive(Default)]
struct Queue {
    count: usize,
    face: [[u32; LANES]; 2],
    x: [[[i32; LANES]; 2]; 3],
    y: [[[i32; LANES]; 2]; 3],
    w: [[[f32; LANES]; 2]; 3],
}

/// Their boxes and what pixels those may cover within a band.
struct Boxes<S: Simd> {
    left: i32x16<S>,
    width: i32x16<S>,
    height: i32x16<S>,
    first: [i32x16<S>; 2],
    last: [i32x16<S>; 2],
}

/// [`Projector::project`] in a function of its own, whose arguments are known not to overlap.
#[inline(never)]
fn project<S: Simd>(simd: S, projector: &Projector, positions: &[[f32; 3]], xy: &mut [[i32; 2]], w: &mut [f32]) {
    simd.vectorize(
        #[inline(always)]
        || projector.project(positions, xy, w),
    );
}

impl<'a> Sieve<'a> {
    pub(crate) fn new(projector: &'a Projector<'a>, cull: bool) -> Self {
        let local = Local { xy: [[0; 2]; VERTICES], w: [0.0; VERTICES] };
        Self { projector, cull, queue: Queue::default(), local }
    }

    /// Draws whatever a meshlet may show in a band, but for some that wait until they are [`flush`](Self::flush)ed.
    #[inline(always)]
    pub(crate) fn sift<S: Simd>(&mut self, simd: S, meshlet: &Meshlet, band: &mut Band) {
        let count = meshlet.positions.len();
        let Local { xy, w } = &mut self.local;
        project(simd, self.projector, meshlet.positions, &mut xy[..count], &mut w[..count]);
        for (k, triangles) in meshlet.corners.chunks(LANES).enumerate() {
            let start = k * LANES;
            let mut xy = [[[CLIP; 2]; LANES]; 3];
            for (lane, triangle) in triangles.iter().enumerate().take(LANES) {
                for k in 0..3 {
                    xy[k][lane] = self.local.xy[usize::from(triangle[k])];
                }
            }
            let batch = Batch::new(simd, &xy);
            let (small, rest) = self.classify(simd, &batch, band);
            self.queue.push(&batch, small, |lane| {
                let [a, b, c] = triangles[lane].map(|i| self.local.w[usize::from(i)]);
                (meshlet.face(start + lane), [a, b, c])
            });
            if let Some(small) = self.queue.pop(simd) {
                self.cover(simd, small, LANES, band);
            }
            let valid = (1 << triangles.len()) - 1;
            for lane in bits(rest.to_bitmask() & valid) {
                self.pass_on(simd, meshlet, start + lane, band);
            }
        }
    }

    /// Draws the triangles that still wait.
    #[inline(always)]
    pub(crate) fn flush<S: Simd>(&mut self, simd: S, band: &mut Band) {
        self.cover(simd, self.queue.first(simd), self.queue.count, band);
        self.queue.count = 0;
    }

    /// The small triangles whose boxes hold pixel centres, and the others that may be seen. Lanes without a triangle come
    /// as [`CLIP`] and are among the others.
    #[inline(always)]
    fn classify<S: Simd>(&self, simd: S, batch: &Batch<S>, band: &Band) -> (mask32x16<S>, mask32x16<S>) {
        let boxes = batch.boxes(simd, band);
        let clipped = boxes.left.simd_eq(CLIP);
        let seen = boxes.last[0].simd_ge(boxes.first[0]) & boxes.last[1].simd_ge(boxes.first[1]);
        let longest = SMALL.min(self.projector.lens.longest_edge);
        let small = boxes.width.max(boxes.height).simd_lt(longest);
        let area = batch.twice_area();
        let facing = if self.cull { area.simd_lt(0) } else { !area.simd_eq(0) };
        (seen & small & facing & !clipped, clipped | (seen & !small))
    }

    /// Draws small triangles, one a lane, pixel by pixel of their boxes.
    #[inline(always)]
    fn cover<S: Simd>(&self, simd: S, small: Small<S>, count: usize, band: &mut Band) {
        let Small { mut batch, face, mut w } = small;
        let Boxes { first, last, .. } = batch.boxes(simd, band);
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
        let origin: [i32; LANES] = ((first[1] - band.top) * band.width + first[0]).into();
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
                        band.put((origin[lane] + row * band.width + column) as usize, here[lane], face[lane]);
                    }
                }
                for (edge, side) in edges.iter_mut().zip(&sides) {
                    *edge -= side.3;
                }
            }
        }
    }

    /// Draws a triangle that is not small, through the clipper where needed.
    #[inline(always)]
    fn pass_on<S: Simd>(&self, simd: S, meshlet: &Meshlet, triangle: usize, band: &mut Band) {
        let face = meshlet.face(triangle);
        let corners = each(
            meshlet.corners[triangle],
            #[inline(always)]
            |i| self.local.corner(i),
        );
        let [a, b, c] = corners;
        let long =
            |p: Corner, q: Corner| p.x.abs_diff(q.x).max(p.y.abs_diff(q.y)) > self.projector.lens.longest_edge as u32;
        if corners.iter().any(|corner| corner.x == CLIP) || long(a, b) || long(b, c) || long(c, a) {
            let positions = meshlet.corners[triangle].map(|i| meshlet.positions.get(usize::from(i)).copied());
            if let [Some(a), Some(b), Some(c)] = positions {
                self.cut(simd, face, [a, b, c], corners, band);
            }
        } else if self.faces_us(corners) {
            band.draw(simd, face, corners);
        }
    }

    /// Draws what the clipper leaves of a triangle.
    fn cut<S: Simd>(&self, simd: S, face: u32, positions: [[f32; 3]; 3], corners: [Corner; 3], band: &mut Band) {
        let vertices = std::array::from_fn(|k| Vertex {
            point: self.projector.in_camera(positions[k]),
            corner: Some(corners[k]).filter(|corner| corner.x != CLIP),
        });
        let window = Window { x: [0, band.width - 1], y: [band.top, band.top + band.height - 1] };
        clip(self.projector, vertices, &window, &mut |piece| {
            if self.faces_us(piece) {
                simd.vectorize(
                    #[inline(always)]
                    || band.draw(simd, face, piece),
                );
            }
        });
    }

    /// Whether a triangle has area, seen from a side that is to be drawn.
    fn faces_us(&self, [a, b, c]: [Corner; 3]) -> bool {
        let area = twice_area(a, b, c);
        area < 0 || (area > 0 && !self.cull)
    }
}

impl<S: Simd> Batch<S> {
    #[inline(always)]
    fn new(simd: S, xy: &[[[i32; 2]; LANES]; 3]) -> Self {
        let [a, b, c] = xy.each_ref().map(|xy| xy.as_flattened().split_at(LANES));
        let load = |half: &[i32]| i32x16::from_slice(simd, half);
        let a = load(a.0).deinterleave(load(a.1));
        let b = load(b.0).deinterleave(load(b.1));
        let c = load(c.0).deinterleave(load(c.1));
        Self { x: [a.0, b.0, c.0], y: [a.1, b.1, c.1] }
    }

    #[inline(always)]
    fn boxes(&self, simd: S, band: &Band) -> Boxes<S> {
        let (left, right) = range(self.x);
        let (top, bottom) = range(self.y);
        let first = [i32x16::splat(simd, 0), i32x16::splat(simd, band.top)];
        let last = [i32x16::splat(simd, band.width - 1), i32x16::splat(simd, band.top + band.height - 1)];
        let round_up = (1 << SUBPIXEL_BITS) - 1;
        Boxes {
            left,
            width: right - left,
            height: bottom - top,
            first: [
                ((left + round_up) >> SUBPIXEL_BITS).max(first[0]),
                ((top + round_up) >> SUBPIXEL_BITS).max(first[1]),
            ],
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
    /// Appends the triangles a mask selects, with their faces and 1/z.
    #[inline(always)]
    fn push<S: Simd>(&mut self, batch: &Batch<S>, mask: mask32x16<S>, more: impl Fn(usize) -> (u32, [f32; 3])) {
        let at = self.count..self.count + LANES;
        for k in 0..3 {
            batch.x[k].compress(mask).store_slice(&mut self.x[k].as_flattened_mut()[at.clone()]);
            batch.y[k].compress(mask).store_slice(&mut self.y[k].as_flattened_mut()[at.clone()]);
        }
        for lane in bits(mask.to_bitmask()) {
            let (face, w) = more(lane);
            self.face.as_flattened_mut()[self.count] = face;
            for (all, w) in self.w.iter_mut().zip(w) {
                all.as_flattened_mut()[self.count] = w;
            }
            self.count += 1;
        }
    }

    /// The first sixteen triangles, fewer if there are not as many.
    #[inline(always)]
    fn first<S: Simd>(&self, simd: S) -> Small<S> {
        let load = |lanes: &[[i32; LANES]; 2]| i32x16::load_array(simd, lanes[0]);
        let ([x0, x1, x2], [y0, y1, y2]) = (&self.x, &self.y);
        let batch = Batch { x: [load(x0), load(x1), load(x2)], y: [load(y0), load(y1), load(y2)] };
        let [w0, w1, w2] = &self.w;
        let load = |lanes: &[[f32; LANES]; 2]| f32x16::load_array(simd, lanes[0]);
        Small { batch, face: self.face[0], w: [load(w0), load(w1), load(w2)] }
    }

    /// Takes out sixteen triangles once there are as many.
    #[inline(always)]
    fn pop<S: Simd>(&mut self, simd: S) -> Option<Small<S>> {
        if self.count < LANES {
            return None;
        }
        let first = self.first(simd);
        self.count -= LANES;
        self.face[0] = self.face[1];
        for k in 0..3 {
            self.x[k][0] = self.x[k][1];
            self.y[k][0] = self.y[k][1];
            self.w[k][0] = self.w[k][1];
        }
        Some(first)
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
