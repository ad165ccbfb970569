//! Which meshlets a picture shows, and in which order they are drawn.
//!
//! What is behind something else is left out after N. Greene, M. Kass and G. Miller (*Hierarchical Z-buffer visibility*,
//! SIGGRAPH 1993), with one level of the hierarchy: a band first draws what nothing seems to hide, and then of the rest what
//! is not behind all that it has. Both only spare work: the picture is the same.

use crate::band::{Band, TILE};
use crate::meshlets::Meshlets;
use crate::projector::Projector;
use crate::sieve::Sieve;
use fearless_simd::{Level, dispatch, prelude::*};
use rayon::prelude::*;

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
        let columns = (band.width as usize).div_ceil(TILE);
        let (top, rows) = (band.top as usize / TILE, (band.height as usize).div_ceil(TILE));
        // The tiles of a meshlet, a range a row.
        let reach = |seen: &Seen| {
            let [left, right] = seen.x.map(usize::from);
            let [first, last] = seen.y.map(usize::from);
            let rows = first.max(top) - top..(last + 1 - top).min(rows);
            rows.map(move |row| row * columns + left..row * columns + right + 1)
        };
        // The nearest far end in each tile, negative where there is none.
        tiles.clear();
        tiles.resize(columns * rows, -1.0);
        for seen in shown {
            reach(seen).for_each(|range| tiles[range].iter_mut().for_each(|tile| *tile = tile.max(seen.w[0])));
        }
        band.clear(tiles);
        let slope = STEEPEST * TILE as f32 / self.projector.focal();
        let mut hidden = Vec::new();
        for seen in shown {
            let [far, near] = seen.w;
            let nearest = near + 2.0 * (near - far) + slope * near;
            if reach(seen).any(|range| tiles[range].iter().any(|&far| nearest >= far)) {
                sieve.sift(simd, &self.meshlets.meshlet(seen.meshlet as usize), band);
            } else {
                hidden.push(seen);
            }
        }
        sieve.flush(simd, band);
        band.farthest(tiles);
        for seen in hidden {
            if reach(seen).any(|range| tiles[range].iter().any(|&farthest| seen.w[1] >= farthest)) {
                sieve.sift(simd, &self.meshlets.meshlet(seen.meshlet as usize), band);
            }
        }
        sieve.flush(simd, band);
    }
}
