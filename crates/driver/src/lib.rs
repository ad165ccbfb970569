//! Registration of photographs to surfaces by mutual information.

mod evaluate;
mod files;
mod layer;
mod overlay;
mod photo;

pub use evaluate::{Motion, Score, TruePhoto, Truth, motion, read_truth, score};
pub use files::{
    CameraEntry, CameraFile, FileError, Lens, LensFile, PairsEntry, base_name, read_cameras, read_lenses, read_pairs,
    write_atomic, write_cameras,
};
pub use layer::{Layer, layer};
pub use overlay::{Panel, overlay};
pub use photo::{Photo, PhotoError};
