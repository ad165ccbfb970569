//! Scanned surfaces: loading, validation and the per-vertex signals a photograph can be compared with.
//!
//! [`load`] reads PLY, OBJ, STL, OFF and glTF files and MeshLab projects into a [`Mesh`]: triangles over vertices that
//! carry a unit normal and, where the scanner gave them, a reflectance and a colour. What comes out is safe to compute with: every coordinate is finite,
//! every index is in range, every normal has length one. What cannot be made so is an [`Error`] of one line that
//! names the file, the place in it and the cause.
mod curvature;
mod error;
mod gltf;
mod load;
mod mesh;
mod mlp;
mod normals;
mod obj;
mod occlusion;
mod off;
mod part;
mod ply;
mod signal;
mod simplify;
mod stl;
mod weld;

pub use error::{Defect, Error, Place};
pub use load::load;
pub use mesh::{Attributes, Mesh};
pub use normals::area_weighted_normals;
pub use signal::{
    Both, Colours, Components, Depth, Frame, Headlight, NoSuchSignal, Normals, Ranked, Signal, SignalName, Silhouette,
    Specular, Surfel, Viewpoint, joint_signal,
};
pub use weld::weld;

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
