//! Photos with their cameras, whatever the file they came from.

use crate::Lens;
use serde_json::{Map, Value, json};
use texreg_camera::View;
use texreg_lie::Pose;

/// One photo's entry of a `cameras.json`.
#[derive(Clone, Debug)]
pub struct CameraEntry {
    /// The photo's file name.
    pub file: String,
    /// Its intrinsics and distortion.
    pub lens: Lens,
    /// Its pose, camera from world.
    pub pose: Pose,
    /// Everything else the entry says, such as the verdict of a registration.
    pub other: Map<String, Value>,
}

impl CameraEntry {
    /// An entry that says exactly what `view` does.
    pub fn new(file: impl Into<String>, view: &View) -> Self {
        Self { file: file.into(), lens: Lens::from(&view.camera), pose: view.pose, other: Map::new() }
    }

    /// The entry as JSON: what a `cameras.json` says of the photo.
    pub fn keys(&self) -> Map<String, Value> {
        let mut keys = Map::new();
        keys.insert("file".into(), json!(self.file));
        keys.extend(self.lens.keys());
        let rows: [[f64; 3]; 3] = self.pose.rotation.matrix().transpose().into();
        keys.insert("R".into(), json!(rows));
        keys.insert("T".into(), json!(<[f64; 3]>::from(self.pose.translation)));
        keys.extend(self.other.clone());
        keys
    }

    /// The view this entry states for a photo of the given width and height.
    pub fn view(&self, size: [u32; 2]) -> View {
        View { camera: self.lens.camera(size), pose: self.pose }
    }
}

/// The contents of a `cameras.json`.
#[derive(Clone, Debug, Default)]
pub struct CameraFile {
    /// One entry a photo.
    pub photos: Vec<CameraEntry>,
    /// Everything else at the top of the file.
    pub other: Map<String, Value>,
}

impl CameraFile {
    /// The entry of the photo called `file`; folders in front of an entry's name do not count.
    pub fn entry(&self, file: &str) -> Option<&CameraEntry> {
        self.photos.iter().find(|entry| base_name(&entry.file) == file)
    }
}
/// The last part of a path as text: the name by which photos and entries find each other.
pub fn base_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}
