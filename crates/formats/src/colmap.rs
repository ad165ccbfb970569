//! COLMAP's sparse models, a folder of `cameras` and `images` as text or binary: its documentation, *Output Format*, and
//! `src/colmap/scene/reconstruction_io.cc`.
//!
//! Poses are world to camera as a quaternion (w, x, y, z) and a translation; the top-left pixel's centre is (0.5, 0.5). No model of
//! COLMAP has skew. A lens without distortion is written as PINHOLE, one without k3 as OPENCV, others as FULL_OPENCV.

mod binary;
mod text;

use crate::rotation::{from_quaternion, to_quaternion};
use crate::{CameraEntry, FileError, Lens, Scene};
use nalgebra::Vector3;
use serde_json::Map;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use texreg_camera::Distortion;
use texreg_lie::Pose;

/// COLMAP's camera models that a lens of ours can say: number, name, and how many parameters they have.
const MODELS: [(i32, &str, usize); 6] = [
    (0, "SIMPLE_PINHOLE", 3),
    (1, "PINHOLE", 4),
    (2, "SIMPLE_RADIAL", 4),
    (3, "RADIAL", 5),
    (4, "OPENCV", 8),
    (6, "FULL_OPENCV", 12),
];

/// One camera as COLMAP has it.
#[derive(Clone, Debug, PartialEq)]
struct Camera {
    model: i32,
    size: [u64; 2],
    parameters: Vec<f64>,
}

/// One image as COLMAP has it.
#[derive(Clone, Debug, PartialEq)]
struct Image {
    rotation: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    name: String,
}

/// Reads the model in a folder, or the one that a file of it belongs to.
pub(crate) fn read(path: &Path) -> Result<Scene, FileError> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let (cameras_path, images_path) = (folder.join("cameras.txt"), folder.join("images.txt"));
    let as_text = cameras_path.exists() && path.extension().is_none_or(|extension| extension != "bin");
    let (images_path, cameras, images) = if as_text {
        let cameras = text::read_cameras(&cameras_path)?;
        let images = text::read_images(&images_path)?;
        (images_path, cameras, images)
    } else {
        let images_path = folder.join("images.bin");
        let cameras = binary::read_cameras(&folder.join("cameras.bin"))?;
        let images = binary::read_images(&images_path)?;
        (images_path, cameras, images)
    };
    let mut scene = Scene::default();
    for (place, image) in images {
        let fail = |field: &str, cause: &str| {
            let place = format!("{} {place}", if as_text { "line" } else { "byte" });
            FileError::new(&images_path, format!("{place}: image {}, field {field}: {cause}", image.name))
        };
        let camera = cameras.get(&image.camera);
        let camera = camera.ok_or_else(|| fail("CAMERA_ID", &format!("there is no camera {}", image.camera)))?;
        let rotation = from_quaternion(image.rotation).map_err(|cause| fail("QW QX QY QZ", cause))?;
        let pose = Pose::new(rotation, Vector3::from(image.translation));
        scene.cameras.photos.push(CameraEntry { lens: camera.lens(), pose, other: Map::new(), file: image.name });
    }
    Ok(scene)
}

/// The files of a model: their names in the folder and their bytes.
pub(crate) fn write(folder: &Path, scene: &Scene, as_text: bool) -> Result<Vec<(PathBuf, Vec<u8>)>, FileError> {
    let mut cameras: Vec<Camera> = Vec::new();
    let mut images = Vec::new();
    for (entry, size) in scene.cameras.photos.iter().zip(scene.sizes(folder)?) {
        let camera = Camera::of(&entry.lens, size);
        let known = cameras.iter().position(|other| *other == camera);
        let index = known.unwrap_or_else(|| {
            cameras.push(camera);
            cameras.len() - 1
        });
        images.push(Image {
            rotation: to_quaternion(&entry.pose.rotation),
            translation: entry.pose.translation.into(),
            camera: index as u32 + 1,
            name: entry.file.clone(),
        });
    }
    Ok(if as_text {
        let points = "# 3D point list with one line of data per point: none\n";
        vec![
            (folder.join("cameras.txt"), text::cameras(&cameras).into_bytes()),
            (folder.join("images.txt"), text::images(&images).into_bytes()),
            (folder.join("points3D.txt"), points.as_bytes().to_vec()),
        ]
    } else {
        vec![
            (folder.join("cameras.bin"), binary::cameras(&cameras)),
            (folder.join("images.bin"), binary::images(&images)),
            (folder.join("points3D.bin"), 0u64.to_le_bytes().to_vec()),
        ]
    })
}

impl Camera {
    /// Checks a camera that was read; `cameras` finds it by its number.
    fn checked(model: Option<i32>, size: [u64; 2], parameters: Vec<f64>) -> Result<Self, String> {
        let known = || MODELS.map(|(_, name, _)| name).join(", ");
        let found = MODELS.iter().find(|(number, ..)| Some(*number) == model);
        let &(model, name, count) =
            found.ok_or_else(|| format!("field MODEL: a camera of this kind is not supported; {} are", known()))?;
        if parameters.len() != count {
            return Err(format!("field PARAMS: {name} has {count} parameters, not {}", parameters.len()));
        }
        if parameters.iter().any(|p| !p.is_finite())
            || parameters[0] <= 0.0
            || (count % 2 == 0 && count > 5 && parameters[1] <= 0.0)
        {
            return Err("field PARAMS: focal lengths must be positive, and all parameters finite".into());
        }
        if model == 6 && parameters[9..].iter().any(|k| *k != 0.0) {
            return Err("field PARAMS: a lens with k4, k5 or k6 is not supported".into());
        }
        let side = |n: u64| (1..=u64::from(u32::MAX)).contains(&n);
        if !side(size[0]) || !side(size[1]) {
            return Err("fields WIDTH, HEIGHT: must be positive".into());
        }
        Ok(Self { model, size, parameters })
    }

    fn lens(&self) -> Lens {
        let p = &self.parameters;
        let (focal, c, d) = match self.model {
            0 => ([p[0]; 2], &p[1..3], [0.0; 5]),
            2 => ([p[0]; 2], &p[1..3], [p[3], 0.0, 0.0, 0.0, 0.0]),
            3 => ([p[0]; 2], &p[1..3], [p[3], p[4], 0.0, 0.0, 0.0]),
            4 => ([p[0], p[1]], &p[2..4], [p[4], p[5], p[6], p[7], 0.0]),
            6 => ([p[0], p[1]], &p[2..4], [p[4], p[5], p[6], p[7], p[8]]),
            _ => ([p[0], p[1]], &p[2..4], [0.0; 5]),
        };
        Lens {
            size: Some(self.size.map(|n| n as u32)),
            focal,
            principal: [Some(c[0] - 0.5), Some(c[1] - 0.5)],
            skew: 0.0,
            distortion: Distortion::from(d),
        }
    }

    fn of(lens: &Lens, size: [u32; 2]) -> Self {
        let k = lens.camera(size).intrinsics;
        let mut parameters = vec![k.fx, k.fy, k.cx + 0.5, k.cy + 0.5];
        let d = lens.distortion.to_array();
        let model = if d == [0.0; 5] {
            1
        } else if d[4] == 0.0 {
            parameters.extend(&d[..4]);
            4
        } else {
            parameters.extend(d);
            parameters.extend([0.0; 3]);
            6
        };
        Self { model, size: size.map(u64::from), parameters }
    }
}

/// Cameras by their numbers.
type Cameras = BTreeMap<u32, Camera>;
