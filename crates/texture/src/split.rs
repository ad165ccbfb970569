//! A mesh whose vertices carry texture coordinates, as files want it: a vertex for each place on the surface and in the texture.

use crate::Texture;
use rayon::prelude::*;
use texreg_surface::Mesh;

/// Vertices as pairs of a mesh's vertex and its texture coordinates, and the triangles over them.
pub(crate) struct Split {
    /// The mesh's vertex.
    pub(crate) vertices: Vec<u32>,
    /// One pair a vertex.
    pub(crate) uvs: Vec<[f32; 2]>,
    /// Indices into `vertices`; the triangles of the mesh, in its order.
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Split {
    pub(crate) fn new(mesh: &Mesh, texture: &Texture) -> Self {
        let uvs = texture.uvs.as_flattened();
        // Corners by vertex, then by texture coordinates: equal ones come together.
        let corner = |i: usize| {
            let [u, v] = uvs[i].map(f32::to_bits);
            (mesh.triangles[i / 3][i % 3], u, v)
        };
        let mut order: Vec<u32> = (0..3 * mesh.triangles.len() as u32).collect();
        order.par_sort_unstable_by_key(|&i| (corner(i as usize), i));
        let (mut vertices, mut places, mut last) = (Vec::new(), Vec::new(), None);
        let mut triangles = vec![[0; 3]; mesh.triangles.len()];
        for i in order {
            let here = corner(i as usize);
            if last != Some(here) {
                vertices.push(here.0);
                places.push(uvs[i as usize]);
                last = Some(here);
            }
            triangles[i as usize / 3][i as usize % 3] = vertices.len() as u32 - 1;
        }
        Self { vertices, uvs: places, triangles }
    }
}
