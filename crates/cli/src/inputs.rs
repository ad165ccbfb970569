//! Photos and the files that say something about them: who belongs to whom, and where each photo starts.

use std::collections::HashSet;
use std::fs::File;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use texreg::camera::{Camera, View};
use texreg::driver::{FEWEST_PAIRS, Photo, PhotoError, pose_from_pairs};
use texreg::formats::{CameraFile, Lens, LensFile, PairsEntry, base_name, read_cameras, read_lenses, read_pairs};
use texreg::posit::{Correspondence, Solution};
use texreg::surface::{self, Mesh};

use crate::args;

/// The photos of a run and everything the command line says of them, checked as far as is possible without opening a photo.
pub(crate) struct Inputs {
    /// The photos' paths.
    pub(crate) photos: Vec<PathBuf>,
    start: Start,
    lenses: Option<(PathBuf, LensFile)>,
}

/// Where the photos start.
enum Start {
    Pairs(PathBuf, Vec<PairsEntry>),
    Init(PathBuf, CameraFile),
    Nowhere,
}

impl Inputs {
    /// Reads the files and finds each photo's entries in them. Photos with neither pairs nor cameras start nowhere.
    pub(crate) fn read(args: &args::Inputs, init: Option<&Path>) -> anyhow::Result<Self> {
        let mut names = HashSet::new();
        for path in &args.photos {
            if !names.insert(name(path)) {
                bail!("{}: another photo has the same name; rename it, or run them apart", path.display());
            }
            File::open(path).map_err(|e| anyhow!("{}: {}; check the path of the photo", path.display(), cause(&e)))?;
        }
        let start = match (&args.pairs, init) {
            (_, Some(init)) => Start::Init(init.to_owned(), read_cameras(init)?),
            (Some(pairs), None) => Start::Pairs(pairs.clone(), read_pairs(pairs)?),
            (None, None) => Start::Nowhere,
        };
        let lenses = args.camera.as_ref().map(|path| anyhow::Ok((path.clone(), read_lenses(path)?))).transpose()?;
        let inputs = Self { photos: args.photos.clone(), start, lenses };
        for path in &inputs.photos {
            inputs.check(&name(path))?;
        }
        Ok(inputs)
    }

    /// Checks that the files have what the photo needs.
    fn check(&self, photo: &str) -> anyhow::Result<()> {
        match &self.start {
            Start::Pairs(path, entries) => {
                let entry = entries.iter().find(|entry| base_name(&entry.file) == photo);
                let named = entries.iter().map(|entry| entry.file.as_str());
                let entry = entry.with_context(|| unnamed(path, photo, named))?;
                let count = entry.points.len();
                if count < FEWEST_PAIRS {
                    let s = if count == 1 { "" } else { "s" };
                    bail!(
                        "{}: photo {photo} has {count} pair{s}; add pairs until it has at least {FEWEST_PAIRS}",
                        path.display()
                    );
                }
            }
            Start::Init(path, cameras) => {
                let named = cameras.photos.iter().map(|entry| entry.file.as_str());
                cameras.entry(photo).with_context(|| unnamed(path, photo, named))?;
            }
            Start::Nowhere => {}
        }
        if let Some((path, LensFile::PerPhoto(lenses))) = &self.lenses {
            let named = lenses.iter().map(|(file, _)| file.as_str());
            let known = lenses.iter().any(|(file, _)| base_name(file) == photo);
            known.then_some(()).with_context(|| unnamed(path, photo, named))?;
        }
        Ok(())
    }

    /// What to call a photo in an error: by the file it starts from, if there is one.
    pub(crate) fn context(&self, photo: &Photo) -> String {
        match &self.start {
            Start::Pairs(path, _) | Start::Init(path, _) => format!("{}: photo {}", path.display(), photo.file),
            Start::Nowhere => photo.file.clone(),
        }
    }

    /// The view a photo starts from; `None` where it is to be searched for.
    pub(crate) fn start(&self, photo: &Photo) -> anyhow::Result<Option<View>> {
        match &self.start {
            Start::Nowhere => Ok(None),
            Start::Pairs(..) => Ok(Some(self.pose(photo)?.view)),
            Start::Init(path, cameras) => {
                let named = cameras.photos.iter().map(|entry| entry.file.as_str());
                let entry = cameras.entry(&photo.file).with_context(|| unnamed(path, &photo.file, named))?;
                let camera = match &self.lenses {
                    Some(_) => self.camera(photo)?,
                    None => fitted(&entry.lens, path, photo)?,
                };
                Ok(Some(View { camera, pose: entry.pose }))
            }
        }
    }

