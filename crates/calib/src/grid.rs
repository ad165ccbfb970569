//! Corners joined to grids: each corner looks for its neighbours along its four edges, and grids grow from there.
//!
//! Two corners are neighbours if each is the nearest to the other along an edge, their edges agree on the line between
//! them, and that line really separates bright from dark all the way. Bright and dark change sides from one corner to
//! the next, so an edge with bright behind it meets one with dark behind it. What the links leave out is then looked for
//! where a homography of the corners around it predicts it.

use crate::corner::Corner;
use crate::{Image, homography};
use nalgebra::{Point2, Vector2};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Corners by their place in the grid: x along the board's one direction, y along the other, a quarter turn clockwise.
#[derive(Clone, Debug, Default)]
pub(crate) struct Grid {
    /// By (x, y), with the origin where the square at the corner's lower right, towards +x and +y, is bright; so it is
    /// wherever x + y is even.
    pub(crate) cells: BTreeMap<(i32, i32), Corner>,
}

/// How far an edge may be from the line to the neighbour, radians.
const ASTRAY: f64 = 0.35;

/// The squared cosine of that.
const ALONG: f64 = 0.882;

/// How many of the corners around are looked at for neighbours, the nearest.
const AROUND: usize = 24;

/// How many corners along an edge are tried before it is said to have no neighbour.
const TRIES: usize = 3;

/// How far from its prediction a corner may lie, as a share of the distance to its neighbours.
const TOLERANCE: f64 = 0.25;

/// How much of a corner's contrast its neighbour must have, at least.
const CONTRAST: f32 = 0.2;

/// The fewest corners of a grid.
const FEWEST: usize = 6;

/// The largest grid of a picture. It grows beyond what links join as long as it stays within `limits`, the longer and the
/// shorter side of the board in corners.
pub(crate) fn grid(image: &Image, corners: &[Corner], limits: (usize, usize)) -> Option<Grid> {
    let links = links(image, corners);
    let mut taken = vec![false; corners.len()];
    let mut grids = Vec::new();
    for seed in 0..corners.len() {
        if !taken[seed] {
            grids.push(connected(corners, &links, seed, &mut taken));
        }
    }
    let largest = grids.iter().map(|grid| grid.cells.len()).max()?;
    // A board in pieces: the piece that grows largest.
    grids.retain(|grid| grid.cells.len() >= FEWEST && 2 * grid.cells.len() >= largest);
    for grid in &mut grids {
        grid.drop_astray();
        grid.complete(image, corners, limits);
        grid.prune();
        grid.trim(limits);
    }
    grids.into_iter().rev().max_by_key(|grid| grid.cells.len())
}

/// The neighbour along each of a corner's edges, and the edge of the neighbour that leads back.
type Links = Vec<[Option<(usize, usize)>; 4]>;

/// The directions of a corner's two lines.
struct Lines([Vector2<f64>; 2]);

impl Lines {
    fn new(corner: &Corner) -> Self {
        Self([0, 1].map(|i| Vector2::new(corner.edges[i].cos(), corner.edges[i].sin())))
    }

    /// The edge along which a gap of this squared length lies.
    fn edge(&self, gap: &Vector2<f64>, square: f64) -> Option<usize> {
        let along = [self.0[0].dot(gap), self.0[1].dot(gap)];
        let line = usize::from(along[1].abs() > along[0].abs());
        (along[line] * along[line] > ALONG * square).then_some(if along[line] > 0.0 { line } else { line + 2 })
    }
}

fn links(image: &Image, corners: &[Corner]) -> Links {
    let lines: Vec<Lines> = corners.iter().map(Lines::new).collect();
    let nearest = |(a, corner): (usize, &Corner)| {
        let square = |b: usize| (corners[b].at - corner.at).norm_squared();
        let mut around: Vec<(f64, usize)> = (0..corners.len()).map(|b| (square(b), b)).collect();
        let by_distance = |x: &(f64, usize), y: &(f64, usize)| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1));
        if around.len() > AROUND {
            around.select_nth_unstable_by(AROUND, by_distance);
            around.truncate(AROUND);
        }
        around.sort_unstable_by(by_distance);
        // The nearest few along each edge.
        let mut along: [Vec<(usize, usize)>; 4] = Default::default();
        for (distance, b) in around {
            let other = &corners[b];
            let gap = other.at - corner.at;
            if distance < 9.0 {
                continue;
            }
            let (Some(edge), Some(back)) = (lines[a].edge(&gap, distance), lines[b].edge(&-gap, distance)) else {
                continue;
            };
            if !(edge + back).is_multiple_of(2) && along[edge].len() < TRIES && alike(corner, other) {
                along[edge].push((b, back));
            }
        }
        let mut edge = 0..;
        along.map(|list| {
            let edge = edge.next()?;
            list.into_iter().find(|(b, _)| separates(image, corner, &corners[*b].at, edge))
        })
    };
    let nearest: Links = corners.par_iter().enumerate().with_min_len(32).map(nearest).collect();
    let mutual = |a: usize, edge: usize| nearest[a][edge].filter(|&(b, back)| nearest[b][back] == Some((a, edge)));
    (0..corners.len()).map(|a| std::array::from_fn(|edge| mutual(a, edge))).collect()
}

