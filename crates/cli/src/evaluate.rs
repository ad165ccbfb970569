//! `texreg evaluate`: scores cameras against the true ones.

use serde_json::{Value, json};
use texreg::driver::{Score, TruePhoto, read_truth, score};
use texreg::formats::{base_name, read_cameras};

use crate::Ending;
use crate::args::Evaluate;

pub(crate) fn run(args: &Evaluate, json: bool) -> anyhow::Result<Ending> {
    let truth = read_truth(&args.truth)?;
    let cameras = read_cameras(&args.cameras)?;
    let score = |photo: &TruePhoto| {
        let entry = cameras.entry(base_name(&photo.file))?;
        let size = [photo.view.camera.width, photo.view.camera.height];
        Some(score(photo, truth.diagonal, &entry.view(size)))
    };
    let scores: Vec<(&str, Option<Score>)> = truth.photos.iter().map(|p| (p.file.as_str(), score(p))).collect();
    if json {
        println!("{:#}", object(&truth.name, &scores)?);
    } else {
        print(&truth.name, &scores);
    }
    let good = scores.iter().all(|(_, score)| score.is_some_and(|score| score.ok));
    Ok(if good { Ending::Good } else { Ending::Doubtful })
}

fn object(name: &str, scores: &[(&str, Option<Score>)]) -> serde_json::Result<Value> {
    let row = |(file, score): &(&str, Option<Score>)| {
        let Some(score) = score else {
            return Ok(json!({"file": file, "ok": false, "strict": false, "missing": true}));
        };
        let mut row = json!({"file": file});
        if let (Value::Object(row), Value::Object(score)) = (&mut row, serde_json::to_value(score)?) {
            row.extend(score);
        }
        Ok(row)
    };
    let photos = scores.iter().map(row).collect::<serde_json::Result<Vec<_>>>()?;
    Ok(json!({"case": name, "photos": photos}))
}

fn print(name: &str, scores: &[(&str, Option<Score>)]) {
    if !name.is_empty() {
        println!("{name}");
    }
    let width = scores.iter().map(|(file, _)| file.chars().count()).max().unwrap_or(0).max(5);
    println!("{:width$}  rotation °  centre/bbox    mean px     max px   focal %  ok   strict", "photo");
    let word = |yes| if yes { "yes" } else { "no" };
    for (file, score) in scores {
        match score {
            None => println!("{file:width$}  is missing from the cameras"),
            Some(s) => println!(
                "{file:width$}  {:10.4}  {:11.5}  {:9.3}  {:9.3}  {:8.3}  {:3}  {}",
                s.rotation_deg,
                s.centre_over_bbox,
                s.mean_px,
                s.max_px,
                s.focal_pct,
                word(s.ok),
                word(s.strict)
            ),
        }
    }
    let count = |test: fn(&Score) -> bool| scores.iter().filter(|(_, score)| score.as_ref().is_some_and(test)).count();
    println!("{} of {} ok, {} strict", count(|s| s.ok), scores.len(), count(|s| s.strict));
}
