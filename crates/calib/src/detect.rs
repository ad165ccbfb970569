//! A checkerboard in a picture: candidates, corners, grids, and the grid laid onto the board, on one level of a pyramid
//! after the other until the whole board is seen.

use crate::board::{Placed, place};
use crate::corner::Corner;
use crate::grid::grid;
use crate::refine::refine;
use crate::response::candidates;
use crate::{Board, BoardCorner, Image};
use nalgebra::Point2;
use rayon::prelude::*;

/// What a picture shows of the board.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// The corners found, row by row.
    pub corners: Vec<BoardCorner>,
    /// Columns and rows of the grid the picture shows, which may be another than the board's.
    pub grid: (usize, usize),
    /// Whether that grid has no gaps.
    pub is_full: bool,
}

impl Sighting {
    /// Whether every corner of the board was found, and nothing beyond.
    pub fn is_whole(&self, board: &Board) -> bool {
        self.corners.len() == board.corners() && board.is_like(self.grid)
    }
}

/// Images larger than this on their longer side are looked at in a smaller size first.
const COMFORTABLE: usize = 1000;

/// The shortest side of an image worth looking at.
const SMALLEST: usize = 60;

/// Finds the board in a picture, as a whole or in part; `None` if it shows no six corners in a grid, or only some in one
/// line.
///
/// Corners are those of dark and bright squares meeting; which of several equivalent ways a board is indexed by is
/// settled by its dark first square and by x pointing to the right. Needs squares of about 8 pixels and more.
pub fn detect(image: &Image, board: &Board) -> Option<Sighting> {
    let shortest = image.width().min(image.height());
    let last = (0..16).take_while(|i| shortest >> i >= SMALLEST).last()?;
    let first = (0..last).find(|i| image.width().max(image.height()) >> i <= COMFORTABLE).unwrap_or(last);
    // Blurred boards show on smaller levels, small ones on larger levels.
    let order = (first..=last).chain((0..first).rev());
    let mut smaller: Vec<(usize, usize, Vec<f32>)> = Vec::new();
    let mut best: Option<Sighting> = None;
    for i in order {
        while smaller.len() < i {
            let last = smaller.last().map_or(Some(*image), |(w, h, values)| Image::new(*w, *h, values))?;
            smaller.push(last.halved());
        }
        let level = match i.checked_sub(1) {
            None => *image,
            Some(i) => Image::new(smaller[i].0, smaller[i].1, &smaller[i].2)?,
        };
        let Some((placed, grid, is_full)) = look(&level, board) else { continue };
        let placed: Vec<Placed> = placed.into_iter().map(|(cell, corner)| (cell, enlarged(&corner, i))).collect();
        let sighting = Sighting { corners: pinpoint(image, &placed, WIDEST * f64::from(1u32 << i)), grid, is_full };
        // A few corners more from a level that fits less may be none, unless they make the board whole.
        let (found, before) = (sighting.corners.len(), best.as_ref().map_or(0, |other| other.corners.len()));
        if 8 * found > 9 * before || (found > before && found == board.corners()) {
            best = Some(sighting);
        }
        if best.as_ref().is_some_and(|sighting| sighting.corners.len() == board.corners()) {
            break;
        }
    }
    let sighting = best?;
    let spread = |index: fn(&BoardCorner) -> usize| {
        let indices = sighting.corners.iter().map(index);
        indices.clone().max().zip(indices.min()).is_some_and(|(max, min)| max > min)
    };
    (sighting.corners.len() >= 6 && spread(|c| c.column) && spread(|c| c.row)).then_some(sighting)
}

/// The board on a level: its corners on the board, the size of the grid and whether it has no gaps.
fn look(level: &Image, board: &Board) -> Option<(Vec<Placed>, (usize, usize), bool)> {
    let near = candidates(level);
    let corners: Vec<Corner> = near
        .par_iter()
        .with_min_len(64)
        .filter_map(|&(x, y)| Corner::measure(level, Point2::new(x as f64, y as f64)))
        .collect();
    let limits = (board.columns.max(board.rows), board.columns.min(board.rows));
    let grid = grid(level, &corners, limits)?;
    let (width, height) = grid.size();
    let placed = place(&grid, board, (level.width(), level.height()));
    Some((placed, (width, height), grid.cells.len() == width * height))
}

/// A corner of a level in the pixels of the image.
fn enlarged(corner: &Corner, level: usize) -> Corner {
    let scale = f64::from(1u32 << level);
    let at = corner.at.coords.map(|v| (v + 0.5) * scale - 0.5);
    Corner { at: at.into(), ..*corner }
}

/// The corners to a fraction of a pixel, each from the pixels within a radius of at most `widest`.
fn pinpoint(image: &Image, placed: &[Placed], widest: f64) -> Vec<BoardCorner> {
    let at = |cell: (usize, usize)| placed.iter().find(|(other, _)| *other == cell).map(|(_, corner)| corner.at);
    let refined = placed.par_iter().with_min_len(16).filter_map(|((column, row), corner)| {
        let (c, r) = (*column, *row);
        let neighbours = [(c + 1, r), (c, r + 1), (c.wrapping_sub(1), r), (c, r.wrapping_sub(1))];
        let spacing = neighbours.into_iter().filter_map(at).map(|n| (n - corner.at).norm()).min_by(f64::total_cmp)?;
        let radius = (WINDOW * spacing).clamp(2.5, widest);
        let pixel = refine(image, corner, radius)?;
        ((pixel - corner.at).norm() < 0.15 * spacing).then_some(BoardCorner { column: c, row: r, pixel })
    });
    refined.collect()
}

/// The radius of the pixels a corner is fitted to, as a share of the distance to the nearest other corner.
const WINDOW: f64 = 0.4;

/// Its most, in pixels; in large images, which are hardly sharp to the pixel, it grows with their size.
const WIDEST: f64 = 8.0;