/// Whether two corners may be neighbours by their contrast.
fn alike(a: &Corner, b: &Corner) -> bool {
    a.contrast > CONTRAST * b.contrast && b.contrast > CONTRAST * a.contrast
}

/// Whether the line from a corner along one of its edges to `end` has bright and dark on the sides the corner says.
fn separates(image: &Image, corner: &Corner, end: &Point2<f64>, edge: usize) -> bool {
    let gap = end - corner.at;
    let length = gap.norm();
    let aside = Vector2::new(-gap.y, gap.x) * ((0.1 * length).clamp(1.5, 8.0) / length);
    let sign = if edge.is_multiple_of(2) { 1.0 } else { -1.0 };
    [0.3, 0.5, 0.7].into_iter().all(|t| {
        let on = corner.at + gap * t;
        let (ahead, behind) = (on + aside, on - aside);
        sign * (image.sample(ahead.x, ahead.y) - image.sample(behind.x, behind.y)) > 0.25 * corner.contrast
    })
}

/// The grid that links join to a corner. Where they contradict each other, the first say counts.
fn connected(corners: &[Corner], links: &Links, seed: usize, taken: &mut [bool]) -> Grid {
    let mut grid = Grid::default();
    // Edge (direction + offset) mod 4 of a corner leads in the grid's direction +x, +y, −x, −y.
    let mut queue = std::collections::VecDeque::from([(seed, (0, 0), 0)]);
    taken[seed] = true;
    grid.cells.insert((0, 0), corners[seed]);
    while let Some((a, (x, y), offset)) = queue.pop_front() {
        for (direction, (dx, dy)) in [(1, 0), (0, 1), (-1, 0), (0, -1)].into_iter().enumerate() {
            let Some((b, back)) = links[a][(direction + offset) % 4] else { continue };
            let cell = (x + dx, y + dy);
            if taken[b] || grid.cells.contains_key(&cell) {
                continue;
            }
            taken[b] = true;
            grid.cells.insert(cell, corners[b]);
            queue.push_back((b, cell, (back + 8 - (direction + 2)) % 4));
        }
    }
    grid
}

impl Grid {
    /// The least and the greatest coordinates.
    pub(crate) fn bounds(&self) -> ((i32, i32), (i32, i32)) {
        let xs = || self.cells.keys().map(|c| c.0);
        let ys = || self.cells.keys().map(|c| c.1);
        let (x0, x1) = (xs().min().unwrap_or(0), xs().max().unwrap_or(-1));
        let (y0, y1) = (ys().min().unwrap_or(0), ys().max().unwrap_or(-1));
        ((x0, y0), (x1, y1))
    }

    /// Columns and rows.
    pub(crate) fn size(&self) -> (usize, usize) {
        let ((x0, y0), (x1, y1)) = self.bounds();
        ((x1 - x0 + 1) as usize, (y1 - y0 + 1) as usize)
    }

    /// The distance to the nearest neighbour, if a cell has one.
    pub(crate) fn spacing(&self, (x, y): (i32, i32), at: &Point2<f64>) -> Option<f64> {
        let neighbours = [(x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)];
        let distances = neighbours.iter().filter_map(|cell| self.cells.get(cell)).map(|other| (other.at - at).norm());
        distances.min_by(f64::total_cmp)
    }

    /// Drops corners that are not where those around them say.
    fn drop_astray(&mut self) {
        let astray = |cell: &(i32, i32), corner: &Corner| {
            let predicted = self.predict(*cell);
            let spacing = self.spacing(*cell, &corner.at);
            predicted.zip(spacing).is_none_or(|(p, spacing)| (p - corner.at).norm() > TOLERANCE * spacing)
        };
        let dropped: Vec<_> =
            self.cells.iter().filter(|(cell, corner)| astray(cell, corner)).map(|(c, _)| *c).collect();
        for cell in dropped {
            self.cells.remove(&cell);
        }
    }

    /// Where a cell should be seen, by a homography of the cells around it, itself left out.
    fn predict(&self, (x, y): (i32, i32)) -> Option<Point2<f64>> {
        let mut around: Vec<(i32, (i32, i32))> = Vec::with_capacity(48);
        for reach in [2, 3] {
            around.clear();
            let cells = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
            let known = cells.filter(|d| *d != (0, 0) && self.cells.contains_key(&(x + d.0, y + d.1)));
            around.extend(known.map(|d| (d.0 * d.0 + d.1 * d.1, d)));
            if around.len() >= 8 {
                break;
            }
        }
        around.sort_unstable();
        around.truncate(12);
        let pairs: Vec<_> = around
            .iter()
            .map(|&(_, (dx, dy))| (Point2::new(f64::from(dx), f64::from(dy)), self.cells[&(x + dx, y + dy)].at))
            .collect();
        homography::at_origin(&pairs)
    }

