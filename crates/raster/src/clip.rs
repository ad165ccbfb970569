//! The slow path of a triangle: cut by the near plane and the camera's bounds, split where the lens bends its edges.
//!
//! Clipping is I. E. Sutherland and G. W. Hodgman's (*Reentrant polygon clipping*, CACM 1974). Every new vertex depends on
//! the edge it lies on alone, taken from its inner to its outer end, so triangles that share an edge stay sealed.

use crate::corner::{Corner, SUBPIXELS};
use crate::projector::{Lens, Projector};
use nalgebra::Vector3;

/// More halvings than any edge in the guard band needs.
const DEEPEST: u32 = 20;

/// A vertex in the camera frame, with its projection once known.
#[derive(Clone, Copy)]
pub(crate) struct Vertex {
    pub(crate) point: Vector3<f64>,
    pub(crate) corner: Option<Corner>,
}

/// The pixels that are drawn: first and last column, first and last row.
pub(crate) struct Window {
    pub(crate) x: [i32; 2],
    pub(crate) y: [i32; 2],
}

impl Window {
    /// Whether a triangle whose edges are bent by the lens may reach into the window.
    fn may_show(&self, [a, b, c]: [Corner; 3], lens: &Lens) -> bool {
        let range = |a: i32, b: i32, c: i32| [f64::from(a.min(b).min(c)), f64::from(a.max(b).max(c))];
        let (x, y) = (range(a.x, b.x, c.x), range(a.y, b.y, c.y));
        let margin = lens.bend((x[1] - x[0]).max(y[1] - y[0]));
        let reaches = |[low, high]: [f64; 2], [first, last]: [i32; 2]| {
            high + margin >= f64::from(first) * SUBPIXELS && low - margin <= f64::from(last) * SUBPIXELS
        };
        reaches(x, self.x) && reaches(y, self.y)
    }
}

/// Hands the part of a triangle that is visible in a window to `emit`, as triangles that are drawn with straight edges.
pub(crate) fn clip(projector: &Projector, triangle: [Vertex; 3], window: &Window, emit: &mut impl FnMut([Corner; 3])) {
    if triangle.iter().any(|v| !v.point.iter().all(|x| x.is_finite())) {
        return;
    }
    let lens = projector.lens;
    let mut polygon = triangle.to_vec();
    if triangle.iter().any(|v| v.corner.is_none()) {
        let mut cut = Vec::with_capacity(8);
        let near = (Vector3::z(), projector.near);
        for (normal, offset) in std::iter::once(near).chain(lens.planes.iter().map(|&plane| (plane, 0.0))) {
            cut_by(&polygon, |p| normal.dot(p) - offset, &mut cut);
            std::mem::swap(&mut polygon, &mut cut);
        }
    }
    for vertex in &mut polygon {
        vertex.corner = vertex.corner.or_else(|| lens.corner(&vertex.point));
    }
    for pair in polygon.get(1..).unwrap_or_default().windows(2) {
        split(lens, [polygon[0], pair[0], pair[1]], window, DEEPEST, emit);
    }
}

/// The part of a convex polygon where `side` is not negative.
fn cut_by(polygon: &[Vertex], side: impl Fn(&Vector3<f64>) -> f64, inside: &mut Vec<Vertex>) {
    inside.clear();
    for (k, &to) in polygon.iter().enumerate() {
        let from = polygon[(k + polygon.len() - 1) % polygon.len()];
        let (s, t) = (side(&from.point), side(&to.point));
        if (s >= 0.0) != (t >= 0.0) {
            let ((inner, i), (outer, o)) = if s >= 0.0 { ((from, s), (to, t)) } else { ((to, t), (from, s)) };
            let point = inner.point + (outer.point - inner.point) * (i / (i - o));
            inside.push(Vertex { point, corner: None });
        }
        if t >= 0.0 {
            inside.push(to);
        }
    }
}

/// Halves the edges that are longer than the lens allows, and so on; an edge's fate depends on its two ends alone.
fn split(lens: &Lens, triangle: [Vertex; 3], window: &Window, depth: u32, emit: &mut impl FnMut([Corner; 3])) {
    let [Some(a), Some(b), Some(c)] = triangle.map(|v| v.corner) else {
        return;
    };
    let longest = lens.longest_edge;
    let long = |p: Corner, q: Corner| p.x.abs_diff(q.x).max(p.y.abs_diff(q.y)) > longest as u32;
    if !window.may_show([a, b, c], lens) {
        return;
    }
    let [ab, bc, ca] = [long(a, b), long(b, c), long(c, a)].map(|l| l && depth > 0);
    let middle = |p: usize, q: usize| {
        let point = (triangle[p].point + triangle[q].point) * 0.5;
        Vertex { point, corner: lens.corner(&point) }
    };
    let [p, q, r] = triangle;
    let mut next = |parts: &[[Vertex; 3]]| {
        for &part in parts {
            split(lens, part, window, depth - 1, emit);
        }
    };
    match (ab, bc, ca) {
        (false, false, false) => emit([a, b, c]),
        (true, true, true) => {
            let (m, n, o) = (middle(0, 1), middle(1, 2), middle(2, 0));
            next(&[[p, m, o], [m, q, n], [o, n, r], [m, n, o]]);
        }
        (true, false, false) => next(&halves(p, q, r, middle(0, 1))),
        (false, true, false) => next(&halves(q, r, p, middle(1, 2))),
        (false, false, true) => next(&halves(r, p, q, middle(2, 0))),
        (true, true, false) => next(&thirds(p, q, r, middle(0, 1), middle(1, 2))),
        (false, true, true) => next(&thirds(q, r, p, middle(1, 2), middle(2, 0))),
        (true, false, true) => next(&thirds(r, p, q, middle(2, 0), middle(0, 1))),
    }
}

/// Triangle abc with ab split at m.
fn halves(a: Vertex, b: Vertex, c: Vertex, m: Vertex) -> [[Vertex; 3]; 2] {
    [[a, m, c], [m, b, c]]
}

/// Triangle abc with ab split at m and bc at n.
fn thirds(a: Vertex, b: Vertex, c: Vertex, m: Vertex, n: Vertex) -> [[Vertex; 3]; 3] {
    [[m, b, n], [a, m, n], [a, n, c]]
}
