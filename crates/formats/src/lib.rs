//! Camera files: texreg's own JSON, and those of MeshLab, COLMAP, Bundler, Metashape, nerfstudio, OpenCV, glTF and Blender.
//!
//! Inside there is one convention (x right, y down, z forward; world to camera; the top-left pixel's centre at (0, 0)); every other
//! is converted at this door. A [`Format`] reads a file into a [`Scene`] and writes one, and tells with
//! [`carried`](Format::carried) what of a camera it can say.

mod blender;
mod bundler;
mod cameras;
mod colmap;
mod file;
mod format;
mod gltf;
mod json;
mod lens;
mod metashape;
mod mlp;
mod nerfstudio;
mod opencv;
mod place;
mod rotation;
mod scene;
mod xml;

pub use cameras::{CameraEntry, CameraFile, base_name};
pub use file::{FileError, write_atomic, write_together};
pub use format::{Format, lost, read_cameras, read_lenses, write_lens};
pub use json::{PairsEntry, read_pairs, write_cameras, write_pairs};
pub use lens::{Lens, LensFile};
pub use scene::{PlacedMesh, Scene};

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
