//! Vertices that share a place: the seams of charts and objects, and soups whose triangles share nothing.
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::OnceLock;

use crate::mesh::Mesh;
use crate::normals::area_weighted_normals;

/// For each vertex the first vertex at exactly the same position.
pub fn weld(positions: &[[f32; 3]]) -> Vec<u32> {
    let mut first: HashMap<(u64, u64), u32, BuildHasherDefault<KeyHasher>> = HashMap::default();
    first.reserve(positions.len());
    // Adding zero makes one of the two zeros.
    let bits = |x: f32| u64::from((x + 0.0).to_bits());
    let keys = positions.iter().map(|&[x, y, z]| (bits(x) << 32 | bits(y), bits(z)));
    keys.zip(0..).map(|(key, i)| *first.entry(key).or_insert(i)).collect()
}

impl Mesh {
    /// Computes the normals again from the triangles, weighted by area, over all vertices that share a position: smooth
    /// across seams and in soups of triangles.
    pub fn weld_normals(&mut self) {
        (self.ambient_occlusion, self.mean_curvature) = (OnceLock::new(), OnceLock::new());
        self.normals = welded_normals(&self.positions, &self.triangles);
    }
}

/// Area-weighted normals over all vertices that share a position.
pub(crate) fn welded_normals(positions: &[[f32; 3]], triangles: &[[u32; 3]]) -> Vec<[f32; 3]> {
    let first = weld(positions);
    let triangles: Vec<[u32; 3]> = triangles.iter().map(|t| t.map(|i| first[i as usize])).collect();
    let normals = area_weighted_normals(positions, &triangles);
    first.iter().map(|&i| normals[i as usize]).collect()
}

/// A hash for keys that are numbers already: a multiplication each (Fibonacci hashing).
#[derive(Default)]
pub(crate) struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|&b| self.write_u64(u64::from(b)));
    }

    fn write_u64(&mut self, key: u64) {
        let product = (self.0 ^ key).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = product ^ product >> 32;
    }
}
