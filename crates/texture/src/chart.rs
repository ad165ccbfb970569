//! Cutting a surface into charts: connected patches that a parallel projection along one direction lays flat.
//!
//! Patches grow best-first from seeds whose directions are re-estimated, as in D. Cohen-Steiner, P. Alliez and M. Desbrun,
//! *Variational shape approximation*, SIGGRAPH 2004, but with a bound on the angle between a face and its patch's direction
//! instead of a number of patches. A parallel projection needs no unwrapping, stretches no face by more than that bound, and
//! costs a million triangles a second or two.

use nalgebra::Vector3;
use rayon::prelude::*;
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use texreg_surface::{Mesh, area_weighted_normals, weld};

/// No neighbour, or no chart yet.
pub(crate) const NONE: u32 = u32::MAX;

/// The cosine between a chart's direction and the smoothed normal of a face, at least, while charts grow.
const SMOOTH_LIMIT: f32 = 0.6;
/// The cosine between a chart's direction and the normal of a face itself, at least, while charts grow.
const FACE_LIMIT: f32 = 0.25;
/// The same for faces of small charts, which join their neighbours where they can.
const RELAXED_LIMIT: f32 = 0.12;
/// Charts of less than this share of the surface's area are small.
const SMALL: f64 = 2e-4;
/// How often directions are re-estimated.
const ROUNDS: usize = 2;

/// Part of a surface that is flattened along `direction`.
#[derive(Clone, Debug)]
pub(crate) struct Chart {
    /// Unit vector in the mesh frame; every face of the chart looks more along it than against it.
    pub(crate) direction: Vector3<f32>,
    /// Faces, ascending.
    pub(crate) faces: Vec<u32>,
}

/// The surface as a graph of faces.
pub(crate) struct Faces {
    /// The faces across the three edges of each face, [`NONE`] at a boundary.
    neighbours: Vec<[u32; 3]>,
    /// The normal times the area, by face.
    areas: Vec<Vector3<f32>>,
    /// The unit normal averaged around the face's vertices.
    smooth: Vec<Vector3<f32>>,
}

