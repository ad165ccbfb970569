//! The board, and how a grid of corners lies on it.

use crate::corner::Corner;
use crate::grid::Grid;
use crate::homography;
use nalgebra::{Point2, Point3};

/// A checkerboard, measured by its inner corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Inner corners in a row.
    pub columns: usize,
    /// Inner corners in a column.
    pub rows: usize,
    /// The side of a square; poses come in its unit.
    pub square: f64,
}

impl Board {
    /// A corner of the board in its own frame: x along the columns, y along the rows, z = 0 and into the board.
    pub fn point(&self, column: usize, row: usize) -> Point3<f64> {
        Point3::new(column as f64 * self.square, row as f64 * self.square, 0.0)
    }

    /// The number of inner corners.
    pub fn corners(&self) -> usize {
        self.columns * self.rows
    }

    /// Whether two boards have as many corners along each side, turned or not.
    pub(crate) fn is_like(&self, (columns, rows): (usize, usize)) -> bool {
        (self.columns, self.rows) == (columns, rows) || (self.rows, self.columns) == (columns, rows)
    }
}

/// A corner of the board in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardCorner {
    /// Along the board's rows, from 0.
    pub column: usize,
    /// Along the board's columns, from 0.
    pub row: usize,
    /// Where the picture shows it.
    pub pixel: Point2<f64>,
}

/// A cell of the board with its corner.
pub(crate) type Placed = ((usize, usize), Corner);

/// Lays a grid onto the board: of all turns by quarters and all shifts, the one that has
///
/// 1. the most corners on the board, then
/// 2. the fewest corners missing that the picture should show, then
/// 3. a dark square beyond corner (0, 0), as on boards that start with one, then
/// 4. x pointing most to the right.
///
/// For a whole board with an odd and an even number of corners that is one way only. For others, and for parts of
/// boards, several are as good; a calibration does not depend on which it is.
pub(crate) fn place(grid: &Grid, board: &Board, size: (usize, usize)) -> Vec<Placed> {
    let pairs: Vec<_> = grid.cells.iter().map(|(&(x, y), corner)| (point(x, y), corner.at)).collect();
    let Some(h) = homography::dlt(&pairs) else { return Vec::new() };
    let (columns, rows) = (board.columns as i32, board.rows as i32);
    let mut best: Option<(Rank, Motion)> = None;
    for quarters in 0..4 {
        let turned = |cell| turn(cell, quarters);
        let xs = || grid.cells.keys().map(|c| turned(*c).0);
        let ys = || grid.cells.keys().map(|c| turned(*c).1);
        let (Some(x0), Some(x1), Some(y0), Some(y1)) = (xs().min(), xs().max(), ys().min(), ys().max()) else {
            return Vec::new();
        };
        // From one end flush with the board to the other.
        let shifts = |low: i32, high: i32, count: i32| (-low).min(count - 1 - high)..=(-low).max(count - 1 - high);
        for dy in shifts(y0, y1, rows) {
            for dx in shifts(x0, x1, columns) {
                let motion = Motion { quarters, dx, dy };
                let rank = rank(grid, &h, &motion, (columns, rows), size);
                if best.as_ref().is_none_or(|(other, _)| rank < *other) {
                    best = Some((rank, motion));
                }
            }
        }
    }
    let Some((_, motion)) = best else { return Vec::new() };
    let mut placed: Vec<Placed> = grid
        .cells
        .iter()
        .map(|(cell, corner)| (motion.apply(*cell), *corner))
        .filter(|((x, y), _)| (0..columns).contains(x) && (0..rows).contains(y))
        .map(|((x, y), corner)| ((x as usize, y as usize), corner))
        .collect();
    placed.sort_by_key(|((x, y), _)| (*y, *x));
    placed
}

/// Off the board, missing, corner (0, 0) not dark, degrees that x points away from the right: less is better.
type Rank = (usize, usize, bool, i32);

/// Cells of a grid to cells of the board.
struct Motion {
    quarters: i32,
    dx: i32,
    dy: i32,
}

impl Motion {
    fn apply(&self, cell: (i32, i32)) -> (i32, i32) {
        let (x, y) = turn(cell, self.quarters);
        (x + self.dx, y + self.dy)
    }

    fn invert(&self, (x, y): (i32, i32)) -> (i32, i32) {
        turn((x - self.dx, y - self.dy), 4 - self.quarters)
    }
}

fn rank(
    grid: &Grid,
    h: &nalgebra::Matrix3<f64>,
    motion: &Motion,
    (columns, rows): (i32, i32),
    (width, height): (usize, usize),
) -> Rank {
    let seen = |(x, y): (i32, i32)| homography::apply(h, &point(x, y));
    // Corners next to the border have no surroundings to be found by.
    let margin = 8.0;
    let visible = |p: Point2<f64>| {
        p.x > margin && p.y > margin && p.x < width as f64 - 1.0 - margin && p.y < height as f64 - 1.0 - margin
    };
    let mut found = 0;
    let mut missing = 0;
    for cell in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
        let in_grid = motion.invert(cell);
        if grid.cells.contains_key(&in_grid) {
            found += 1;
        } else if seen(in_grid).is_some_and(visible) {
            missing += 1;
        }
    }
    let origin = motion.invert((0, 0));
    // The square at the lower right of an even cell is bright; a quarter turn makes its lower left the lower right.
    let is_bright = (origin.0 + origin.1 + motion.quarters) % 2 == 0;
    let along = seen(motion.invert((columns - 1, 0))).zip(seen(origin)).map_or(0.0, |(end, start)| {
        let direction = end - start;
        direction.y.atan2(direction.x).to_degrees().abs()
    });
    (grid.cells.len() - found, missing, is_bright, along.round() as i32)
}

/// A cell turned counterclockwise by quarters.
fn turn((x, y): (i32, i32), quarters: i32) -> (i32, i32) {
    match quarters.rem_euclid(4) {
        0 => (x, y),
        1 => (y, -x),
        2 => (-x, -y),
        _ => (-y, x),
    }
}

fn point(x: i32, y: i32) -> Point2<f64> {
    Point2::new(f64::from(x), f64::from(y))
}
