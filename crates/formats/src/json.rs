//! The JSON files that cross the door: `cameras.json`, `camera.json` and `correspondences.json`.
//!
//! Shapes and conventions are the README's ("Files"). A file is read key by key, so that a mistake is reported with the
//! file, the photo and the field; keys that are not known are kept in `other`.

use crate::file::{FileError, read_text, write_atomic};
use crate::rotation::checked_rotation;
use crate::{CameraEntry, CameraFile, Lens, LensFile, opencv, place};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use std::path::Path;
use std::rc::Rc;
use texreg_camera::Distortion;
use texreg_lie::Pose;
use texreg_posit::Correspondence;

/// One photo's entry of a `correspondences.json`: points of the model and where the photo shows them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PairsEntry {
    /// The photo's file name.
    pub file: String,
    /// Its correspondences.
    pub points: Vec<Correspondence>,
    /// What each is called, as many as `points`; empty where it has no name.
    pub names: Vec<String>,
    /// Everything else the entry says.
    pub other: Map<String, Value>,
}

/// Reads a `cameras.json`.
pub(crate) fn read_cameras(path: &Path) -> Result<CameraFile, FileError> {
    let mut top = Fields::open(path)?;
    let photos = top.photos()?;
    let photos = photos.into_iter().map(|mut fields| {
        let lens = fields.lens()?;
        let pose = Pose { rotation: fields.rotation()?, translation: Vector3::from(fields.take::<[f64; 3]>("T")?) };
        Ok(CameraEntry { file: fields.photo.unwrap_or_default(), lens, pose, other: fields.map })
    });
    Ok(CameraFile { photos: photos.collect::<Result<_, _>>()?, other: top.map })
}

/// Reads a `camera.json`, or only the intrinsics and distortion of a `cameras.json`; or a calibration of OpenCV's in JSON.
pub(crate) fn read_lenses(path: &Path) -> Result<LensFile, FileError> {
    let mut top = Fields::open(path)?;
    if top.map.contains_key("camera_matrix") {
        return opencv::lens(top).map(LensFile::Shared);
    }
    if !top.map.contains_key("photos") {
        return top.lens().map(LensFile::Shared);
    }
    let lenses = top.photos()?.into_iter().map(|mut fields| {
        let lens = fields.lens()?;
        Ok((fields.photo.unwrap_or_default(), lens))
    });
    lenses.collect::<Result<_, _>>().map(LensFile::PerPhoto)
}

/// Reads a `correspondences.json`.
pub fn read_pairs(path: &Path) -> Result<Vec<PairsEntry>, FileError> {
    #[derive(serde::Deserialize)]
    struct Pair {
        xyz: [f64; 3],
        uv: [f64; 2],
        name: Option<String>,
    }
    let entries = Fields::open(path)?.photos()?.into_iter().map(|mut fields| {
        let points: Vec<Pair> = fields.take("points")?;
        let pair = |p: Pair| (Correspondence::new(Point3::from(p.xyz), Point2::from(p.uv)), p.name.unwrap_or_default());
        let (points, names) = points.into_iter().map(pair).unzip();
        Ok(PairsEntry { file: fields.photo.unwrap_or_default(), points, names, other: fields.map })
    });
    entries.collect()
}

/// Writes a `correspondences.json`, one pair a line, numbers so that they read back exactly.
pub fn write_pairs(path: &Path, entries: &[PairsEntry]) -> Result<(), FileError> {
    let photo = |entry: &PairsEntry| {
        let pair = |(i, pair): (usize, &Correspondence)| {
            let mut keys = json!({"xyz": <[f64; 3]>::from(pair.point), "uv": <[f64; 2]>::from(pair.pixel)});
            if let Some(name) = entry.names.get(i).filter(|name| !name.is_empty()) {
                keys["name"] = json!(name);
            }
            format!("\n    {keys}")
        };
        let points: Vec<String> = entry.points.iter().enumerate().map(pair).collect();
        let other: String = entry.other.iter().map(|(key, value)| format!("\n   {}: {value},", json!(key))).collect();
        format!("\n  {{\n   \"file\": {},{other}\n   \"points\": [{}]\n  }}", json!(entry.file), points.join(","))
    };
    let photos: Vec<String> = entries.iter().map(photo).collect();
    write_atomic(path, format!("{{\n \"photos\": [{}\n ]\n}}\n", photos.join(",")).as_bytes())
}

/// The text of a `camera.json`.
pub(crate) fn camera_text(lens: &Lens) -> String {
    format!("{:#}\n", Value::Object(lens.keys()))
}

/// Writes a `cameras.json`, one key a line, numbers so that they read back exactly.
pub fn write_cameras(path: &Path, cameras: &CameraFile) -> Result<(), FileError> {
    write_atomic(path, cameras_text(cameras).as_bytes())
}

/// The text of a `cameras.json`.
pub(crate) fn cameras_text(cameras: &CameraFile) -> String {
    let mut text = String::from("{\n");
    for (key, value) in &cameras.other {
        text += &format!(" {}: {value},\n", json!(key));
    }
    text += " \"photos\": [";
    for (i, entry) in cameras.photos.iter().enumerate() {
        let keys = entry.keys();
        let lines: Vec<String> = keys.iter().map(|(key, value)| format!("\n   {}: {value}", json!(key))).collect();
        text += &format!("{}\n  {{{}\n  }}", if i == 0 { "" } else { "," }, lines.join(","));
    }
    text + "\n ]\n}\n"
}

