//! Level of detail by vertex clustering (J. Rossignac and P. Borrel, *Multi-resolution 3D approximations for rendering
//! complex scenes*, 1993), with each cluster's vertex where it fits the tangent planes of its members best
//! (P. Lindstrom, *Out-of-core simplification of large polygonal models*, SIGGRAPH 2000).
use std::collections::HashMap;
use std::hash::BuildHasherDefault;

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use crate::cloud::splats;
use crate::mesh::{Attributes, Bounds, Mesh};
use crate::weld::KeyHasher;

/// The weight of a cluster's mean against its planes: what they leave open, the mean decides.
const MEAN_WEIGHT: f64 = 0.02;

/// About how many triangles the surface's area is estimated from.
const AREA_SAMPLE: usize = 1 << 15;

impl Mesh {
    /// A coarse copy of about as many triangles as asked for (within a third where the surface is smooth at that
    /// scale), for renderings small enough not to show the difference. The mesh itself if it has no more.
    ///
    /// Vertices in the same cube of a grid become one, which carries the means of their normals, reflectances and
    /// colours, and of what was computed of them; parts thinner than a cube collapse.
    pub fn simplified(&self, triangles: usize) -> Mesh {
        if self.triangles.len() <= triangles || triangles == 0 {
            return self.clone();
        }
        // A surface of area A meets about 3/2 A/h² cubes of side h, each a vertex, and has twice as many triangles.
        let mut side = (3.0 * self.rough_area() / triangles as f64).sqrt();
        let mut best: Option<Mesh> = None;
        let miss = |mesh: &Mesh| (mesh.triangles.len().max(1) as f64 / triangles as f64).ln().abs();
        for _ in 0..3 {
            let Some(mesh) = self.clustered(side) else {
                side *= 0.5;
                continue;
            };
            side *= (mesh.triangles.len() as f64 / triangles as f64).sqrt().clamp(0.25, 4.0);
            let good = miss(&mesh) < 0.25;
            if best.as_ref().is_none_or(|best| miss(&mesh) < miss(best)) {
                best = Some(mesh);
            }
            if good {
                break;
            }
        }
        best.unwrap_or_else(|| self.clone())
    }

    /// The area of the surface, estimated from every so many triangles.
    fn rough_area(&self) -> f64 {
        let step = self.triangles.len().div_ceil(AREA_SAMPLE);
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| Vector3::from(self.positions[i as usize].map(f64::from)));
            0.5 * (b - a).cross(&(c - a)).norm()
        };
        self.triangles.iter().step_by(step).map(area).sum::<f64>() * step as f64
    }

    /// The mesh with one vertex for each cube of this side that has any, if a triangle is left.
    fn clustered(&self, side: f64) -> Option<Mesh> {
        let low = Bounds::over(&self.positions).low;
        // A cube's number has 21 bits along each axis.
        let side = side.max(self.diagonal() / f64::from(1 << 20)).max(f64::MIN_POSITIVE);
        let cube = |p: &[f32; 3]| -> [u64; 3] { std::array::from_fn(|k| ((f64::from(p[k]) - low[k]) / side) as u64) };
        let keys: Vec<u64> = self
            .positions
            .par_iter()
            .map(|p| {
                let [x, y, z] = cube(p);
                x << 42 | y << 21 | z
            })
            .collect();
        let mut numbers: HashMap<u64, u32, BuildHasherDefault<KeyHasher>> = HashMap::default();
        let mut clusters: Vec<Cluster> = Vec::new();
        let mut cluster_of = Vec::with_capacity(keys.len());
        // Neighbours in the file are mostly neighbours on the surface.
        let mut last = (u64::MAX, 0);
        for (i, &key) in keys.iter().enumerate() {
            if key != last.0 {
                last = (key, *numbers.entry(key).or_insert(clusters.len() as u32));
                if last.1 as usize == clusters.len() {
                    let corner = cube(&self.positions[i]);
                    clusters.push(Cluster::at(std::array::from_fn(|k| low[k] + (corner[k] as f64 + 0.5) * side)));
                }
            }
            clusters[last.1 as usize].add(self, i);
            cluster_of.push(last.1);
        }
        let mut triangles: Vec<[u32; 3]> = self
            .triangles
            .par_iter()
            .filter_map(|t| {
                let [a, b, c] = t.map(|i| cluster_of[i as usize]);
                let least = a.min(b).min(c);
                // Each triangle starts at its least vertex, so that equal ones are equal.
                let rotated = [[a, b, c], [b, c, a], [c, a, b]].into_iter().find(|t| t[0] == least);
                rotated.filter(|_| a != b && b != c && c != a)
            })
            .collect();
        triangles.par_sort_unstable();
        triangles.dedup();
        if triangles.is_empty() && !self.is_cloud {
            return None;
        }
        let average = |values: &Vec<f32>| average(values, &cluster_of, clusters.len());
        let attributes = Attributes {
            normals: Some(clusters.iter().map(|c| c.normal.map(|x| x as f32).into()).collect()),
            reflectance: self.reflectance.as_ref().map(average),
            colours: self.colours.as_ref().map(|_| clusters.iter().map(Cluster::colour).collect()),
            ambient_occlusion: self.ambient_occlusion.get().map(average),
            mean_curvature: self.mean_curvature.get().map(average),
            uvs: None,
        };
        let positions: Vec<[f32; 3]> = clusters.iter().map(|c| c.position(side)).collect();
        if self.is_cloud {
            return splats(self.origin.into(), &positions, attributes, |_| [0.0; 3]).ok();
        }
        Some(Mesh::assemble(self.origin.into(), positions, triangles, attributes))
    }
}

