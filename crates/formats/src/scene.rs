//! What a camera file holds, whichever program wrote it.

use crate::{CameraFile, FileError};
use nalgebra::Matrix4;
use std::path::PathBuf;

/// A mesh's file, and where the mesh is.
#[derive(Clone, Debug, PartialEq)]
pub struct PlacedMesh {
    /// The file.
    pub file: PathBuf,
    /// What takes its points to the world.
    pub world_from_mesh: Matrix4<f64>,
}

impl PlacedMesh {
    /// A mesh whose points are in the world already.
    pub fn new(file: impl Into<PathBuf>) -> Self {
        Self { file: file.into(), world_from_mesh: Matrix4::identity() }
    }
}

/// The contents of a camera file.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// The photos with their cameras, in texreg's conventions. Names of photos are as the file states them.
    pub cameras: CameraFile,
    /// The meshes the cameras look at, where the file names some or should.
    pub meshes: Vec<PlacedMesh>,
    /// What the file says that the cameras cannot, one line each.
    pub warnings: Vec<String>,
}

impl Scene {
    /// The width and height of each photo, or an error that names the first whose size is not known.
    pub(crate) fn sizes(&self, path: &std::path::Path) -> Result<Vec<[u32; 2]>, FileError> {
        let size = |entry: &crate::CameraEntry| {
            let cause = format!(
                "photo {}: its width and height are not known, and this format wants them; name the folder of the photos",
                entry.file
            );
            entry.lens.size.ok_or_else(|| FileError::new(path, cause))
        };
        self.cameras.photos.iter().map(size).collect()
    }
}