    /// The pose of a photo from its pairs.
    pub(crate) fn pose(&self, photo: &Photo) -> anyhow::Result<Solution> {
        let camera = self.camera(photo)?;
        let pairs: &[Correspondence] = match &self.start {
            Start::Pairs(_, entries) => entries
                .iter()
                .find(|entry| base_name(&entry.file) == photo.file)
                .map_or(&[], |entry| entry.points.as_slice()),
            Start::Init(..) | Start::Nowhere => &[],
        };
        pose_from_pairs(pairs, &camera).map_err(|cause| {
            anyhow!("{}: no pose fits the pairs ({cause}); check them, or add more", self.context(photo))
        })
    }

    /// The camera that `--camera` or EXIF gives a photo.
    pub(crate) fn camera(&self, photo: &Photo) -> anyhow::Result<Camera> {
        let Some((path, lenses)) = &self.lenses else {
            let focal = photo.focal().with_context(|| {
                format!("{}: its EXIF has no 35 mm focal length; give the camera with --camera FILE", photo.file)
            })?;
            return Ok(Camera::ideal(photo.width, photo.height, focal));
        };
        let lens = lenses.lens(&photo.file).with_context(|| unnamed(path, &photo.file, std::iter::empty()))?;
        fitted(lens, path, photo)
    }
}

/// The camera of a lens, which must be meant for photos of this size.
pub(crate) fn fitted(lens: &Lens, path: &Path, photo: &Photo) -> anyhow::Result<Camera> {
    match lens.size {
        Some([width, height]) if [width, height] != [photo.width, photo.height] => bail!(
            "{}: its camera is for {width} × {height} pixels, but {} has {} × {}; scale K to the photo, or take the photo \
             it was made for",
            path.display(),
            photo.file,
            photo.width,
            photo.height
        ),
        _ => Ok(lens.camera([photo.width, photo.height])),
    }
}

/// What to say of a file that does not name a photo.
fn unnamed<'a>(path: &Path, photo: &str, named: impl Iterator<Item = &'a str>) -> String {
    let mut named: Vec<&str> = named.collect();
    let more = if named.len() > 4 { ", …" } else { "" };
    named.truncate(4);
    let has = if named.is_empty() { String::new() } else { format!(" (it names {}{more})", named.join(", ")) };
    format!("{}: no entry names the photo {photo}{has}; add one with \"file\": \"{photo}\"", path.display())
}

/// Loads the model.
pub(crate) fn model(path: &Path) -> anyhow::Result<Mesh> {
    use surface::{Defect, Error};
    surface::load(path).map_err(|error| {
        let path = path.display();
        match error {
            Error::Io { source, .. } => anyhow!("{path}: {}; check the path of the model", cause(&source)),
            Error::Syntax { .. }
            | Error::Damaged { .. }
            | Error::Defect { defect: Defect::IndexOutOfRange { .. } | Defect::AttributeLength { .. }, .. } => {
                anyhow!("{error}; the file is damaged: export the model again")
            }
            Error::Format { .. } | Error::Defect { .. } => anyhow!(error),
        }
    })
}

/// Loads a photo.
pub(crate) fn photo(path: &Path) -> anyhow::Result<Photo> {
    Photo::load(path).map_err(|error| match error {
        PhotoError::Io { source, .. } => anyhow!("{}: {}; check the path of the photo", path.display(), cause(&source)),
        _ => anyhow!(error),
    })
}

/// Gives a photo its mask: the image at `path`, or the one in that folder with the photo's name and as PNG.
pub(crate) fn masked(photo: Photo, path: Option<&Path>) -> anyhow::Result<Photo> {
    let Some(path) = path else { return Ok(photo) };
    let path = if path.is_dir() { path.join(&photo.file).with_extension("png") } else { path.to_owned() };
    photo.with_mask(&path).map_err(|error| match error {
        PhotoError::Io { source, .. } => anyhow!("{}: {}; check the path of the mask", path.display(), cause(&source)),
        _ => anyhow!(error),
    })
}

/// The file name of a photo: what entries call it.
pub(crate) fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// A system error in the words of a sentence, without its number.
pub(crate) fn cause(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or_default().to_lowercase()
}
