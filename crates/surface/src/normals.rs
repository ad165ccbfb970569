//! Vertex normals: the area-weighted mean of the normals of the triangles around a vertex.
use rayon::prelude::*;

use crate::mesh::Bounds;
use crate::weld::welded_normals;

/// What stands for the normal of a vertex that no triangle of non-zero area touches.
const ANY: [f32; 3] = [0.0, 0.0, 1.0];

/// Unit normals, one a vertex: the sum of the cross products of the triangles around it, whose lengths are twice the
/// triangles' areas, normalized. Vertices without a triangle of non-zero area get (0, 0, 1).
///
/// Each thread sums for a range of vertices of its own, in the order of the triangles: the result does not depend on
/// their number. Triangles must be in range; their winding is taken as it is, so where neighbours disagree the normals cancel.
pub fn area_weighted_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let scale = unit_scale(positions);
    let blocks: Vec<(&[[u32; 3]], Range)> =
        triangles.par_chunks(BLOCK).map(|block| (block, Range::of(block))).collect();
    let mut normals = vec![[0.0f32; 3]; positions.len()];
    let share = positions.len().div_ceil(rayon::current_num_threads()).max(1);
    normals.par_chunks_mut(share).enumerate().for_each(|(i, sums)| {
        let start = (i * share) as u32;
        let range = Range { low: start, high: start + (sums.len() - 1) as u32 };
        for (block, reach) in blocks.iter().filter(|(_, block)| block.meets(range)) {
            let within = range.low <= reach.low && reach.high <= range.high;
            for triangle in *block {
                if !within && triangle.iter().all(|&i| i.wrapping_sub(start) >= sums.len() as u32) {
                    continue;
                }
                let normal = cross(triangle.map(|i| positions[i as usize]), scale);
                for &i in triangle {
                    if let Some(sum) = sums.get_mut(i.wrapping_sub(start) as usize) {
                        *sum = [sum[0] + normal[0], sum[1] + normal[1], sum[2] + normal[2]];
                    }
                }
            }
        }
        sums.iter_mut().for_each(|n| *n = unit(*n).unwrap_or(ANY));
    });
    normals
}

/// How many triangles are passed over at once where none of them touches a thread's vertices.
const BLOCK: usize = 1 << 12;

/// The vertices `low..=high`.
#[derive(Clone, Copy)]
struct Range {
    low: u32,
    high: u32,
}

impl Range {
    /// The range of the vertices of a block of triangles.
    fn of(block: &[[u32; 3]]) -> Range {
        block.iter().fold(Range { low: u32::MAX, high: 0 }, |range, t| Range {
            low: range.low.min(t[0]).min(t[1]).min(t[2]),
            high: range.high.max(t[0]).max(t[1]).max(t[2]),
        })
    }

    fn meets(self, other: Range) -> bool {
        self.low <= other.high && other.low <= self.high
    }
}

/// The cross product of two edges of a scaled triangle: its normal, as long as twice its area.
#[inline]
fn cross([a, b, c]: [[f32; 3]; 3], scale: f32) -> [f32; 3] {
    let u: [f32; 3] = std::array::from_fn(|k| (b[k] - a[k]) * scale);
    let v: [f32; 3] = std::array::from_fn(|k| (c[k] - a[k]) * scale);
    [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
}

/// Given normals made unit; where there are none, or they have no direction, the area-weighted ones.
pub(crate) fn complete_normals(
    given: Option<Vec<[f32; 3]>>,
    positions: &[[f32; 3]],
    triangles: &[[u32; 3]],
) -> Vec<[f32; 3]> {
    // A file with more vertices than triangles is a soup, whose triangles share their corners' places at best.
    let compute = if positions.len() > triangles.len() { welded_normals } else { area_weighted_normals };
    let Some(mut normals) = given else {
        return compute(positions, triangles);
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
        let computed = compute(positions, triangles);
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
    let inverse = 1.0 / length;
    (length > 0.0 && inverse > 0.0).then(|| v.map(|x| (x * inverse) as f32))
}

/// A power of two that brings the model to about unit size, so that areas neither overflow nor vanish.
fn unit_scale(positions: &[[f32; 3]]) -> f32 {
    let bounds = Bounds::over(positions);
    let extent = (0..3).map(|k| bounds.high[k] - bounds.low[k]).fold(0.0, f64::max);
    let scale = extent.log2().floor().clamp(-100.0, 100.0).exp2().recip();
    scale as f32
}
