//! Cameras handed over to other programs.
//!
//! A photo whose camera the format cannot carry is handed over as the camera the format can carry would have taken it.

use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use image::ImageFormat;
use texreg::driver::Photo;
use texreg::formats::{CameraEntry, CameraFile, Format, Lens, PlacedMesh, Scene, base_name, lost, write_together};

use crate::args;
use crate::inputs::{cause, name};
use crate::output::Output;

/// The folder, beside the output, of photos that were taken to another camera.
const RECTIFIED: &str = "undistorted";

/// The formats that `register` and `pose` write beside `cameras.json`.
pub(crate) const FORMATS: &[Format] = &[
    Format::MeshLab,
    Format::Colmap,
    Format::ColmapBinary,
    Format::Bundler,
    Format::Metashape,
    Format::Nerfstudio,
    Format::Blender,
];

/// Writes a scene to `path` in a format, with the photos that it needs, all of it or nothing. `photos` is where the photos are
/// whose names are not whole paths, and what names in a folder of files are relative to. What is lost is added to `warnings`.
/// The files are told, the first as `path`.
pub(crate) fn write(
    path: &Path,
    to: Format,
    mut scene: Scene,
    photos: &Path,
    warnings: &mut Vec<String>,
) -> anyhow::Result<Vec<PathBuf>> {
    let folder = if is_folder(to) { path } else { parent(path) };
    Output::open(folder)?;
    scene.meshes.iter_mut().for_each(|mesh| mesh.file = relative(&mesh.file, folder));
    let mut files = Vec::new();
    for entry in &mut scene.cameras.photos {
        fit(entry, to, photos, folder, &mut files, warnings)?;
    }
    if !files.is_empty() {
        let pictures = folder.join(RECTIFIED);
        fs::create_dir_all(&pictures).map_err(|e| anyhow!("{}: cannot be made ({})", pictures.display(), cause(&e)))?;
    }
    let written = [path.to_owned()].into_iter().chain(files.iter().map(|(path, _)| path.clone())).collect();
    files.extend(to.files(path, &scene)?);
    write_together(&files)?;
    Ok(written)
}

/// Writes the cameras that were found in the formats asked for; photos whose registration failed are left out, with a warning.
pub(crate) fn write_all(args: &args::Inputs, output: &Output, cameras: &CameraFile) -> anyhow::Result<Vec<PathBuf>> {
    let mut cameras = cameras.clone();
    let (mut written, mut warnings) = (Vec::new(), Vec::new());
    if args.format.is_empty() {
        return Ok(written);
    }
    cameras.photos.retain(|entry| {
        let failed = entry.other.get("status").is_some_and(|status| status == "failed");
        if failed {
            warnings.push(format!("photo {}: its registration failed; it is in cameras.json alone", entry.file));
        }
        !failed
    });
    for entry in &mut cameras.photos {
        if let Some(path) = args.photos.iter().find(|path| name(path) == entry.file) {
            entry.file = std::path::absolute(path)?.to_string_lossy().into_owned();
        }
    }
    for format in FORMATS.iter().filter(|format| args.format.contains(format)) {
        let folder = output.path(&format.to_string());
        let path = match format {
            Format::MeshLab => folder.join("project.mlp"),
            Format::Bundler => folder.join("bundle.out"),
            Format::Metashape => folder.join("cameras.xml"),
            Format::Nerfstudio => folder.join("transforms.json"),
            Format::Blender => folder.join("cameras.py"),
            _ => folder,
        };
        let scene = Scene { cameras: cameras.clone(), meshes: meshes(&args.model)?, ..Scene::default() };
        written.extend(write(&path, *format, scene, parent(&args.photos[0]), &mut warnings)?.into_iter().take(1));
    }
    warnings.iter().for_each(|warning| eprintln!("warning: {warning}"));
    Ok(written)
}

/// The meshes of a model: those of a project, each where its matrix puts it, or the one.
pub(crate) fn meshes(model: &Path) -> anyhow::Result<Vec<PlacedMesh>> {
    match Format::of(model) {
        Some(Format::MeshLab) => Ok(Format::MeshLab.read(model)?.meshes),
        _ => Ok(vec![PlacedMesh::new(model)]),
    }
}

/// Makes an entry one that the format can carry, and names the photo as the format names photos.
fn fit(
    entry: &mut CameraEntry,
    to: Format,
    photos: &Path,
    folder: &Path,
    pictures: &mut Vec<(PathBuf, Vec<u8>)>,
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
            let copy = folder.join(copy);
            file = Some(copy.clone());
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
            let folder = if is_folder(to) { photos } else { folder };
            relative(&file, folder).to_string_lossy().replace('\\', "/")
        }
    };
    Ok(())
}

fn is_folder(format: Format) -> bool {
    matches!(format, Format::Colmap | Format::ColmapBinary)
}

/// The folder a file is in.
pub(crate) fn parent(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A path as seen from a folder.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    pathdiff::diff_paths(absolute(path), absolute(folder)).unwrap_or_else(|| path.to_owned())
}
