//! `texreg texture`: a textured model from cameras and photos.

use std::path::{Path, PathBuf};

use anyhow::{anyhow, bail};
use serde_json::json;
use texreg::driver::Photo;
use texreg::formats::{CameraEntry, CameraFile, base_name, read_cameras, write_atomic, write_together};
use texreg::surface::Mesh;
use texreg::texture::{self, Glb, Options, Pixels, Source, Textured, texture};

use crate::Ending;
use crate::args::{ModelFormat, Texture};
use crate::inputs::{fitted, model, name, photo};
use crate::output::{Output, print, table};
use crate::register::{PARTS, progress};

/// The weight of a photo whose registration is uncertain.
const DOUBTFUL: f64 = 0.2;

/// The uncertainty beyond which a photo is not kept still farther away from edges, in pixels.
const FARTHEST: f64 = 20.0;

/// A photo that is used.
struct Used<'a> {
    entry: &'a CameraEntry,
    path: PathBuf,
    source: Source,
}

pub(crate) fn run(args: &Texture, json: bool) -> anyhow::Result<Ending> {
    let cameras = read_cameras(&args.cameras)?;
    let (used, left_out) = choose(args, &cameras)?;
    let folder = args.output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Output::open(folder)?;
    let mesh = model(&args.model)?;
    let bar = progress(used.len());
    let sources: Vec<Source> = used.iter().map(|photo| photo.source.clone()).collect();
    let load = |i: usize| -> anyhow::Result<Pixels> {
        let Used { entry, path, .. } = &used[i];
        bar.set_message(entry.file.clone());
        let photo = photo(path)?;
        fitted(&entry.lens, &args.cameras, &photo)?;
        bar.inc(PARTS / 2);
        Ok(Pixels { width: photo.width, height: photo.height, rgb: photo.rgb })
    };
    let options = Options {
        size: args.size.map(|size| size.get()),
        blend: args.blend.into(),
        unseen: args.unseen.into(),
        balance: !args.no_balance,
        ..Options::default()
    };
    let textured = texture(&mesh, &sources, load, &options).map_err(|error: anyhow::Error| {
        match error.downcast_ref::<texture::Error>() {
            Some(cause) => anyhow!("{}: {cause}; check that the cameras belong to the model", args.cameras.display()),
            None => error,
        }
    })?;
    bar.finish_and_clear();
    let written = write(args, &mesh, &textured)?;
    report(args, json, &used, &left_out, &textured, &written)?;
    let doubtful = used.iter().any(|photo| photo.source.trust < 1.0);
    Ok(if left_out.is_empty() && !doubtful { Ending::Good } else { Ending::Doubtful })
}

/// The photos to use, and the names of those left out because their registration failed.
fn choose<'a>(args: &Texture, cameras: &'a CameraFile) -> anyhow::Result<(Vec<Used<'a>>, Vec<&'a str>)> {
    let file = args.cameras.display();
    let (mut used, mut left_out) = (Vec::new(), Vec::new());
    for entry in &cameras.photos {
        let status = entry.other.get("status").and_then(|status| status.as_str());
        if status == Some("failed") {
            left_out.push(entry.file.as_str());
            continue;
        }
        let path = find(args, entry)?;
        let size = match entry.lens.size {
            Some(size) => size,
            None => {
                let Photo { width, height, .. } = photo(&path)?;
                [width, height]
            }
        };
        let trust = if status == Some("uncertain") { DOUBTFUL } else { 1.0 };
        let uncertainty = entry.other.get("uncertainty").and_then(|u| u.get("pixels")?.as_f64());
        let uncertainty = uncertainty.unwrap_or(0.0).clamp(0.0, FARTHEST);
        used.push(Used { entry, path, source: Source { view: entry.view(size), trust, uncertainty } });
    }
    match (used.is_empty(), left_out.is_empty()) {
        (true, true) => bail!("{file}: names no photo; add one entry a photo"),
        (true, false) => bail!("{file}: every photo's registration failed; register them again from a better start"),
        _ => Ok((used, left_out)),
    }
}

