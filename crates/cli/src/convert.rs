//! `texreg convert`: cameras to and from other programs.
//!
//! A photo whose camera the format cannot carry is handed over as the camera the format can carry would have taken it.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use image::ImageFormat;
use serde_json::json;
use texreg::driver::Photo;
use texreg::formats::{CameraEntry, Format, Lens, LensFile, base_name, lost, read_lenses, write_lens};

use crate::Ending;
use crate::args::Convert;
use crate::output::{Output, print};

/// The folder, beside the output, of photos that were taken to another camera.
const RECTIFIED: &str = "undistorted";

pub(crate) fn run(args: &Convert, json: bool) -> anyhow::Result<Ending> {
    let from = args.from.or_else(|| Format::of(&args.input)).with_context(|| unknown(&args.input, "--from"))?;
    let to = args.to.or_else(|| Format::of(&args.output)).with_context(|| unknown(&args.output, "--to"))?;
    let mut warnings = Vec::new();
    let mut written = vec![args.output.clone()];
    if from == Format::OpenCv || to == Format::OpenCv {
        write_lens(&args.output, &only_lens(&args.input)?, to)?;
    } else {
        let mut scene = from.read(&args.input)?;
        warnings.append(&mut scene.warnings);
        let folder = if is_folder(to) { args.output.as_path() } else { parent(&args.output) };
        let output = Output::open(folder)?;
        let model = args.model.clone().or(scene.model.take());
        scene.model = model.map(|model| relative(&model, folder));
        let photos = args.photos.as_deref().unwrap_or_else(|| parent(&args.input));
        let mut pictures = Vec::new();
        for entry in &mut scene.cameras.photos {
            fit(entry, to, photos, &output, &mut pictures, &mut warnings)?;
        }
        for (name, bytes) in pictures {
            output.write(&name, &bytes)?;
            written.push(output.path(&name));
        }
        to.write(&args.output, &scene)?;
    }
    for warning in &warnings {
        eprintln!("warning: {}: {warning}", args.input.display());
    }
    let shown = |path: &PathBuf| path.strip_prefix(".").unwrap_or(path).display().to_string();
    let written: Vec<String> = written.iter().map(shown).collect();
    if json {
        print(&format!("{:#}", json!({"files": written, "warnings": warnings})))?;
    } else {
        print(&written.join("\n"))?;
    }
    Ok(Ending::Good)
}

/// Makes an entry one that the format can carry, and names the photo as the format names photos.
fn fit(
    entry: &mut CameraEntry,
    to: Format,
    photos: &Path,
    output: &Output,
    pictures: &mut Vec<(String, Vec<u8>)>,
    warnings: &mut Vec<String>,
) -> anyhow::Result<()> {
    let found = [photos.join(&entry.file), photos.join(base_name(&entry.file))].into_iter().find(|path| path.is_file());
    let name = base_name(&entry.file).to_owned();
    let mut photo = None;
    if let (None, Some(path)) = (entry.lens.size, &found) {
        let loaded = Photo::load(path)?;
        entry.lens.size = Some([loaded.width, loaded.height]);
        photo = Some(loaded);
    }
    let camera = entry.lens.size.map(|size| entry.lens.camera(size));
    let lacking = camera.map(|camera| (camera, to.carried(&camera))).filter(|(camera, carried)| camera != carried);
    let mut file = found.clone();
    if let Some((camera, carried)) = lacking {
        let what = lost(&camera, &carried).join(", ");
        entry.lens = Lens::from(&carried);
        if let Some(path) = &found {
            let photo = photo.map_or_else(|| Photo::load(path), Ok)?;
            let picture = photo.rectified(&camera, &carried).with_context(|| {
                let size = format!("{} × {}", camera.width, camera.height);
                format!("{}: is not of {size} pixels as its camera is", path.display())
            })?;
            let copy = format!("{RECTIFIED}/{}.png", name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem));
            let mut png = Cursor::new(Vec::new());
            picture.write_to(&mut png, ImageFormat::Png)?;
            warnings.push(format!("photo {name}: {to} cannot carry its {what}; {copy} is the photo without"));
            file = Some(output.path(&copy));
            pictures.push((copy, png.into_inner()));
        } else {
            let photos = photos.display();
            warnings.push(format!(
                "photo {name}: {to} cannot carry its {what}, which is left out; with the photo in {photos} (or --photos DIR) \
                 it would be handed over without"
            ));
        }
    }
    entry.file = match (to, file) {
        (Format::Texreg | Format::Metashape, _) | (_, None) => name,
        (_, Some(file)) => {
            let folder = if is_folder(to) { photos } else { output.folder() };
            relative(&file, folder).to_string_lossy().replace('\\', "/")
        }
    };
    Ok(())
}

/// The one lens a file states for all its photos.
fn only_lens(path: &Path) -> anyhow::Result<Lens> {
    let lenses = match read_lenses(path)? {
        LensFile::Shared(lens) => return Ok(lens),
        LensFile::PerPhoto(lenses) => lenses,
    };
    let mut lenses = lenses.into_iter().map(|(_, lens)| lens);
    match lenses.next() {
        Some(first) if lenses.all(|lens| lens == first) => Ok(first),
        _ => bail!("{}: its photos do not have one lens in common, and this format holds one", path.display()),
    }
}

fn is_folder(format: Format) -> bool {
    matches!(format, Format::Colmap | Format::ColmapBinary)
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A path as seen from a folder.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    pathdiff::diff_paths(absolute(path), absolute(folder)).unwrap_or_else(|| path.to_owned())
}

fn unknown(path: &Path, option: &str) -> String {
    let names: Vec<String> = Format::ALL.iter().map(ToString::to_string).collect();
    format!("{}: its name tells no format; say it with {option}, one of {}", path.display(), names.join(", "))
}
