//! The formats by name: which file is of which, and what each can carry.

use crate::file::{read_text, write_atomic, write_together};
use crate::{CameraFile, FileError, Lens, LensFile, Scene};
use crate::{blender, bundler, colmap, gltf, json, metashape, mlp, nerfstudio, opencv};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use texreg_camera::{Camera, Distortion};

/// A format of camera files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// texreg's `cameras.json`.
    Texreg,
    /// MeshLab's project.
    MeshLab,
    /// COLMAP's sparse model as text: a folder.
    Colmap,
    /// COLMAP's sparse model in binary: a folder.
    ColmapBinary,
    /// Bundler's `.out`, with the list of photos beside it.
    Bundler,
    /// Agisoft Metashape's XML.
    Metashape,
    /// `transforms.json` of nerfstudio and instant-ngp.
    Nerfstudio,
    /// One camera without a place, as OpenCV's `FileStorage` writes it: YAML, or JSON by the file's name.
    OpenCv,
    /// Cameras in a binary glTF; only written.
    Gltf,
    /// A Python script that builds the cameras in Blender; only written.
    Blender,
}

impl Format {
    /// Every format.
    pub const ALL: &[Self] = &[
        Self::Texreg,
        Self::MeshLab,
        Self::Colmap,
        Self::ColmapBinary,
        Self::Bundler,
        Self::Metashape,
        Self::Nerfstudio,
        Self::OpenCv,
        Self::Gltf,
        Self::Blender,
    ];

    /// The format of a file by its name; `None` where the name tells none.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_lowercase();
        match name.rsplit_once('.').map(|(_, extension)| extension) {
            Some("json") if name.starts_with("transforms") => Some(Self::Nerfstudio),
            Some("json") => Some(Self::Texreg),
            Some("mlp") => Some(Self::MeshLab),
            Some("xml") => Some(Self::Metashape),
            Some("out") => Some(Self::Bundler),
            Some("yml" | "yaml") => Some(Self::OpenCv),
            Some("glb") => Some(Self::Gltf),
            Some("py") => Some(Self::Blender),
            Some("txt") if ["cameras.txt", "images.txt"].contains(&name.as_str()) => Some(Self::Colmap),
            Some("bin") if ["cameras.bin", "images.bin"].contains(&name.as_str()) => Some(Self::ColmapBinary),
            _ if path.join("cameras.txt").exists() => Some(Self::Colmap),
            _ if path.join("cameras.bin").exists() => Some(Self::ColmapBinary),
            _ => None,
        }
    }

    /// Reads a file of this format.
    ///
    /// # Errors
    /// If the file cannot be read or understood, in one line that names it, the place in it and the cause; if this format is only
    /// written, or states no poses.
    pub fn read(self, path: &Path) -> Result<Scene, FileError> {
        match self {
            Self::Texreg => Ok(Scene { cameras: json::read_cameras(path)?, ..Scene::default() }),
            Self::MeshLab => mlp::read(path, &read_text(path)?),
            Self::Colmap | Self::ColmapBinary => colmap::read(path),
            Self::Bundler => bundler::read(path, &read_text(path)?),
            Self::Metashape => metashape::read(path, &read_text(path)?),
            Self::Nerfstudio => nerfstudio::read(path),
            Self::OpenCv => {
                Err(FileError::new(path, "a calibration of OpenCV's has no poses; it can be a --camera alone"))
            }
            Self::Gltf | Self::Blender => {
                Err(FileError::new(path, format!("cameras are only written as {self}, not read")))
            }
        }
    }

    /// The files of a scene in this format: where each goes and its bytes. `base` is what is at `path` now, kept where the format
    /// can take more.
    ///
    /// # Errors
    /// If a photo's size is not known and the format wants it, or the format has no poses.
    pub fn files(self, path: &Path, scene: &Scene) -> Result<Vec<(PathBuf, Vec<u8>)>, FileError> {
        let one = |text: String| vec![(path.to_owned(), text.into_bytes())];
        Ok(match self {
            Self::Texreg => one(json::cameras_text(&scene.cameras)),
            Self::MeshLab => one(mlp::write(path, scene)?),
            Self::Colmap | Self::ColmapBinary => colmap::write(path, scene, self == Self::Colmap)?,
            Self::Bundler => {
                let (text, list) = bundler::write(path, scene)?;
                vec![(bundler::list_path(path), list.into_bytes()), (path.to_owned(), text.into_bytes())]
            }
            Self::Metashape => one(metashape::write(path, scene)?),
            Self::Nerfstudio => one(nerfstudio::write(path, scene)?),
            Self::OpenCv => {
                return Err(FileError::new(path, "a calibration of OpenCV's holds one lens and no poses"));
            }
            Self::Gltf => {
                let base = path.exists().then(|| crate::file::read(path)).transpose()?;
                vec![(path.to_owned(), gltf::write(path, scene, base.as_deref())?)]
            }
            Self::Blender => one(blender::write(path, scene)?),
        })
    }

    /// Writes a scene in this format, all its files or none.
    ///
    /// # Errors
    /// Those of [`files`](Self::files), and if a file cannot be written.
    pub fn write(self, path: &Path, scene: &Scene) -> Result<(), FileError> {
        write_together(&self.files(path, scene)?)
    }

    /// The camera nearest to `camera` that this format can carry: the same where it can carry it whole.
    pub fn carried(self, camera: &Camera) -> Camera {
        let mut carried = *camera;
        let whole = matches!(self, Self::Texreg | Self::Metashape);
        if !whole {
            carried.intrinsics.skew = 0.0;
        }
        let [_, _, p1, p2, k3] = camera.distortion.to_array();
        let distortion = match self {
            Self::MeshLab | Self::Gltf | Self::Blender => false,
            Self::Bundler => p1 == 0.0 && p2 == 0.0 && k3 == 0.0,
            _ => true,
        };
        if !distortion {
            carried.distortion = Distortion::default();
        }
        if matches!(self, Self::Bundler | Self::Gltf) {
            let middle = Camera::ideal(camera.width, camera.height, 1.0).intrinsics;
            (carried.intrinsics.cx, carried.intrinsics.cy) = (middle.cx, middle.cy);
        }
        if matches!(self, Self::Bundler | Self::Blender) {
            carried.intrinsics.fy = carried.intrinsics.fx;
        }
        carried
    }
}

