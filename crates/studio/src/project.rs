//! The project: all photos and what is known of them, on disk at every moment.
//!
//! What is shown is what is saved: a change is first written to `correspondences.json` and `cameras.json`, each all at once, and
//! counts only then. Entries of photos that are not part of the session stay in the files as they are.

use std::fs::{self, File, TryLockError};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use texreg_driver::Status;
use texreg_formats::{
    CameraEntry, CameraFile, LensFile, PairsEntry, base_name, read_cameras, read_lenses, read_pairs, write_cameras,
    write_pairs,
};

use crate::Error;
use crate::entry::{Entry, Optics};
use crate::moment::{Half, Moment, Pair, Placed, Source, Verdict, word};

/// Where a project's photos and files are.
#[derive(Clone, Debug, Default)]
pub struct Sources {
    /// The photos.
    pub photos: Vec<PathBuf>,
    /// The folder the project lives in: it goes on with the `correspondences.json` and `cameras.json` it finds there.
    pub folder: PathBuf,
    /// Pairs to begin with, where the folder has none.
    pub pairs: Option<PathBuf>,
    /// Cameras to begin with, where the folder has none.
    pub init: Option<PathBuf>,
    /// Lenses.
    pub camera: Option<PathBuf>,
}

/// The photos and what is known of them.
#[derive(Debug)]
pub(crate) struct Project {
    pub(crate) entries: Vec<Entry>,
    folder: PathBuf,
    /// What the files say of other photos.
    other_pairs: Vec<PairsEntry>,
    other_cameras: CameraFile,
    /// Held for as long as the project is open.
    _lock: File,
}

impl Project {
    /// Opens the folder's project, or begins one.
    pub(crate) fn open(sources: &Sources) -> Result<Self, Error> {
        let folder = sources.folder.clone();
        let lock = lock(&folder)?;
        let found = |name: &str, given: &Option<PathBuf>| {
            let own = folder.join(name);
            if own.exists() { Some(own) } else { given.clone() }
        };
        let mut pairs = match found("correspondences.json", &sources.pairs) {
            Some(path) => read_pairs(&path)?,
            None => Vec::new(),
        };
        let mut cameras = match found("cameras.json", &sources.init) {
            Some(path) => read_cameras(&path)?,
            None => CameraFile::default(),
        };
        let lenses = sources.camera.as_deref().map(read_lenses).transpose()?;
        let mut entries: Vec<Entry> = Vec::new();
        for path in &sources.photos {
            let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if entries.iter().any(|entry| entry.file == file) {
                return Err(Error::SameName(path.clone()));
            }
            File::open(path).map_err(|source| Error::Photo { path: path.clone(), source })?;
            let own = pairs.iter().position(|entry| base_name(&entry.file) == file).map(|i| pairs.remove(i));
            let camera = cameras.photos.iter().position(|entry| base_name(&entry.file) == file);
            let camera = camera.map(|i| cameras.photos.remove(i));
            entries.push(entry(path, file, own, camera.as_ref(), lenses.as_ref()));
        }
        Ok(Self { entries, folder, other_pairs: pairs, other_cameras: cameras, _lock: lock })
    }

    /// Changes one photo: `change` is written, or nothing has happened.
    pub(crate) fn change<T>(
        &mut self,
        photo: usize,
        change: impl FnOnce(&mut Entry) -> Result<T, String>,
    ) -> Result<T, String> {
        let old = self.entries.get(photo).ok_or("there is no such photo")?;
        let mut new = old.clone();
        let result = change(&mut new)?;
        let before = std::mem::replace(&mut self.entries[photo], new);
        let after = &self.entries[photo].now;
        let pairs = (&before.now.pairs, before.now.pending) != (&after.pairs, after.pending);
        let cameras = before.now.camera != after.camera;
        if let Err(error) = self.save(pairs, cameras) {
            self.entries[photo] = before;
            return Err(format!("nothing was changed, for it could not be saved: {error}"));
        }
        Ok(result)
    }

    fn save(&self, pairs: bool, cameras: bool) -> Result<(), Error> {
        if pairs {
            let own = self.entries.iter().filter(|e| !e.now.pairs.is_empty() || e.now.pending.is_some());
            let all: Vec<PairsEntry> = own.map(pairs_entry).chain(self.other_pairs.iter().cloned()).collect();
            write_pairs(&self.folder.join("correspondences.json"), &all)?;
        }
        if cameras {
            let own = self.entries.iter().filter_map(camera_entry);
            let photos = own.chain(self.other_cameras.photos.iter().cloned()).collect();
            let file = CameraFile { photos, other: self.other_cameras.other.clone() };
            write_cameras(&self.folder.join("cameras.json"), &file)?;
        }
        Ok(())
    }
}

