//! Registration of photographs to surfaces by mutual information.

mod evaluate;
mod files;
mod photo;

pub use evaluate::{Score, TruePhoto, Truth, read_truth, score};
pub use files::{
    CameraEntry, CameraFile, FileError, Lens, LensFile, PairsEntry, base_name, read_cameras, read_lenses, read_pairs,
    write_atomic, write_cameras,
};
pub use photo::{Photo, PhotoError};
