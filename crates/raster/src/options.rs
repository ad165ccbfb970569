//! What to render and how.

/// Options of a rendering. `Default` keeps both sides of the surface and leaves barycentrics to be asked for later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Leave out triangles seen from behind (corners clockwise in the picture). Closed surfaces look the same without them
    /// and cost less.
    pub cull_back_faces: bool,
    /// Fill [`GBuffer::barycentric`](crate::GBuffer::barycentric). Depth and face are always rendered;
    /// [`Raycaster`](crate::Raycaster) gives the barycentrics of single pixels.
    pub barycentric: bool,
    /// Surface nearer than this camera z, in model units, is cut away. Must be positive; anything else counts as the default.
    pub near: f64,
    /// Spread large renderings over the current rayon pool. Small ones stay on the calling thread in any case.
    pub parallel: bool,
}

impl Options {
    /// The default near plane: so near that only what touches the camera's centre is cut.
    pub const NEAR: f64 = 1e-6;
}

impl Default for Options {
    fn default() -> Self {
        Self { cull_back_faces: false, barycentric: false, near: Self::NEAR, parallel: true }
    }
}
