//! `texreg convert`: cameras to and from other programs.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail};
use serde_json::json;
use texreg::formats::{Format, Lens, LensFile, read_lenses, write_lens};

use crate::Ending;
use crate::args::Convert;
use crate::handover::{self, parent};
use crate::output::print;

pub(crate) fn run(args: &Convert, json: bool) -> anyhow::Result<Ending> {
    let from = args.from.or_else(|| Format::of(&args.input)).with_context(|| unknown(&args.input, "--from"))?;
    let to = args.to.or_else(|| Format::of(&args.output)).with_context(|| unknown(&args.output, "--to"))?;
    let mut warnings = Vec::new();
    let written = if from == Format::OpenCv || to == Format::OpenCv {
        write_lens(&args.output, &only_lens(&args.input)?, to)?;
        vec![args.output.clone()]
    } else {
        let mut scene = from.read(&args.input)?;
        warnings.append(&mut scene.warnings);
        if let Some(model) = &args.model {
            scene.meshes = handover::meshes(model)?;
        }
        let photos = args.photos.as_deref().unwrap_or_else(|| parent(&args.input));
        handover::write(&args.output, to, scene, photos, &mut warnings)?
    };
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

fn unknown(path: &Path, option: &str) -> String {
    let names: Vec<String> = Format::ALL.iter().map(ToString::to_string).collect();
    format!("{}: its name tells no format; say it with {option}, one of {}", path.display(), names.join(", "))
}