/// Makes the folder and keeps other studios out of it.
fn lock(folder: &Path) -> Result<File, Error> {
    let failed = |source| Error::Folder { folder: folder.to_owned(), source };
    fs::create_dir_all(folder).map_err(failed)?;
    let lock = File::create(folder.join(".texreg-studio.lock")).map_err(failed)?;
    match lock.try_lock() {
        Ok(()) => Ok(lock),
        Err(TryLockError::WouldBlock) => Err(Error::Taken(folder.to_owned())),
        Err(TryLockError::Error(source)) => Err(failed(source)),
    }
}

/// What the files say of a photo.
fn entry(
    path: &Path,
    file: String,
    pairs: Option<PairsEntry>,
    camera: Option<&CameraEntry>,
    lenses: Option<&LensFile>,
) -> Entry {
    let lens = lenses.and_then(|lenses| lenses.lens(&file));
    let sized = |size: Option<[u32; 2]>| size.or_else(|| image::image_dimensions(path).ok().map(|(w, h)| [w, h]));
    let optics = lens.and_then(|lens| Some(Optics::File(lens.camera(sized(lens.size)?))));
    let placed = camera.and_then(|entry| {
        let view = entry.view(sized(entry.lens.size)?);
        let word_of = |key: &str| entry.other.get(key).and_then(Value::as_str);
        let source = Source::ALL.into_iter().find(|source| word_of("source") == Some(source.name()));
        let accepted = entry.other.get("accepted").and_then(Value::as_bool).unwrap_or(false);
        Some(Placed { view, source: source.unwrap_or(Source::File), verdict: verdict(&entry.other), accepted })
    });
    // A lens that a file of cameras brings is known, unless the pairs or a registration found it.
    let brought = placed.as_ref().filter(|placed| placed.source == Source::File);
    let optics = optics.or(brought.map(|placed| Optics::File(placed.view.camera))).unwrap_or(Optics::Unread);
    let mut now = Moment { camera: placed, ..Moment::default() };
    if let Some(entry) = pairs {
        let pairs = entry.points.into_iter().zip(entry.names).zip(0..);
        now.pairs = pairs.map(|((ends, name), id)| Pair { id, name, ends }).collect();
        now.pending = entry.other.get("pending").and_then(pending);
    }
    Entry::new(path.to_owned(), file, optics, now)
}

fn pairs_entry(entry: &Entry) -> PairsEntry {
    let mut other = Map::new();
    match entry.now.pending {
        Some(Half::Photo(pixel)) => _ = other.insert("pending".into(), json!({"uv": <[f64; 2]>::from(pixel)})),
        Some(Half::Model(point)) => _ = other.insert("pending".into(), json!({"xyz": <[f64; 3]>::from(point)})),
        None => {}
    }
    PairsEntry {
        file: entry.file.clone(),
        points: entry.now.correspondences(),
        names: entry.now.pairs.iter().map(|pair| pair.name.clone()).collect(),
        other,
    }
}

fn pending(value: &Value) -> Option<Half> {
    let numbers = |key: &str| value.get(key).and_then(|v| serde_json::from_value::<Vec<f64>>(v.clone()).ok());
    match (numbers("uv").as_deref(), numbers("xyz").as_deref()) {
        (Some(&[u, v]), _) => Some(Half::Photo([u, v].into())),
        (_, Some(&[x, y, z])) => Some(Half::Model([x, y, z].into())),
        _ => None,
    }
}

fn camera_entry(entry: &Entry) -> Option<CameraEntry> {
    let placed = entry.now.camera.as_ref()?;
    let mut out = CameraEntry::new(&entry.file, &placed.view);
    out.other.insert("source".into(), json!(placed.source.name()));
    out.other.insert("accepted".into(), json!(placed.accepted));
    if let Some(Verdict { status, reasons, similarity: (start, end), uncertainty }) = &placed.verdict {
        out.other.insert("status".into(), json!(word(*status)));
        out.other.insert("reasons".into(), json!(reasons));
        out.other.insert("similarity".into(), json!({"start": start, "end": end}));
        out.other.insert("uncertainty".into(), uncertainty.clone());
    }
    Some(out)
}

fn verdict(keys: &Map<String, Value>) -> Option<Verdict> {
    let status = keys.get("status")?.as_str()?;
    let known = [Status::Registered, Status::Uncertain, Status::Failed];
    let status = known.into_iter().find(|known| word(*known) == status)?;
    let reasons = keys.get("reasons").and_then(|v| serde_json::from_value(v.clone()).ok()).unwrap_or_default();
    let similarity = |end: &str| keys.get("similarity").and_then(|v| v.get(end)?.as_f64()).unwrap_or(0.0);
    let uncertainty = keys.get("uncertainty").cloned().unwrap_or_default();
    Some(Verdict { status, reasons, similarity: (similarity("start"), similarity("end")), uncertainty })
}