    /// Drops corners with a single neighbour: every corner of a board has two.
    fn prune(&mut self) {
        loop {
            let neighbours = |&(x, y): &(i32, i32)| {
                let beside = [(x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)];
                beside.iter().filter(|cell| self.cells.contains_key(cell)).count()
            };
            let dangling: Vec<_> = self.cells.keys().filter(|cell| neighbours(cell) < 2).copied().collect();
            if dangling.is_empty() {
                return;
            }
            for cell in dangling {
                self.cells.remove(&cell);
            }
        }
    }

    /// Takes off outer lines with gaps, the emptiest first, as long as the grid is larger than the board.
    fn trim(&mut self, (longer, shorter): (usize, usize)) {
        loop {
            let (width, height) = self.size();
            if width.max(height) <= longer && width.min(height) <= shorter {
                return;
            }
            let ((x0, y0), (x1, y1)) = self.bounds();
            let on = |line: usize, (x, y): (i32, i32)| [x == x0, x == x1, y == y0, y == y1][line];
            let fill = |line: usize| {
                let count = self.cells.keys().filter(|cell| on(line, **cell)).count();
                count as f64 / if line < 2 { height } else { width } as f64
            };
            let Some(line) = (0..4).min_by(|a, b| fill(*a).total_cmp(&fill(*b))).filter(|line| fill(*line) < 0.7)
            else {
                return;
            };
            self.cells.retain(|cell, _| !on(line, *cell));
        }
    }

    /// Looks for corners that are missing, inside and around, until there are no more.
    fn complete(&mut self, image: &Image, corners: &[Corner], (longer, shorter): (usize, usize)) {
        loop {
            let ((x0, y0), (x1, y1)) = self.bounds();
            let fits =
                |width: i32, height: i32| width.max(height) as usize <= longer && width.min(height) as usize <= shorter;
            let mut added = Vec::new();
            for cell in self.rim() {
                let (left, right) = (cell.0.min(x0), cell.0.max(x1));
                let (top, bottom) = (cell.1.min(y0), cell.1.max(y1));
                let inside = (left, top, right, bottom) == (x0, y0, x1, y1);
                if !inside && !fits(right - left + 1, bottom - top + 1) {
                    continue;
                }
                added.extend(self.look(image, corners, cell).map(|corner| (cell, corner)));
            }
            let mut grown = false;
            for (cell, corner) in added {
                // Two cells of one round may extend the grid in both directions; the later one waits for the limits.
                let ((x0, y0), (x1, y1)) = self.bounds();
                let (width, height) = (cell.0.max(x1) - cell.0.min(x0) + 1, cell.1.max(y1) - cell.1.min(y0) + 1);
                if (width, height) == (x1 - x0 + 1, y1 - y0 + 1) || fits(width, height) {
                    self.cells.insert(cell, corner);
                    grown = true;
                }
            }
            if !grown {
                return;
            }
        }
    }

    /// Empty cells beside full ones.
    fn rim(&self) -> Vec<(i32, i32)> {
        let beside = |&(x, y): &(i32, i32)| [(x + 1, y), (x, y + 1), (x - 1, y), (x, y - 1)];
        let mut rim: Vec<_> = self.cells.keys().flat_map(beside).filter(|c| !self.cells.contains_key(c)).collect();
        rim.sort_unstable();
        rim.dedup();
        rim
    }

    /// The corner of an empty cell, if the picture shows one where it should be.
    fn look(&self, image: &Image, corners: &[Corner], (x, y): (i32, i32)) -> Option<Corner> {
        let predicted = self.predict((x, y))?;
        let spacing = self.spacing((x, y), &predicted)?;
        if !image.contains(predicted.x, predicted.y, 3.0) {
            return None;
        }
        let free = |corner: &&Corner| self.cells.values().all(|other| (other.at - corner.at).norm() > 0.4 * spacing);
        let off = |corner: &Corner| (corner.at - predicted).norm();
        let known = corners.iter().filter(|c| off(c) < TOLERANCE * spacing).filter(free);
        let known = known.min_by(|a, b| off(a).total_cmp(&off(b))).copied();
        let corner = known.or_else(|| Corner::measure(image, predicted))?;
        if off(&corner) > TOLERANCE * spacing {
            return None;
        }
        let directions = [(1, 0), (0, 1), (-1, 0), (0, -1)];
        let agrees = directions.into_iter().enumerate().filter_map(|(direction, (dx, dy))| {
            let neighbour = self.cells.get(&(x + dx, y + dy))?;
            let gap = neighbour.at - corner.at;
            let (edge, off) = corner.edge_towards(gap.y.atan2(gap.x));
            let rising = (x + y + direction as i32) % 2 == 0;
            let joins = off <= ASTRAY && edge.is_multiple_of(2) == rising && alike(&corner, neighbour);
            Some(joins && separates(image, &corner, &neighbour.at, edge))
        });
        agrees.fold(None, |all, agrees| Some(all.unwrap_or(true) && agrees)).unwrap_or(false).then_some(corner)
    }
}
