//! Mean curvature by the cotangent Laplacian (M. Meyer, M. Desbrun, P. Schröder and A. Barr, *Discrete
//! differential-geometry operators for triangulated 2-manifolds*, 2003).
use nalgebra::Vector3;

use crate::mesh::Mesh;
use crate::weld::weld;

/// What a vertex gathers from the triangles around it.
#[derive(Clone, Copy)]
struct Ring {
    /// Σ (cot α + cot β)(x_i − x_j) over the neighbours j.
    laplacian: Vector3<f64>,
    /// A_mixed: the part of the triangles' area that is the vertex's.
    area: f64,
    /// Zero if the triangles close around the vertex: each adds the name of its next corner and takes away that of
    /// the one before.
    open: u64,
}

impl Mesh {
    /// The mean curvature at each vertex, in 1 / model units: positive where the surface bulges along its normals, 1/R
    /// on a sphere of radius R.
    ///
    /// With K = 1/(2 A_mixed) Σ (cot α + cot β)(x_i − x_j) it is H = K·n / 2. Vertices at one position count as one. On a
    /// border, where K has no meaning, it is the mean of the neighbours inside, and zero where there is none.
    /// Triangles without area count for nothing. Of a cloud it comes from the normals of the nearest points. It is computed at the first call, from the vertices as they are then, and
    /// kept.
    pub fn mean_curvature(&self) -> &[f32] {
        self.mean_curvature.get_or_init(|| self.curvature())
    }

    fn curvature(&self) -> Vec<f32> {
        if self.is_cloud {
            return crate::cloud::mean_curvature(&self.points, |i| Vector3::from(self.normals[4 * i].map(f64::from)));
        }
        let first = weld(&self.positions);
        let empty = Ring { laplacian: Vector3::zeros(), area: 0.0, open: 0 };
        let mut rings = vec![empty; self.positions.len()];
        for triangle in &self.triangles {
            gather(&mut rings, triangle.map(|i| first[i as usize]), &self.positions);
        }
        let inside = |ring: &Ring| ring.open == 0 && ring.area > 0.0;
        let mut curvature: Vec<f64> = Vec::with_capacity(rings.len());
        for (ring, normal) in rings.iter().zip(&self.normals) {
            let normal = Vector3::from(normal.map(f64::from));
            let mean = ring.laplacian.dot(&normal) / (4.0 * ring.area);
            curvature.push(if inside(ring) && mean.is_finite() { mean } else { 0.0 });
        }
        let mut sums = vec![(0.0, 0.0); rings.len()];
        for triangle in &self.triangles {
            let corners = triangle.map(|i| first[i as usize] as usize);
            for &j in corners.iter().filter(|&&j| inside(&rings[j])) {
                for &i in corners.iter().filter(|&&i| !inside(&rings[i])) {
                    sums[i] = (sums[i].0 + curvature[j], sums[i].1 + 1.0);
                }
            }
        }
        for (value, (sum, count)) in curvature.iter_mut().zip(sums) {
            if count > 0.0 {
                *value = sum / count;
            }
        }
        first.iter().map(|&i| curvature[i as usize] as f32).collect()
    }
}

/// Adds a triangle to the rings of its corners.
fn gather(rings: &mut [Ring], triangle: [u32; 3], positions: &[[f32; 3]]) {
    let x = triangle.map(|i| Vector3::from(positions[i as usize].map(f64::from)));
    let twice_area = (x[1] - x[0]).cross(&(x[2] - x[0])).norm();
    if twice_area <= 0.0 {
        return;
    }
    // The angle at corner k lies opposite the edge between the other two.
    let dot: [f64; 3] = std::array::from_fn(|k| (x[(k + 1) % 3] - x[k]).dot(&(x[(k + 2) % 3] - x[k])));
    let cot = dot.map(|dot| dot / twice_area);
    let obtuse = dot.iter().position(|&dot| dot < 0.0);
    for k in 0..3 {
        let (next, before) = ((k + 1) % 3, (k + 2) % 3);
        let (to_next, to_before) = (x[k] - x[next], x[k] - x[before]);
        let ring = &mut rings[triangle[k] as usize];
        ring.laplacian += cot[before] * to_next + cot[next] * to_before;
        ring.area += match obtuse {
            None => (cot[before] * to_next.norm_squared() + cot[next] * to_before.norm_squared()) / 8.0,
            Some(corner) if corner == k => twice_area / 4.0,
            Some(_) => twice_area / 8.0,
        };
        let name = |i: u32| (u64::from(i) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29);
        ring.open = ring.open.wrapping_add(name(triangle[next])).wrapping_sub(name(triangle[before]));
    }
}
