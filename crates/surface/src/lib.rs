//! Scanned surfaces: loading, validation and the per-vertex signals a photograph can be compared with.
//!
//! [`load`] reads meshes (PLY, OBJ, STL, OFF, glTF, MeshLab projects) and point clouds (PLY, LAS, LAZ, E57) into a [`Mesh`]:
//! triangles, or a small square for each point of a cloud, over vertices that carry a unit normal and, where the scanner
//! gave them, a reflectance and a colour. What comes out is safe to compute with: every coordinate is finite,
//! every index is in range, every normal has length one. What cannot be made so is an [`Error`] of one line that
//! names the file, the place in it and the cause.
mod cloud;
mod curvature;
mod e57;
mod error;
mod gltf;
mod las;
mod load;
mod mesh;
mod mlp;
mod normals;
mod obj;
mod occlusion;
mod off;
mod part;
mod ply;
mod quietly;
mod signal;
mod simplify;
mod stl;
mod weld;

pub use cloud::Scanner;
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
