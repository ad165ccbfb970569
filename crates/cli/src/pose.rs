//! `texreg pose`: cameras from point pairs alone.

use serde_json::{Value, json};
use texreg::driver::{Panel, overlay};
use texreg::formats::{CameraEntry, CameraFile, write_cameras};
use texreg::posit::Solution;

use crate::Ending;
use crate::args::Pose;
use crate::handover;
use crate::inputs::{Inputs, model, photo};
use crate::output::{Output, jpeg, overlay_name, print, table};

pub(crate) fn run(args: &Pose, json: bool) -> anyhow::Result<Ending> {
    let inputs = Inputs::read(&args.inputs, None)?;
    let output = Output::open(&args.inputs.output)?;
    let mesh = model(&args.inputs.model)?;
    let mut posed = Vec::new();
    let mut pictures = Vec::new();
    for path in &inputs.photos {
        let photo = photo(path)?;
        let solution = inputs.pose(&photo)?;
        let panel = Panel { label: "pose", view: &solution.view, colour: [40, 230, 160] };
        pictures.push(jpeg(&overlay(&mesh, &photo, &[panel]))?);
        posed.push((photo.file, solution));
    }
    for ((file, _), picture) in posed.iter().zip(&pictures) {
        output.write(&overlay_name(file), picture)?;
    }
    let entries: Vec<CameraEntry> = posed.iter().map(|(file, solution)| entry(file, solution)).collect();
    let cameras = CameraFile { photos: entries, ..CameraFile::default() };
    write_cameras(&output.path("cameras.json"), &cameras)?;
    let handed = handover::write_all(&args.inputs, &output, &cameras)?;

    let path = output.path("cameras.json").display().to_string();
    if json {
        let photos: Vec<Value> = cameras.photos.iter().map(|entry| Value::Object(entry.keys())).collect();
        print(&format!("{:#}", json!({"cameras": path, "formats": handed, "photos": photos})))?;
    } else {
        let mut rows = vec![["photo", "rms px", "left out", ""].map(str::to_owned).to_vec()];
        rows.extend(posed.iter().map(|(file, solution)| {
            vec![
                file.clone(),
                format!("{:.2}", solution.rms),
                solution.rejected.len().to_string(),
                doubts(solution).join("; "),
            ]
        }));
        print(&format!("{}see {path}", table(&rows)))?;
    }
    let clear = posed.iter().all(|(_, solution)| doubts(solution).is_empty());
    Ok(if clear { Ending::Good } else { Ending::Doubtful })
}

fn entry(file: &str, solution: &Solution) -> CameraEntry {
    let mut entry = CameraEntry::new(file, &solution.view);
    let doubts = doubts(solution);
    if !doubts.is_empty() {
        entry.other.insert("status".into(), json!("uncertain"));
        entry.other.insert("reasons".into(), json!(doubts));
    }
    entry.other.insert("rms_px".into(), json!(solution.rms));
    entry.other.insert("left_out".into(), json!(solution.rejected));
    entry
}

/// Why the pose should not be trusted.
fn doubts(solution: &Solution) -> Vec<String> {
    let twin = solution.alternative.map(|_| "another pose explains the pairs about as well; add pairs".to_owned());
    twin.into_iter().collect()
}