/// The keys of one JSON object that have not been read yet, and where that object stands.
pub(crate) struct Fields<'a> {
    path: &'a Path,
    /// The whole file, and the names and indices that lead to this object in it.
    text: Rc<str>,
    steps: Vec<String>,
    pub(crate) photo: Option<String>,
    pub(crate) map: Map<String, Value>,
}

impl<'a> Fields<'a> {
    pub(crate) fn open(path: &'a Path) -> Result<Self, FileError> {
        let text = read_text(path)?;
        match serde_json::from_str(&text) {
            Ok(Value::Object(map)) => Ok(Self::top(path, text, map)),
            Ok(_) => Err(FileError::new(path, "holds no JSON object; the README's section \"Files\" shows its shape")),
            Err(e) => {
                Err(FileError::new(path, format!("is not JSON ({e}); the README's section \"Files\" shows its shape")))
            }
        }
    }

    /// The keys at the top of a file of this text.
    pub(crate) fn top(path: &'a Path, text: String, map: Map<String, Value>) -> Self {
        Self { path, text: text.into(), steps: Vec::new(), photo: None, map }
    }

    /// Those of the object at an index of the list of a key, whose number is the photo's name until it is read.
    pub(crate) fn item(&self, key: &str, index: usize, map: Map<String, Value>) -> Self {
        let steps = [&self.steps[..], &[key.to_owned(), index.to_string()]].concat();
        Self { path: self.path, text: self.text.clone(), steps, photo: Some(format!("number {}", index + 1)), map }
    }

    /// An error at a field of this object, named as in `K.fx` or `points[3].uv`.
    pub(crate) fn error(&self, field: &str, cause: &str) -> FileError {
        let photo = self.photo.as_ref().map(|photo| format!("photo {photo}, ")).unwrap_or_default();
        let first = field.split(',').next().unwrap_or_default();
        let inner = first.split(['.', '[', ']']).filter(|step| !step.is_empty()).map(str::to_owned);
        let steps: Vec<String> = self.steps.iter().cloned().chain(inner).collect();
        FileError::at(self.path, place::line(&self.text, &steps), format!("{photo}field {field}: {cause}"))
    }

    /// Takes a key that must be there.
    pub(crate) fn take<T: DeserializeOwned>(&mut self, key: &str) -> Result<T, FileError> {
        self.take_optional(key)?.ok_or_else(|| self.error(key, "is missing"))
    }

    /// Takes a key that may be missing or null.
    pub(crate) fn take_optional<T: DeserializeOwned>(&mut self, key: &str) -> Result<Option<T>, FileError> {
        match self.map.remove(key) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => self.parse(key, value).map(Some),
        }
    }

    pub(crate) fn parse<T: DeserializeOwned>(&self, key: &str, value: Value) -> Result<T, FileError> {
        serde_path_to_error::deserialize(value).map_err(|e| {
            let inner = e.path().to_string();
            let dot = if inner.starts_with('[') { "" } else { "." };
            let field = if inner == "." { key.to_owned() } else { format!("{key}{dot}{inner}") };
            self.error(&field, &e.inner().to_string())
        })
    }

    /// Takes the list of photos, each with its file name already read.
    fn photos(&mut self) -> Result<Vec<Self>, FileError> {
        let list: Vec<Map<String, Value>> = self.take("photos")?;
        let photos = list.into_iter().enumerate().map(|(i, map)| {
            let mut fields = self.item("photos", i, map);
            fields.photo = Some(fields.take("file")?);
            Ok(fields)
        });
        photos.collect()
    }

    fn lens(&mut self) -> Result<Lens, FileError> {
        #[derive(serde::Deserialize)]
        struct Keys {
            fx: f64,
            fy: Option<f64>,
            cx: Option<f64>,
            cy: Option<f64>,
            skew: Option<f64>,
        }
        let size = match (self.take_optional("width")?, self.take_optional("height")?) {
            (Some(w), Some(h)) if w > 0 && h > 0 => Some([w, h]),
            (None, None) => None,
            _ => return Err(self.error("width, height", "must both be positive")),
        };
        let k: Value = self.take("K")?;
        let k = if k.is_array() {
            let m: [[f64; 3]; 3] = self.parse("K", k)?;
            Keys { fx: m[0][0], fy: Some(m[1][1]), cx: Some(m[0][2]), cy: Some(m[1][2]), skew: Some(m[0][1]) }
        } else {
            self.parse("K", k)?
        };
        let focal = [k.fx, k.fy.unwrap_or(k.fx)];
        if focal.iter().any(|f| *f <= 0.0) {
            return Err(self.error("K", "focal lengths must be positive"));
        }
        let given: Vec<f64> = self.take_optional("distortion")?.unwrap_or_default();
        if given.len() > 5 {
            return Err(self.error("distortion", "has more than the five coefficients k1, k2, p1, p2, k3"));
        }
        let mut coefficients = [0.0; 5];
        coefficients[..given.len()].copy_from_slice(&given);
        Ok(Lens {
            size,
            focal,
            principal: [k.cx, k.cy],
            skew: k.skew.unwrap_or(0.0),
            distortion: Distortion::from(coefficients),
        })
    }

    /// Takes `R` and replaces it by the nearest rotation, if it is close to one at all.
    fn rotation(&mut self) -> Result<Rotation3<f64>, FileError> {
        let rows: [[f64; 3]; 3] = self.take("R")?;
        let r = Matrix3::from_fn(|i, j| rows[i][j]);
        checked_rotation(&r)
            .map_err(|cause| self.error("R", &format!("{cause}; texreg's have x right, y down, z forward")))
    }
}
