//! Point clouds as surfaces: each point becomes a small square in its tangent plane, as far-reaching as its Voronoi cell, so
//! that neighbours hide what lies behind them and leave no holes between them, whatever the scale.
//!
//! Tangent planes come from the principal axes of the nearest points (H. Hoppe et al., *Surface reconstruction from
//! unorganized points*, SIGGRAPH 1992). A scanner's lines are often much denser than they are apart, and the nearest points
//! lie on one line: such points look at ever thinner copies of the cloud until their neighbours span a surface.
use std::num::NonZero;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::error::Defect;
use crate::mesh::{Attributes, Bounds, Mesh, localize};

/// How many of the nearest points, itself among them, are looked at around a point.
const NEIGHBOURS: NonZero<usize> = NonZero::new(13).expect("not zero");

/// Neighbours whose variance across their main direction is a smaller share of that along it lie on a line.
const LINE: f64 = 0.03;

/// Neighbours whose variance off their plane is a larger share of that across it are no surface.
const THICK: f64 = 0.2;

/// Squares reach this much farther than half of the way to the neighbours, as cells are no squares.
const OVERLAP: f64 = 1.25;

/// A side that reaches farther than so many times the opposite one spans a gap.
const LOPSIDED: f64 = 2.0;

/// Cells reach at most so many times as far as their neighbours' nearest neighbours are: a stray point is small. Where the
/// neighbours are no surface, it is once.
const STRAY: f64 = 3.0;

/// At most so many thinner copies of the cloud, each of half the resolution of the one before.
const COPIES: usize = 10;

/// Where a cloud was scanned from: what its normals look at.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scanner {
    /// A place in the world.
    At([f64; 3]),
    /// The origin if it lies within the cloud's bounding box, as in a scanner's own frame; else far above (z up), as is
    /// usual of survey coordinates.
    Unknown,
}

impl Mesh {
    /// A point cloud from points of the world: a mesh of one square a point (triangles 2i and 2i + 1 over the vertices 4i to
    /// 4i + 3) in the tangent plane, with the point's attributes at all corners.
    ///
    /// Normals that are not given, not finite or of no length are estimated from the nearest points and look at the scanner.
    ///
    /// # Errors
    /// Whatever breaks a mesh's promises is a [`Defect`].
    pub fn from_points(points: &[[f64; 3]], attributes: Attributes, scanner: Scanner) -> Result<Mesh, Defect> {
        attributes.check(points.len())?;
        let (origin, positions) = localize(points)?;
        Mesh::from_local_points(origin, &positions, attributes, scanner)
    }

    /// The cloud of what is valid already: finite positions relative to `origin`, as many values of each attribute as points.
    pub(crate) fn from_local_points(
        origin: [f64; 3],
        positions: &[[f32; 3]],
        attributes: Attributes,
        scanner: Scanner,
    ) -> Result<Mesh, Defect> {
        let scanner = match scanner {
            Scanner::At(place) => place,
            Scanner::Unknown => {
                let bounds = Bounds::over(positions);
                let inside = (0..3).all(|k| (bounds.low[k]..=bounds.high[k]).contains(&-origin[k]));
                if inside { [0.0; 3] } else { [origin[0], origin[1], f64::INFINITY] }
            }
        };
        splats(origin, positions, attributes, |_| scanner)
    }
}

