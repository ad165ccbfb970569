//! Vertex normals: the area-weighted mean of the normals of the triangles around a vertex.
use rayon::prelude::*;

use crate::mesh::Bounds;

/// What stands for the normal of a vertex that no triangle of non-zero area touches.
const ANY: [f32; 3] = [0.0, 0.0, 1.0];

/// Unit normals, one a vertex: the sum of the cross products of the triangles around it, whose lengths are twice the
/// triangles' areas, normalized. Vertices without a triangle of non-zero area get (0, 0, 1).
///
/// Triangles must be in range; their winding is taken as it is, so where neighbours disagree the normals cancel.
pub fn area_weighted_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let scale = unit_scale(positions);
    let mut sums = vec![[0.0f32; 3]; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| positions[i as usize]);
        let u: [f32; 3] = std::array::from_fn(|k| (b[k] - a[k]) * scale);
        let v: [f32; 3] = std::array::from_fn(|k| (c[k] - a[k]) * scale);
        let n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        for &i in triangle {
            let sum = &mut sums[i as usize];
            for k in 0..3 {
                sum[k] += n[k];
            }
        }
    }
    sums.par_iter_mut().for_each(|n| *n = unit(*n).unwrap_or(ANY));
    sums
}

/// Given normals made unit; where there are none, or they have no direction, the area-weighted ones.
pub(crate) fn complete_normals(
    given: Option<Vec<[f32; 3]>>,
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Vec<[f32; 3]> {
    let Some(mut normals) = given else {
        return area_weighted_normals(positions, triangles);
    };
    let normalize = |n: &mut [f32; 3]| {
        let length2 = n[0] * n[0] + n[1] * n[1] + n[2] * n[2];
        // What is a unit vector up to rounding stays as it was written.
        if (length2 - 1.0).abs() < 1e-6 {
            return true;
        }
        let direction = unit(*n);
        *n = direction.unwrap_or([0.0; 3]);
        direction.is_some()
    };
    let complete = normals.par_iter_mut().map(normalize).reduce(|| true, |a, b| a & b);
    if !complete {
        let computed = area_weighted_normals(positions, triangles);
        for (normal, computed) in normals.iter_mut().zip(computed) {
            if *normal == [0.0; 3] {
                *normal = computed;
            }
        }
    }
    normals
}

/// The direction of a vector, if it has one.
fn unit(v: [f32; 3]) -> Option<[f32; 3]> {
    let v = v.map(f64::from);
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    (length.is_finite() && length > 0.0).then(|| v.map(|x| (x / length) as f32))
}

/// A power of two that brings the model to about unit size, so that areas neither overflow nor vanish.
fn unit_scale(positions: &[[f32; 3]]) -> f32 {
    let bounds = Bounds::over(positions);
    let extent = (0..3).map(|k| bounds.high[k] - bounds.low[k]).fold(0.0, f64::max);
    let scale = extent.log2().floor().clamp(-100.0, 100.0).exp2().recip();
    scale as f32
}