/// Reads cameras in the format that the file's name tells, texreg's where it tells none. What a file says that cameras cannot is
/// passed over; [`Format::read`] tells it.
///
/// # Errors
/// Those of [`Format::read`].
pub fn read_cameras(path: &Path) -> Result<CameraFile, FileError> {
    Format::of(path).unwrap_or(Format::Texreg).read(path).map(|scene| scene.cameras)
}

/// Reads intrinsics and distortion: a `camera.json`, a calibration of OpenCV's (YAML or JSON), or the lenses of any file of cameras.
///
/// # Errors
/// If the file cannot be read or understood, in one line that names it, the place in it and the cause.
pub fn read_lenses(path: &Path) -> Result<LensFile, FileError> {
    match Format::of(path) {
        None | Some(Format::Texreg) => json::read_lenses(path),
        Some(Format::OpenCv) => opencv::read_yaml(path).map(LensFile::Shared),
        Some(format) => {
            let photos = format.read(path)?.cameras.photos;
            Ok(LensFile::PerPhoto(photos.into_iter().map(|entry| (entry.file, entry.lens)).collect()))
        }
    }
}

/// Writes one lens: as a calibration of OpenCV's, or as a `camera.json`.
///
/// # Errors
/// If the file cannot be written, or OpenCV's format is asked for and the photos' size is not known.
pub fn write_lens(path: &Path, lens: &Lens, format: Format) -> Result<(), FileError> {
    let text = match (format, lens.size) {
        (Format::OpenCv, None) => return Err(FileError::new(path, "the photos' width and height are not known")),
        (Format::OpenCv, Some(size)) if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json")) => {
            opencv::json(&lens.camera(size))
        }
        (Format::OpenCv, Some(size)) => opencv::yaml(&lens.camera(size)),
        _ => json::camera_text(lens),
    };
    write_atomic(path, text.as_bytes())
}

/// What of a camera another lacks, by name.
pub fn lost(camera: &Camera, carried: &Camera) -> Vec<&'static str> {
    let (a, b) = (&camera.intrinsics, &carried.intrinsics);
    let principal = (a.cx, a.cy) != (b.cx, b.cy);
    [
        (camera.distortion != carried.distortion, "distortion"),
        (principal, "principal point"),
        (a.skew != b.skew, "skew"),
        (a.fx / a.fy != b.fx / b.fy, "ratio of focal lengths"),
    ]
    .into_iter()
    .filter_map(|(lost, name)| lost.then_some(name))
    .collect()
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Texreg => "texreg",
            Self::MeshLab => "meshlab",
            Self::Colmap => "colmap",
            Self::ColmapBinary => "colmap-binary",
            Self::Bundler => "bundler",
            Self::Metashape => "metashape",
            Self::Nerfstudio => "nerfstudio",
            Self::OpenCv => "opencv",
            Self::Gltf => "gltf",
            Self::Blender => "blender",
        })
    }
}

impl FromStr for Format {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|format| format.to_string() == text);
        found.copied().ok_or_else(|| format!("'{text}' is no format of cameras"))
    }
}