impl Faces {
    /// The faces of a mesh; vertices in the same place are one.
    pub(crate) fn new(mesh: &Mesh) -> Self {
        let first = weld(&mesh.positions);
        let triangles: Vec<[u32; 3]> = mesh.triangles.par_iter().map(|t| t.map(|i| first[i as usize])).collect();
        let normals = area_weighted_normals(&mesh.positions, &triangles);
        let smooth = |t: &[u32; 3]| {
            let sum: Vector3<f32> = t.iter().map(|&i| Vector3::from(normals[i as usize])).sum();
            sum.try_normalize(0.0).unwrap_or_else(Vector3::z)
        };
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| Vector3::from(mesh.positions[i as usize]));
            0.5 * (b - a).cross(&(c - a))
        };
        Self {
            neighbours: neighbours(&triangles),
            areas: triangles.par_iter().map(area).collect(),
            smooth: triangles.par_iter().map(smooth).collect(),
        }
    }

    /// The area of a face.
    pub(crate) fn area(&self, face: u32) -> f64 {
        f64::from(self.areas[face as usize].norm())
    }

    /// Cuts the surface into charts.
    pub(crate) fn charts(&self) -> Vec<Chart> {
        let count = self.areas.len();
        let mut labels = vec![NONE; count];
        let mut directions = Vec::new();
        self.grow(&mut labels, &mut directions, &[]);
        let least = SMALL * self.areas.iter().map(|a| f64::from(a.norm())).sum::<f64>();
        for _ in 0..ROUNDS {
            let charts = self.gather(&labels, &directions);
            let seeds: Vec<(u32, Vector3<f32>)> = charts.iter().filter_map(|chart| self.seed(chart, least)).collect();
            labels.fill(NONE);
            directions = seeds.iter().map(|seed| seed.1).collect();
            self.grow(&mut labels, &mut directions, &seeds);
        }
        self.absorb(&mut labels, &directions, least);
        self.gather(&labels, &directions)
    }

    /// The connected parts of `faces`, each a chart along the mean of its normals if all its faces look that way, or cut
    /// further until they do.
    pub(crate) fn charts_of(&self, faces: &[u32]) -> Vec<Chart> {
        let mut labels = vec![NONE; self.areas.len()];
        let mut directions = Vec::new();
        // What is not asked for counts as taken.
        let taken = NONE - 1;
        labels.fill(taken);
        faces.iter().for_each(|&f| labels[f as usize] = NONE);
        self.grow(&mut labels, &mut directions, &[]);
        labels.iter_mut().filter(|label| **label == taken).for_each(|label| *label = NONE);
        self.gather(&labels, &directions)
    }

    /// Best-first growth: charts take the neighbour that looks most along their direction; where none fits, the first face
    /// that is left seeds a new chart along its smoothed normal.
    fn grow(&self, labels: &mut [u32], directions: &mut Vec<Vector3<f32>>, seeds: &[(u32, Vector3<f32>)]) {
        let mut queue = BinaryHeap::new();
        let key = |face: u32, d: &Vector3<f32>| ((1.0 - self.smooth[face as usize].dot(d)).max(0.0) * 1e6) as u32;
        for (label, (face, _)) in seeds.iter().enumerate() {
            queue.push(Reverse((0, *face, label as u32)));
        }
        let mut next = 0;
        loop {
            while let Some(Reverse((_, face, label))) = queue.pop() {
                if labels[face as usize] != NONE {
                    continue;
                }
                labels[face as usize] = label;
                let direction = directions[label as usize];
                for &other in &self.neighbours[face as usize] {
                    let free = other != NONE && labels[other as usize] == NONE;
                    if free && self.fits(other, &direction, SMOOTH_LIMIT, FACE_LIMIT) {
                        queue.push(Reverse((key(other, &direction), other, label)));
                    }
                }
            }
            let Some(ahead) = labels[next..].iter().position(|&label| label == NONE) else { break };
            next += ahead;
            let (normal, smooth) = (self.areas[next], self.smooth[next]);
            let own = normal.try_normalize(0.0).unwrap_or(smooth);
            let direction = if own.dot(&smooth) > FACE_LIMIT { smooth } else { own };
            queue.push(Reverse((0, next as u32, directions.len() as u32)));
            directions.push(direction);
        }
    }

    /// Whether a face looks along a direction. Faces without area look wherever they are asked to.
    fn fits(&self, face: u32, direction: &Vector3<f32>, smooth: f32, own: f32) -> bool {
        let normal = &self.areas[face as usize];
        let length = normal.norm();
        length == 0.0 || (normal.dot(direction) > own * length && self.smooth[face as usize].dot(direction) > smooth)
    }

    /// Where a chart shall grow from next, and along which direction; `None` if it is too small to.
    fn seed(&self, chart: &Chart, least: f64) -> Option<(u32, Vector3<f32>)> {
        let area: f64 = chart.faces.iter().map(|&f| self.area(f)).sum();
        if area < least {
            return None;
        }
        let sum: Vector3<f64> = chart.faces.iter().map(|&f| self.areas[f as usize].cast::<f64>()).sum();
        let direction = sum.try_normalize(0.0)?.cast::<f32>();
        let likeness = |&&f: &&u32| self.smooth[f as usize].dot(&direction);
        let face = *chart.faces.iter().max_by(|a, b| likeness(a).total_cmp(&likeness(b)))?;
        self.fits(face, &direction, SMOOTH_LIMIT, FACE_LIMIT).then_some((face, direction))
    }

    /// Gives the faces of small charts to their neighbours, where these can take them.
    fn absorb(&self, labels: &mut [u32], directions: &[Vector3<f32>], least: f64) {
        let mut areas = vec![0.0; directions.len()];
        labels.iter().zip(0..).for_each(|(&label, face)| areas[label as usize] += self.area(face));
        let is_small = |label: u32| areas[label as usize] < least;
        let mut queue: BinaryHeap<Reverse<(u32, u32, u32)>> = BinaryHeap::new();
        let offer = |queue: &mut BinaryHeap<_>, labels: &[u32], face: u32| {
            let label = labels[face as usize];
            let direction = &directions[label as usize];
            for &other in &self.neighbours[face as usize] {
                if other != NONE && is_small(labels[other as usize]) && self.fits(other, direction, -1.0, RELAXED_LIMIT)
                {
                    let key = ((1.0 - self.smooth[other as usize].dot(direction)).max(0.0) * 1e6) as u32;
                    queue.push(Reverse((key, other, label)));
                }
            }
        };
        for face in 0..labels.len() as u32 {
            if !is_small(labels[face as usize]) {
                offer(&mut queue, labels, face);
            }
        }
        while let Some(Reverse((_, face, label))) = queue.pop() {
            if is_small(labels[face as usize]) {
                labels[face as usize] = label;
                offer(&mut queue, labels, face);
            }
        }
    }

    /// Labels as charts, each connected.
    fn gather(&self, labels: &[u32], directions: &[Vector3<f32>]) -> Vec<Chart> {
        let mut seen = vec![false; labels.len()];
        let mut charts = Vec::new();
        let mut stack = Vec::new();
        for start in 0..labels.len() {
            if seen[start] || labels[start] == NONE {
                continue;
            }
            let label = labels[start];
            let mut faces = Vec::new();
            seen[start] = true;
            stack.push(start as u32);
            while let Some(face) = stack.pop() {
                faces.push(face);
                for &other in &self.neighbours[face as usize] {
                    if other != NONE && !seen[other as usize] && labels[other as usize] == label {
                        seen[other as usize] = true;
                        stack.push(other);
                    }
                }
            }
            faces.sort_unstable();
            charts.push(Chart { direction: directions[label as usize], faces });
        }
        charts
    }
}

/// The faces across each face's edges 01, 12 and 20; edges of more than two faces join the first two.
fn neighbours(triangles: &[[u32; 3]]) -> Vec<[u32; 3]> {
    let mut edges: Vec<(u64, u32, u32)> = triangles
        .par_iter()
        .enumerate()
        .flat_map_iter(|(face, t)| {
            (0..3).map(move |k| {
                let (a, b) = (u64::from(t[k]), u64::from(t[(k + 1) % 3]));
                (a.min(b) << 32 | a.max(b), face as u32, k as u32)
            })
        })
        .collect();
    edges.par_sort_unstable();
    let mut neighbours = vec![[NONE; 3]; triangles.len()];
    let mut i = 0;
    while i + 1 < edges.len() {
        let ((edge, a, j), (other, b, k)) = (edges[i], edges[i + 1]);
        if edge != other {
            i += 1;
            continue;
        }
        if a != b {
            (neighbours[a as usize][j as usize], neighbours[b as usize][k as usize]) = (b, a);
        }
        i += 2;
        while i < edges.len() && edges[i].0 == edge {
            i += 1;
        }
    }
    neighbours
}