/// The mean of the vertices' values in each cluster.
fn average(values: &[f32], cluster_of: &[u32], clusters: usize) -> Vec<f32> {
    let mut sums = vec![(0.0f64, 0.0); clusters];
    for (&value, &cluster) in values.iter().zip(cluster_of) {
        let sum = &mut sums[cluster as usize];
        *sum = (sum.0 + f64::from(value), sum.1 + 1.0);
    }
    sums.into_iter().map(|(sum, count)| (sum / count) as f32).collect()
}

/// The sums over the vertices in a cube; positions are relative to its centre.
struct Cluster {
    centre: Vector3<f64>,
    count: f64,
    position: Vector3<f64>,
    normal: Vector3<f64>,
    /// The sum of n nᵀ over the members' tangent planes n·x = d.
    planes: Matrix3<f64>,
    /// The sum of n d.
    offsets: Vector3<f64>,
    colour: Vector3<f64>,
}

impl Cluster {
    fn at(centre: [f64; 3]) -> Cluster {
        let zero = Vector3::zeros();
        Cluster {
            centre: centre.into(),
            count: 0.0,
            position: zero,
            normal: zero,
            planes: Matrix3::zeros(),
            offsets: zero,
            colour: zero,
        }
    }

    fn add(&mut self, mesh: &Mesh, i: usize) {
        let p = Vector3::from(mesh.positions[i].map(f64::from)) - self.centre;
        let n = Vector3::from(mesh.normals[i].map(f64::from));
        self.count += 1.0;
        self.position += p;
        self.normal += n;
        self.planes += n * n.transpose();
        self.offsets += n * n.dot(&p);
        if let Some(values) = &mesh.colours {
            self.colour += Vector3::from(values[i].map(f64::from));
        }
    }

    /// The point that minimizes the squared distances to the planes plus those to the members, within the cube.
    fn position(&self, side: f64) -> [f32; 3] {
        let mean = self.position / self.count;
        let weight = MEAN_WEIGHT * self.count;
        let system = self.planes + Matrix3::identity() * weight;
        let best = system.cholesky().map_or(mean, |c| c.solve(&(self.offsets + mean * weight)));
        let half = 0.5 * side;
        let inside = best.map(|x| if x.is_finite() { x.clamp(-half, half) } else { 0.0 });
        (self.centre + inside).map(|x| x as f32).into()
    }

    fn colour(&self) -> [u8; 3] {
        (self.colour / self.count).map(|x| x.round() as u8).into()
    }
}