/// Where a photo is: in `--photos`, or beside the cameras, beside the model or in the working folder.
fn find(args: &Texture, entry: &CameraEntry) -> anyhow::Result<PathBuf> {
    let beside = |file: &Path| file.parent().unwrap_or(Path::new("")).to_owned();
    let folders = match &args.photos {
        Some(folder) => vec![folder.clone()],
        None => vec![beside(&args.cameras), beside(&args.model), PathBuf::new()],
    };
    let candidates = folders.iter().flat_map(|folder| [folder.join(&entry.file), folder.join(base_name(&entry.file))]);
    candidates.into_iter().find(|path| path.is_file()).ok_or_else(|| {
        let place = match &args.photos {
            Some(folder) => format!("not in {}", folder.display()),
            None => "not beside it, the model or in this folder".to_owned(),
        };
        anyhow!("{}: photo {}: {place}; say where the photos are with --photos DIR", args.cameras.display(), entry.file)
    })
}

/// Writes the model; the names of the files, the one to open first.
fn write(args: &Texture, mesh: &Mesh, textured: &Textured) -> anyhow::Result<Vec<String>> {
    let path = &args.output;
    let mut written = vec![path.display().to_string()];
    match args.format() {
        ModelFormat::Glb => write_atomic(path, &Glb::new(mesh, &textured.texture)?.bytes()?)?,
        ModelFormat::Ply => write_atomic(path, &texture::ply(mesh, &textured.colours))?,
        ModelFormat::Obj => {
            let (material, picture) = (path.with_extension("mtl"), path.with_extension("png"));
            write_together(&[
                (&picture, texture::png(&textured.texture.image)?),
                (&material, texture::mtl(&name(&picture)).into_bytes()),
                (path, texture::obj(mesh, &textured.texture, &name(&material)).into_bytes()),
            ])?;
            written.extend([material, picture].map(|path| path.display().to_string()));
        }
    }
    Ok(written)
}

fn report(
    args: &Texture,
    json: bool,
    used: &[Used],
    left_out: &[&str],
    textured: &Textured,
    written: &[String],
) -> anyhow::Result<()> {
    let has_texture = args.format() != ModelFormat::Ply;
    let (width, height) = textured.texture.image.dimensions();
    if json {
        let photos = used.iter().zip(&textured.gains).zip(&textured.shares);
        let photos =
            photos.map(|((photo, gain), share)| json!({"file": photo.entry.file, "gain": gain, "sees": share}));
        let mut object = json!({
            "files": written, "charts": textured.charts, "seen": textured.seen_share,
            "photos": photos.collect::<Vec<_>>(), "left_out": left_out,
        });
        if has_texture {
            (object["width"], object["height"]) = (json!(width), json!(height));
        }
        return Ok(print(&format!("{object:#}"))?);
    }
    let mut rows = vec![["photo", "sees", "gain R", "G", "B", ""].map(str::to_owned).to_vec()];
    for ((photo, gain), share) in used.iter().zip(&textured.gains).zip(&textured.shares) {
        let note = if photo.source.trust < 1.0 { "uncertain: little weight" } else { "" };
        let mut row = vec![photo.entry.file.clone(), format!("{:.0} %", 100.0 * share)];
        row.extend(gain.iter().map(|gain| format!("{gain:.3}")));
        row.push(note.to_owned());
        rows.push(row);
    }
    let dashes = ["–"; 4].map(str::to_owned);
    rows.extend(
        left_out
            .iter()
            .map(|file| [vec![(*file).to_owned()], dashes.to_vec(), vec!["failed: left out".to_owned()]].concat()),
    );
    let charts =
        if textured.charts > 0 { format!("{} charts", textured.charts) } else { "the model's own charts".to_owned() };
    let texture = if has_texture { format!("{width} × {height} texels, {charts}, ") } else { String::new() };
    Ok(print(&format!("{}{texture}{:.0} % seen; see {}", table(&rows), 100.0 * textured.seen_share, written[0]))?)
}