/// The cloud over finite positions relative to `origin`, whose attributes have one value a point. `scanner` says where a
/// point was scanned from.
pub(crate) fn splats(
    origin: [f64; 3],
    points: &[[f32; 3]],
    attributes: Attributes,
    scanner: impl Fn(usize) -> [f64; 3] + Sync,
) -> Result<Mesh, Defect> {
    if points.is_empty() {
        return Err(Defect::NoFaces { vertices: 0 });
    }
    if points.len() > (u32::MAX / 4) as usize {
        return Err(Defect::TooManyVertices { vertices: 4 * points.len() as u64 });
    }
    let Attributes { normals, reflectance, colours, ambient_occlusion, mean_curvature, .. } = attributes;
    let given = |i: usize| {
        let normal = Vector3::from(normals.as_ref()?[i].map(f64::from));
        normal.try_normalize(1e-12).filter(|n| n.iter().all(|x| x.is_finite()))
    };
    let cells = cells(points, &given);
    let (squares, directions): (Vec<[[f32; 3]; 4]>, Vec<[f32; 3]>) = cells
        .into_par_iter()
        .enumerate()
        .map(|(i, cell)| {
            let point = Vector3::from(points[i].map(f64::from));
            let towards = Vector3::from(scanner(i)) - Vector3::from(origin) - point;
            let (corners, normal) = cell.square(given(i), &towards);
            let single = |v: Vector3<f64>| <[f32; 3]>::from(v.map(|x| x as f32));
            (corners.map(|corner| single(point + corner)), single(normal))
        })
        .unzip();
    let triangles =
        (0..points.len() as u32).flat_map(|i| [[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
    let attributes = Attributes {
        normals: Some(fourfold(directions)),
        reflectance: reflectance.map(fourfold),
        colours: colours.map(fourfold),
        ambient_occlusion: ambient_occlusion.map(fourfold),
        mean_curvature: mean_curvature.map(fourfold),
        uvs: None,
    };
    let mesh = Mesh::assemble(origin, squares.into_flattened(), triangles.collect(), attributes);
    Ok(Mesh { is_cloud: true, points: points.to_vec(), ..mesh })
}

/// Every value four times.
fn fourfold<T: Copy>(values: Vec<T>) -> Vec<T> {
    values.into_iter().flat_map(|value| [value; 4]).collect()
}

/// The place of every point among its neighbours.
fn cells(points: &[[f32; 3]], given: &(impl Fn(usize) -> Option<Vector3<f64>> + Sync)) -> Vec<Cell> {
    let mut thinned = Thinned::new(points, (0..points.len() as u32).collect());
    let nearest = |i: usize| {
        let neighbours = thinned.around(points, &points[i], NonZero::<usize>::MIN.saturating_add(3));
        neighbours.first().map_or(0.0, |(_, nearest)| nearest.norm() as f32)
    };
    let nearest: Vec<f32> = (0..points.len()).into_par_iter().map(nearest).collect();
    let look = |i: usize| {
        let neighbours = thinned.around(points, &points[i], NEIGHBOURS);
        let mut spacings: Vec<f32> = neighbours.iter().map(|&(number, _)| nearest[number as usize]).collect();
        spacings.sort_unstable_by(f32::total_cmp);
        let spacing = spacings.get(spacings.len() / 4).map_or(0.0, |&spacing| f64::from(spacing));
        let neighbours: Vec<Vector3<f64>> = neighbours.into_iter().map(|(_, vector)| vector).collect();
        let farthest = neighbours.last().map_or(0.0, |farthest| farthest.norm());
        (Cell::among(&neighbours, given(i), spacing), farthest)
    };
    let (mut cells, distances): (Vec<Cell>, Vec<f64>) = (0..points.len()).into_par_iter().map(look).unzip();
    let on_line = |cells: &[Cell]| -> Vec<usize> { (0..cells.len()).filter(|&i| cells[i].is_line).collect() };
    let mut open = on_line(&cells);
    let mut far: Vec<f64> = open.iter().map(|&i| distances[i]).collect();
    let middle = far.len() / 2;
    let mut side = if far.is_empty() { 0.0 } else { *far.select_nth_unstable_by(middle, f64::total_cmp).1 };
    for _ in 0..COPIES {
        if open.is_empty() || side <= 0.0 {
            break;
        }
        thinned = thinned.thinner(points, side);
        if thinned.numbers.len() < 2 * NEIGHBOURS.get() {
            break;
        }
        side *= 2.0;
        let wider = |&i: &usize| {
            let neighbours = thinned.around(points, &points[i], NEIGHBOURS);
            let neighbours: Vec<Vector3<f64>> = neighbours.into_iter().map(|(_, vector)| vector).collect();
            cells[i].widened(&neighbours, given(i))
        };
        let looked: Vec<Cell> = open.par_iter().map(wider).collect();
        for (&i, cell) in open.iter().zip(looked) {
            cells[i] = cell;
        }
        open.retain(|&i| cells[i].is_line);
    }
    cells
}

/// The mean curvature at the points of a cloud with unit normals, one a point: that of a curve towards a neighbour at d is
/// (n′ − n)·d / |d|², and the mean over all directions is the mean curvature (L. Euler, 1767).
pub(crate) fn mean_curvature(points: &[[f32; 3]], normal: impl Fn(usize) -> Vector3<f64> + Sync) -> Vec<f32> {
    let all = Thinned::new(points, (0..points.len() as u32).collect());
    let curvature = |i: usize| {
        let neighbours = all.around(points, &points[i], NEIGHBOURS);
        let bend = |(j, d): &(u32, Vector3<f64>)| (normal(*j as usize) - normal(i)).dot(d) / d.norm_squared();
        neighbours.iter().map(bend).sum::<f64>() / neighbours.len().max(1) as f64
    };
    fourfold((0..points.len()).into_par_iter().map(|i| curvature(i) as f32).collect())
}

/// Some points of the cloud.
struct Thinned {
    numbers: Vec<u32>,
    tree: Option<ImmutableKdTree<f32, 3>>,
}

impl Thinned {
    fn new(points: &[[f32; 3]], numbers: Vec<u32>) -> Self {
        let places: Vec<[f32; 3]> = numbers.iter().map(|&i| points[i as usize]).collect();
        Self { numbers, tree: ImmutableKdTree::new_from_slice(&places).ok() }
    }

    /// The nearest points to a place, nearest first, without those at the place itself: their numbers, and vectors to them.
    fn around(&self, points: &[[f32; 3]], place: &[f32; 3], count: NonZero<usize>) -> Vec<(u32, Vector3<f64>)> {
        let Some(tree) = &self.tree else { return Vec::new() };
        let nearest = tree.query(place).nearest_n::<SquaredEuclidean<f32>>(count).execute();
        let here = Vector3::from(place.map(f64::from));
        let found = nearest.iter().map(|found| {
            let number = self.numbers[found.item as usize];
            (number, Vector3::from(points[number as usize].map(f64::from)) - here)
        });
        found.filter(|(_, vector)| vector.norm_squared() > 0.0).collect()
    }

    /// The first point in each cube of this side that has any.
    fn thinner(&self, points: &[[f32; 3]], side: f64) -> Self {
        let cube = |i: u32| points[i as usize].map(|x| (f64::from(x) / side).floor() as i64);
        let mut keyed: Vec<([i64; 3], u32)> = self.numbers.par_iter().map(|&i| (cube(i), i)).collect();
        keyed.par_sort_unstable();
        keyed.dedup_by_key(|(cube, _)| *cube);
        Self::new(points, keyed.into_iter().map(|(_, i)| i).collect())
    }
}

/// The place of a point among its neighbours.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// Whether the neighbours lie on a line, so that nothing is known of what is beside it.
    is_line: bool,
    /// The unit normal, unless the neighbours lie on a line.
    normal: Option<Vector3<f64>>,
    /// The neighbours' main direction, in the tangent plane.
    along: Vector3<f64>,
    /// How far the cell reaches along and against it, and across it; infinite where no neighbour bounds it.
    reach: [[f64; 2]; 2],
}

impl Cell {
    /// The cell among these neighbours, which have their own nearest neighbours at about the distance `spacing`.
    fn among(neighbours: &[Vector3<f64>], given: Option<Vector3<f64>>, spacing: f64) -> Self {
        let ([third, second, first], [normal, _, along]) = principal_axes(neighbours);
        let is_line = second <= LINE * first;
        let mut cell = Self { is_line, normal: None, along, reach: [[f64::INFINITY; 2]; 2] };
        if !is_line {
            cell.lie_on(given.unwrap_or(normal), neighbours);
        }
        cell.reach[0] = reach(neighbours, &cell.along);
        let most = if third > THICK * second { spacing } else { STRAY * spacing };
        let limited = |reach: f64| if reach.is_finite() { reach.min(most) } else { reach };
        cell.reach = cell.reach.map(|reach| reach.map(limited));
        cell
    }

    /// The cell of a point on a line once it is seen among thinner neighbours: it spans the gap to the lines beside it if
    /// they are on both sides, and on one plane with it.
    fn widened(mut self, neighbours: &[Vector3<f64>], given: Option<Vector3<f64>>) -> Self {
        let ([third, second, first], [normal, ..]) = principal_axes(neighbours);
        if second > LINE * first && third > THICK * second {
            self.is_line = false;
        } else if second > LINE * first {
            let mut on_plane = Self { is_line: false, ..self };
            on_plane.lie_on(given.unwrap_or(normal), neighbours);
            if on_plane.reach[1].iter().all(|reach| reach.is_finite()) {
                return on_plane;
            }
        }
        self
    }

    /// Puts the cell onto the plane with a normal, and bounds it across the main direction.
    fn lie_on(&mut self, normal: Vector3<f64>, neighbours: &[Vector3<f64>]) {
        let along = self.along - normal * normal.dot(&self.along);
        self.along = along.try_normalize(1e-6).unwrap_or_else(|| orthogonal(&normal));
        self.normal = Some(normal);
        self.reach[1] = reach(neighbours, &normal.cross(&self.along));
    }

    /// The corners of the square from the point, counter-clockwise about the normal, and the normal: the given one, or one
    /// that looks `towards` the scanner.
    fn square(&self, given: Option<Vector3<f64>>, towards: &Vector3<f64>) -> ([Vector3<f64>; 4], Vector3<f64>) {
        let along = self.along;
        let normal = given.or(self.normal).unwrap_or_else(|| {
            let facing = towards.map(|x| x.clamp(-1e12, 1e12));
            (facing - along * along.dot(&facing)).try_normalize(1e-12).unwrap_or_else(|| orthogonal(&along))
        });
        let normal = if given.is_none() && normal.dot(towards) < 0.0 { -normal } else { normal };
        let across = self.normal.unwrap_or(normal).cross(&along);
        let [a, b] = self.reach.map(balanced);
        let (a, b) = (a.or(b).unwrap_or_default(), b.or(a).unwrap_or_default());
        let corner = |x: f64, y: f64| (along * x + across * y) * OVERLAP;
        let mut corners = [corner(-a[1], -b[1]), corner(a[0], -b[1]), corner(a[0], b[0]), corner(-a[1], b[0])];
        if along.cross(&across).dot(&normal) < 0.0 {
            corners.reverse();
        }
        (corners, normal)
    }
}

/// What two opposite sides of a cell reach, each at most so much farther than the other; `None` where neither is bounded.
fn balanced([plus, minus]: [f64; 2]) -> Option<[f64; 2]> {
    let most = LOPSIDED * plus.min(minus);
    most.is_finite().then_some(match (plus.is_finite(), minus.is_finite()) {
        (true, false) => [plus; 2],
        (false, true) => [minus; 2],
        _ => [plus.min(most), minus.min(most)],
    })
}

/// How far the Voronoi cell of the origin among its neighbours reaches along a unit vector and against it, bounded by the
/// neighbours within 60° of that direction.
fn reach(neighbours: &[Vector3<f64>], direction: &Vector3<f64>) -> [f64; 2] {
    let mut reach = [f64::INFINITY; 2];
    for neighbour in neighbours {
        let (square, along) = (neighbour.norm_squared(), neighbour.dot(direction));
        if along * along >= 0.25 * square {
            let side = usize::from(along < 0.0);
            reach[side] = reach[side].min(0.5 * square / along.abs());
        }
    }
    reach
}

/// The variances of vectors along their principal axes about their mean, the least first, and the axes.
fn principal_axes(vectors: &[Vector3<f64>]) -> ([f64; 3], [Vector3<f64>; 3]) {
    let count = vectors.len().max(1) as f64;
    let mean = vectors.iter().sum::<Vector3<f64>>() / count;
    let covariance = vectors.iter().map(|v| (v - mean) * (v - mean).transpose()).sum::<Matrix3<f64>>() / count;
    let eigen = covariance.symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| eigen.eigenvalues[i].total_cmp(&eigen.eigenvalues[j]));
    (order.map(|i| eigen.eigenvalues[i].max(0.0)), order.map(|i| eigen.eigenvectors.column(i).into_owned()))
}

/// Some unit vector orthogonal to a unit vector.
fn orthogonal(vector: &Vector3<f64>) -> Vector3<f64> {
    let axis = Vector3::ith(vector.iamin(), 1.0);
    vector.cross(&axis).normalize()
}
