//! Which triangles cover a pixel centre at all, sixteen at a time.
//!
//! Most triangles of a scan are about as large as a pixel or smaller and lie between the centres, or cover one or two. So
//! the boxes of all triangles are tested first. What is left is set up together; tiny ones are filled together as well,
//! small ones row by row, and only large ones are drawn from one to the next.

use crate::band::Band;
use crate::batch::{Batch, Classes, LANES, SMALL, bits};
use crate::clip::{Vertex, Window, clip};
use crate::corner::{CLIP, Corner, twice_area};
use crate::large;
use crate::meshlets::{GROUP, Meshlet, VERTICES};
use crate::projector::Projector;
use crate::three::each;
use fearless_simd::{i32x4, i32x16, prelude::*};

/// Decides which triangles of a meshlet are worth drawing, and draws them.
pub(crate) struct Sieve<'a> {
    pub(crate) projector: &'a Projector<'a>,
    pub(crate) cull: bool,
    local: Local,
}

/// The vertices of a meshlet on the image plane: x, y and the bits of 1/z as in [`Corner`], and nothing.
struct Local([[[i32; 4]; GROUP]; VERTICES / GROUP]);

impl Local {
    #[inline(always)]
    fn vertex(&self, vertex: u8) -> &[i32; 4] {
        &self.0.as_flattened()[usize::from(vertex)]
    }

    #[inline(always)]
    fn corner(&self, vertex: u8) -> Corner {
        let &[x, y, w, _] = self.vertex(vertex);
        Corner { x, y, w: f32::from_bits(w as u32) }
    }

    /// One of the corners of sixteen triangles.
    #[inline(always)]
    fn gather<S: Simd>(&self, simd: S, triangles: &[[u8; 3]; LANES], corner: usize) -> [i32x16<S>; 3] {
        let one = |k: usize| i32x4::from_slice(simd, self.vertex(triangles[k][corner]));
        let four = |k: usize| one(k).combine(one(k + 1)).combine(one(k + 2).combine(one(k + 3)));
        let (first, second) = (four(0).deinterleave(four(4)), four(8).deinterleave(four(12)));
        let ((x, w), (y, _)) = (first.0.deinterleave(second.0), first.1.deinterleave(second.1));
        [x, y, w]
    }
}

/// [`Projector::project`] in a function of its own, whose arguments are known not to overlap.
#[inline(never)]
fn project<S: Simd>(
    simd: S,
    projector: &Projector,
    positions: &[[[f32; GROUP]; 3]],
    corners: &mut [[[i32; 4]; GROUP]],
) {
    simd.vectorize(
        #[inline(always)]
        || projector.project(simd, positions, corners),
    );
}

impl<'a> Sieve<'a> {
    pub(crate) fn new(projector: &'a Projector<'a>, cull: bool) -> Self {
        Self { projector, cull, local: Local([[[0; 4]; GROUP]; VERTICES / GROUP]) }
    }

    /// Draws whatever a meshlet may show in a band.
    #[inline(always)]
    pub(crate) fn sift<S: Simd>(&mut self, simd: S, meshlet: &Meshlet, band: &mut Band) {
        project(simd, self.projector, meshlet.positions, &mut self.local.0[..meshlet.positions.len()]);
        for (k, triangles) in meshlet.corners.iter().enumerate() {
            let corners = each(
                [0, 1, 2],
                #[inline(always)]
                |corner| self.local.gather(simd, triangles, corner),
            );
            let batch = Batch { corners, faces: meshlet.faces(simd, k) };
            let Classes { tiny, small, rest } = batch.classify(simd, self.projector.lens.longest_edge, self.cull, band);
            if (tiny | small).any_true() {
                let setup = batch.setup(simd, band);
                setup.fill_lanes(tiny.to_bitmask(), band);
                setup.fill_rows(simd, small.to_bitmask(), band);
            }
            for lane in bits(rest.to_bitmask()) {
                self.pass_on(simd, meshlet, k, lane, band);
            }
        }
    }

    /// Draws a triangle that is not small, through the clipper where needed.
    #[inline(always)]
    fn pass_on<S: Simd>(&self, simd: S, meshlet: &Meshlet, batch: usize, lane: usize, band: &mut Band) {
        let triangle = meshlet.corners[batch][lane];
        let face = meshlet.face(batch, lane);
        let corners = each(
            triangle,
            #[inline(always)]
            |i| self.local.corner(i),
        );
        let [a, b, c] = corners;
        let long =
            |p: Corner, q: Corner| p.x.abs_diff(q.x).max(p.y.abs_diff(q.y)) > self.projector.lens.longest_edge as u32;
        if corners.iter().any(|corner| corner.x == CLIP) || long(a, b) || long(b, c) || long(c, a) {
            self.cut(simd, face, triangle.map(|corner| meshlet.position(corner)), corners, band);
        } else {
            self.draw(simd, face, corners, band);
        }
    }

    /// Draws what the clipper leaves of a triangle.
    fn cut<S: Simd>(&self, simd: S, face: u32, positions: [[f32; 3]; 3], corners: [Corner; 3], band: &mut Band) {
        let vertices = std::array::from_fn(|k| Vertex {
            point: self.projector.in_camera(positions[k]),
            corner: Some(corners[k]).filter(|corner| corner.x != CLIP),
        });
        let window = Window { x: [0, band.width - 1], y: [band.top, band.top + band.height - 1] };
        clip(self.projector, vertices, &window, &mut |piece| self.draw(simd, face, piece, band));
    }

    /// Draws a triangle with straight edges.
    fn draw<S: Simd>(&self, simd: S, face: u32, corners: [Corner; 3], band: &mut Band) {
        if !self.faces_us(corners) {
            return;
        }
        let side = |[a, b, c]: [i32; 3]| a.max(b).max(c) - a.min(b).min(c);
        let is_small = side(corners.map(|corner| corner.x)).max(side(corners.map(|corner| corner.y))) < SMALL;
        simd.vectorize(
            #[inline(always)]
            || {
                if is_small {
                    Batch::splat(simd, face, corners).setup(simd, band).fill_rows(simd, 1, band);
                } else {
                    large::fill(face, corners, band);
                }
            },
        );
    }

    /// Whether a triangle has area, seen from a side that is to be drawn.
    fn faces_us(&self, [a, b, c]: [Corner; 3]) -> bool {
        let area = twice_area(a, b, c);
        area < 0 || (area > 0 && !self.cull)
    }
}
