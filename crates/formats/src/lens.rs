//! A lens as a file states it: what is left out follows from the photo.

use crate::base_name;
use serde_json::{Map, Value, json};
use texreg_camera::{Camera, Distortion, Intrinsics};

/// Intrinsics and distortion as a file states them: what is left out takes its value from the size of the photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Lens {
    /// Width and height in pixels, where the file says.
    pub size: Option<[u32; 2]>,
    /// Focal lengths in pixels; a missing `fy` equals `fx`.
    pub focal: [f64; 2],
    /// Principal point in pixels, by coordinate; a missing one is the middle of the photo.
    pub principal: [Option<f64>; 2],
    /// Skew in pixels.
    pub skew: f64,
    /// Lens distortion, none where the file has none.
    pub distortion: Distortion,
}

impl Lens {
    /// The lens as JSON: what a `camera.json` says.
    pub fn keys(&self) -> Map<String, Value> {
        let mut keys = Map::new();
        if let Some([width, height]) = self.size {
            keys.insert("width".into(), json!(width));
            keys.insert("height".into(), json!(height));
        }
        let mut k = json!({"fx": self.focal[0], "fy": self.focal[1]});
        for (key, value) in ["cx", "cy"].into_iter().zip(self.principal) {
            if let Some(value) = value {
                k[key] = json!(value);
            }
        }
        k["skew"] = json!(self.skew);
        keys.insert("K".into(), k);
        keys.insert("distortion".into(), json!(self.distortion.to_array()));
        keys
    }

    /// The camera this lens makes for photos of `width` × `height` pixels.
    pub fn camera(&self, [width, height]: [u32; 2]) -> Camera {
        let middle = |n: u32| (f64::from(n) - 1.0) / 2.0;
        Camera {
            width,
            height,
            intrinsics: Intrinsics {
                fx: self.focal[0],
                fy: self.focal[1],
                cx: self.principal[0].unwrap_or_else(|| middle(width)),
                cy: self.principal[1].unwrap_or_else(|| middle(height)),
                skew: self.skew,
            },
            distortion: self.distortion,
        }
    }
}

impl From<&Camera> for Lens {
    fn from(camera: &Camera) -> Self {
        let k = &camera.intrinsics;
        Self {
            size: Some([camera.width, camera.height]),
            focal: [k.fx, k.fy],
            principal: [Some(k.cx), Some(k.cy)],
            skew: k.skew,
            distortion: camera.distortion,
        }
    }
}
/// Lenses from a `camera.json`, or from a `cameras.json` whose entries name the photos.
#[derive(Clone, Debug)]
pub enum LensFile {
    /// One camera for all photos.
    Shared(Lens),
    /// A lens for each photo, by file name.
    PerPhoto(Vec<(String, Lens)>),
}

impl LensFile {
    /// The lens of the photo called `file`.
    pub fn lens(&self, file: &str) -> Option<&Lens> {
        match self {
            Self::Shared(lens) => Some(lens),
            Self::PerPhoto(lenses) => lenses.iter().find(|(name, _)| base_name(name) == file).map(|(_, lens)| lens),
        }
    }
}
