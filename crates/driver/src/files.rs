//! The JSON files that cross the door: `cameras.json`, `camera.json` and `correspondences.json`.
//!
//! Shapes and conventions are the README's ("Files"). A file is read key by key, so that a mistake is reported with the
//! file, the photo and the field; keys that are not known are kept in `other`. Writing is atomic: a temporary name in
//! the same folder, then a rename, so that a run that fails leaves an earlier result as it was.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value, json};
use texreg_camera::{Camera, Distortion, Intrinsics, View};
use texreg_lie::{Pose, so3};
use texreg_posit::Correspondence;

/// How far any entry of `R Rᵀ` may be from the identity before `R` is refused as a rotation.
const ROTATION_TOLERANCE: f64 = 1e-3;

/// A file that could not be read, understood or written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", path.display())]
pub struct FileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, in one line that names the photo and the field where there is one.
    pub cause: String,
}

impl FileError {
    fn new(path: &Path, cause: impl Into<String>) -> Self {
        Self { path: path.to_owned(), cause: cause.into() }
    }
}

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
        if let Some([width, height]) = self.lens.size {
            keys.insert("width".into(), json!(width));
            keys.insert("height".into(), json!(height));
        }
        let mut k = json!({"fx": self.lens.focal[0], "fy": self.lens.focal[1]});
        for (key, value) in ["cx", "cy"].into_iter().zip(self.lens.principal) {
            if let Some(value) = value {
                k[key] = json!(value);
            }
        }
        k["skew"] = json!(self.lens.skew);
        keys.insert("K".into(), k);
        keys.insert("distortion".into(), json!(self.lens.distortion.to_array()));
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

/// One photo's entry of a `correspondences.json`: points of the model and where the photo shows them.
#[derive(Clone, Debug, PartialEq)]
pub struct PairsEntry {
    /// The photo's file name.
    pub file: String,
    /// Its correspondences.
    pub points: Vec<Correspondence>,
}

/// The last part of a path as text: the name by which photos and entries find each other.
pub fn base_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// Reads a `cameras.json`.
pub fn read_cameras(path: &Path) -> Result<CameraFile, FileError> {
    let mut top = Fields::open(path)?;
    let photos = top.photos()?;
    let photos = photos.into_iter().map(|mut fields| {
        let lens = fields.lens()?;
        let pose = Pose { rotation: fields.rotation()?, translation: Vector3::from(fields.take::<[f64; 3]>("T")?) };
        Ok(CameraEntry { file: fields.photo.unwrap_or_default(), lens, pose, other: fields.map })
    });
    Ok(CameraFile { photos: photos.collect::<Result<_, _>>()?, other: top.map })
}

/// Reads a `camera.json`, or only the intrinsics and distortion of a `cameras.json`.
pub fn read_lenses(path: &Path) -> Result<LensFile, FileError> {
    let mut top = Fields::open(path)?;
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
    }
    let entries = Fields::open(path)?.photos()?.into_iter().map(|mut fields| {
        let points: Vec<Pair> = fields.take("points")?;
        let points = points.iter().map(|p| Correspondence::new(Point3::from(p.xyz), Point2::from(p.uv))).collect();
        Ok(PairsEntry { file: fields.photo.unwrap_or_default(), points })
    });
    entries.collect()
}

/// Writes a `cameras.json`, one key a line, numbers so that they read back exactly.
pub fn write_cameras(path: &Path, cameras: &CameraFile) -> Result<(), FileError> {
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
    text += "\n ]\n}\n";
    write_atomic(path, text.as_bytes())
}

/// Writes `bytes` to `path` all at once: under a temporary name in the same folder, which then takes the place of `path`.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let write = || -> std::io::Result<()> {
        let mut builder = tempfile::Builder::new();
        builder.prefix(".texreg-");
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        let mut file = builder.tempfile_in(folder)?;
        file.write_all(bytes)?;
        file.persist(path)?;
        Ok(())
    };
    write().map_err(|e| FileError::new(path, format!("cannot be written ({})", describe(&e))))
}

/// A system error in the words of a sentence, without tempfile's path and the error's number.
fn describe(error: &std::io::Error) -> String {
    let text = match error.raw_os_error() {
        Some(code) => std::io::Error::from_raw_os_error(code).to_string(),
        None => error.kind().to_string(),
    };
    text.split(" (os error").next().unwrap_or_default().to_lowercase()
}

/// The keys of one JSON object that have not been read yet, and where that object stands.
struct Fields<'a> {
    path: &'a Path,
    photo: Option<String>,
    map: Map<String, Value>,
}

impl<'a> Fields<'a> {
    fn open(path: &'a Path) -> Result<Self, FileError> {
        let text = fs::read(path)
            .map_err(|e| FileError::new(path, format!("cannot be read ({}); check the path", describe(&e))))?;
        match serde_json::from_slice(&text) {
            Ok(Value::Object(map)) => Ok(Self { path, photo: None, map }),
            Ok(_) => Err(FileError::new(path, "holds no JSON object; the README's section \"Files\" shows its shape")),
            Err(e) => {
                Err(FileError::new(path, format!("is not JSON ({e}); the README's section \"Files\" shows its shape")))
            }
        }
    }

    fn error(&self, field: &str, cause: &str) -> FileError {
        let photo = self.photo.as_ref().map(|photo| format!("photo {photo}, ")).unwrap_or_default();
        FileError::new(self.path, format!("{photo}field {field}: {cause}"))
    }

    /// Takes a key that must be there.
    fn take<T: DeserializeOwned>(&mut self, key: &str) -> Result<T, FileError> {
        self.take_optional(key)?.ok_or_else(|| self.error(key, "is missing"))
    }

    /// Takes a key that may be missing or null.
    fn take_optional<T: DeserializeOwned>(&mut self, key: &str) -> Result<Option<T>, FileError> {
        match self.map.remove(key) {
            None | Some(Value::Null) => Ok(None),
            Some(value) => self.parse(key, value).map(Some),
        }
    }

    fn parse<T: DeserializeOwned>(&self, key: &str, value: Value) -> Result<T, FileError> {
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
            let mut fields = Self { path: self.path, photo: Some(format!("number {}", i + 1)), map };
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
        if (r * r.transpose() - Matrix3::identity()).amax() > ROTATION_TOLERANCE {
            return Err(self.error("R", "is not a rotation: its rows are not perpendicular and of length 1"));
        }
        if r.determinant() < 0.0 {
            return Err(
                self.error("R", "mirrors (determinant -1): the camera's axes must be x right, y down, z forward")
            );
        }
        so3::nearest(&r).ok_or_else(|| self.error("R", "is not a rotation"))
    }
}
