//! Which meshlets a picture shows, and in which order they are drawn.
//!
//! What is behind something else is left out after N. Greene, M. Kass and G. Miller (*Hierarchical Z-buffer visibility*,
//! SIGGRAPH 1993), with one level of the hierarchy: a band first draws what nothing seems to hide, and then of the rest what
//! is not behind all that it has. Both only spare work: the picture is the same.

use crate::band::{Band, TILE};
use crate::batch::LANES;
use crate::meshlets::Meshlets;
use crate::projector::Projector;
use crate::sieve::Sieve;
use fearless_simd::{Level, dispatch, f32x16, i32x16, mask32x16, prelude::*};
use rayon::prelude::*;
use std::ops::Range;

/// Meshlets a task looks at.
const TASK: usize = 512;

/// What recedes by no more than so many widths of a tile within it seems to be one surface.
const STEEPEST: f32 = 4.0;

/// A mesh before a camera.
pub(crate) struct Sight<'a> {
    pub(crate) level: Level,
    pub(crate) projector: &'a Projector<'a>,
    pub(crate) meshlets: &'a Meshlets,
    /// The picture's.
    pub(crate) width: u32,
    pub(crate) height: u32,
}

/// A meshlet that may be seen.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    meshlet: u32,
    /// First and last column of the picture's tiles that it reaches into, and rows.
    x: [u16; 2],
    pub(crate) y: [u16; 2],
    /// 1/z of the farthest and the nearest that it may reach to.
    w: [f32; 2],
}

impl Sight<'_> {
    /// Finds the meshlets that may reach into the picture, in tasks of consecutive ones.
    pub(crate) fn find(&self, seen: &mut Vec<Vec<Seen>>, spread: bool) {
        let count = self.meshlets.boxes().len();
        seen.resize_with(count.div_ceil(TASK), Vec::new);
        let find = |(k, seen): (usize, &mut Vec<Seen>)| {
            let range = k * TASK..((k + 1) * TASK).min(count);
            seen.clear();
            dispatch!(self.level, _simd => seen.extend(range.filter_map(
                #[inline(always)]
                |k| self.look(k)
            )));
        };
        if spread {
            seen.par_iter_mut().enumerate().for_each(find);
        } else {
            seen.iter_mut().enumerate().for_each(find);
        }
    }

    /// Whether a meshlet may be seen, and where.
    #[inline(always)]
    fn look(&self, meshlet: usize) -> Option<Seen> {
        let extent = self.projector.extent(&self.meshlets.boxes()[meshlet])?;
        // The casts saturate.
        let within =
            |[low, high]: [f64; 2], size: u32| [(low.ceil() as i32).max(0), (high.floor() as i32).min(size as i32 - 1)];
        let (x, y) = (within(extent.x, self.width), within(extent.y, self.height));
        let tile = |pixel: i32| (pixel / TILE as i32) as u16;
        let seen = Seen { meshlet: meshlet as u32, x: x.map(tile), y: y.map(tile), w: extent.w };
        (x[0] <= x[1] && y[0] <= y[1]).then_some(seen)
    }

    /// Draws a band, of which `tiles` is working memory.
    pub(crate) fn draw(&self, shown: &[Seen], cull: bool, band: &mut Band, tiles: &mut Vec<f32>) {
        dispatch!(self.level, simd => self.draw_with(simd, shown, cull, band, tiles));
    }

    #[inline(always)]
    fn draw_with<S: Simd>(&self, simd: S, shown: &[Seen], cull: bool, band: &mut Band, tiles: &mut Vec<f32>) {
        let mut sieve = Sieve::new(self.projector, cull);
        let mut grid = Grid::new(simd, band, tiles);
        shown.iter().for_each(|seen| grid.raise(simd, seen));
        band.clear(grid.tiles, grid.stride);
        let slope = STEEPEST * TILE as f32 / self.projector.focal();
        let mut hidden = Vec::new();
        for seen in shown {
            let [far, near] = seen.w;
            if grid.lets_through(simd, seen, near + 2.0 * (near - far) + slope * near) {
                sieve.sift(simd, &self.meshlets.meshlet(seen.meshlet as usize), band);
            } else {
                hidden.push(seen);
            }
        }
        band.farthest(grid.tiles, grid.stride);
        for seen in hidden {
            if grid.lets_through(simd, seen, seen.w[1]) {
                sieve.sift(simd, &self.meshlets.meshlet(seen.meshlet as usize), band);
            }
        }
    }
}

/// 1/z of a depth in each tile of a band, negative where there is none.
struct Grid<'a, S: Simd> {
    tiles: &'a mut [f32],
    /// Numbers in a row: sixteen may be read from any tile on.
    stride: usize,
    /// The rows of the picture's tiles that the band has.
    rows: Range<usize>,
    lanes: i32x16<S>,
}

impl<'a, S: Simd> Grid<'a, S> {
    #[inline(always)]
    fn new(simd: S, band: &Band, tiles: &'a mut Vec<f32>) -> Self {
        let stride = (band.width as usize).div_ceil(TILE) + LANES - 1;
        let top = band.top as usize / TILE;
        let rows = top..top + (band.height as usize).div_ceil(TILE);
        tiles.clear();
        tiles.resize(stride * rows.len(), -1.0);
        Self { tiles, stride, rows, lanes: i32x16::load_array(simd, std::array::from_fn(|k| k as i32)) }
    }

    /// Puts a meshlet's far end into the tiles that it reaches into, unless a nearer one is there.
    #[inline(always)]
    fn raise(&mut self, simd: S, seen: &Seen) {
        self.any(
            seen,
            #[inline(always)]
            |tiles, reached| {
                let there = f32x16::from_slice(simd, tiles);
                reached.select(there.max(seen.w[0]), there).store_slice(tiles);
                false
            },
        );
    }

    /// Whether what is as near as this would be seen in any of the tiles that a meshlet reaches into.
    #[inline(always)]
    fn lets_through(&mut self, simd: S, seen: &Seen, nearest: f32) -> bool {
        self.any(
            seen,
            #[inline(always)]
            |tiles, reached| (reached & f32x16::from_slice(simd, tiles).simd_le(nearest)).any_true(),
        )
    }

    /// Whether something holds of sixteen tiles, of which a meshlet reaches into some.
    #[inline(always)]
    fn any(&mut self, seen: &Seen, mut holds: impl FnMut(&mut [f32], mask32x16<S>) -> bool) -> bool {
        let [left, right] = seen.x.map(usize::from);
        let [first, last] = seen.y.map(usize::from);
        for row in first.max(self.rows.start)..(last + 1).min(self.rows.end) {
            let mut x = left;
            while x <= right {
                let start = (row - self.rows.start) * self.stride + x;
                let reached = self.lanes.simd_le((right - x) as i32);
                if holds(&mut self.tiles[start..start + LANES], reached) {
                    return true;
                }
                x += LANES;
            }
        }
        false
    }
}
