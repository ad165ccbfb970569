//! The mesh as the rasterizer gets it: borrowed positions and corner indices.

use crate::Meshlets;

/// A triangle mesh, borrowed.
///
/// Triangles are wound counter-clockwise seen from outside. Nothing is assumed of the data: an index without a vertex, a
/// vertex that is not finite and a triangle without area only make their triangle invisible.
#[derive(Clone, Copy, Debug)]
pub struct Triangles<'a> {
    /// Vertex positions in the mesh frame, model units. A mesh at survey coordinates keeps its detail by an origin of its
    /// own, which belongs into the translation of `camera_from_mesh`.
    pub positions: &'a [[f32; 3]],
    /// The three corners of each triangle, as indices into `positions`.
    pub indices: &'a [[u32; 3]],
    /// What was made of this very mesh for many renderings; without it, each rendering makes its own.
    pub meshlets: Option<&'a Meshlets>,
}

impl<'a> Triangles<'a> {
    /// A mesh to be rendered once.
    pub fn new(positions: &'a [[f32; 3]], indices: &'a [[u32; 3]]) -> Self {
        Self { positions, indices, meshlets: None }
    }

    /// The corner positions of triangle `face`, or `None` where the face or one of its vertices does not exist.
    pub fn corners(&self, face: u32) -> Option<[[f32; 3]; 3]> {
        let [a, b, c] = *self.indices.get(face as usize)?;
        let at = |i: u32| self.positions.get(i as usize).copied();
        Some([at(a)?, at(b)?, at(c)?])
    }
}
