//! Shapes whose areas, normals and curvatures are known.
#![allow(dead_code, reason = "each test file uses some of the shapes")]
use std::collections::HashMap;

use texreg_surface::{Attributes, Mesh};

/// A mesh without attributes of its own.
pub(crate) fn mesh(points: &[[f64; 3]], triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh::new(points, triangles, Attributes::default()).expect("a valid mesh")
}

/// A graph z = f(x, y) over the square |x|, |y| ≤ `half`, `n` squares along each side, seen from above.
pub(crate) fn graph(n: usize, half: f64, f: impl Fn(f64, f64) -> f64) -> Mesh {
    let side = |i: usize| half * (2.0 * i as f64 / n as f64 - 1.0);
    let points: Vec<[f64; 3]> =
        (0..=n).flat_map(|i| (0..=n).map(move |j| (side(j), side(i)))).map(|(x, y)| [x, y, f(x, y)]).collect();
    let number = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    let square = |i, j| {
        let [a, b, c, d] = [number(i, j), number(i, j + 1), number(i + 1, j), number(i + 1, j + 1)];
        [[a, b, d], [a, d, c]]
    };
    mesh(&points, (0..n).flat_map(|i| (0..n).flat_map(move |j| square(i, j))).collect())
}

/// The unit icosahedron with each triangle cut into four `levels` times, blown up to a sphere.
pub(crate) fn sphere(levels: usize, radius: f64, centre: [f64; 3]) -> Mesh {
    let g = 0.5 * (1.0 + 5f64.sqrt());
    let mut points: Vec<[f64; 3]> = Vec::new();
    for s in [-1.0, 1.0] {
        for t in [-g, g] {
            points.extend([[0.0, s, t], [s, t, 0.0], [t, 0.0, s]]);
        }
    }
    let distance2 = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>();
    let mut triangles = Vec::new();
    for a in 0..12 {
        for b in a + 1..12 {
            for c in b + 1..12 {
                let [p, q, r] = [points[a], points[b], points[c]];
                if [distance2(p, q), distance2(q, r), distance2(r, p)].iter().all(|d| (d - 4.0).abs() < 1e-9) {
                    let det = p[0] * (q[1] * r[2] - q[2] * r[1])
                        + p[1] * (q[2] * r[0] - q[0] * r[2])
                        + p[2] * (q[0] * r[1] - q[1] * r[0]);
                    triangles.push(if det > 0.0 { [a, b, c] } else { [a, c, b] }.map(|i| i as u32));
                }
            }
        }
    }
    for _ in 0..levels {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let (p, q) = (points[a as usize], points[b as usize]);
                let sum: [f64; 3] = std::array::from_fn(|k| p[k] + q[k]);
                let length = (distance2(sum, [0.0; 3]) / distance2(p, [0.0; 3])).sqrt();
                points.push(sum.map(|x| x / length));
                points.len() as u32 - 1
            })
        };
        let split = |[a, b, c]: [u32; 3]| {
            let [d, e, f] = [middle(a, b), middle(b, c), middle(c, a)];
            [[a, d, f], [d, b, e], [f, e, c], [d, e, f]]
        };
        triangles = triangles.into_iter().flat_map(split).collect();
    }
    let length = distance2(points[0], [0.0; 3]).sqrt();
    let place = |p: &[f64; 3]| std::array::from_fn(|k| centre[k] + radius * p[k] / length);
    mesh(&points.iter().map(place).collect::<Vec<_>>(), triangles)
}

/// The mesh with its triangles sharing no vertices.
pub(crate) fn soup(shared: &Mesh) -> Mesh {
    let points: Vec<[f64; 3]> =
        shared.triangles.iter().flatten().map(|&i| shared.point(i as usize).coords.into()).collect();
    let triangles = (0..shared.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    mesh(&points, triangles)
}
