//! Joint registrations through the binary.

mod common;

use std::fs;
use std::path::Path;

use common::{fixture, run};
use serde_json::{Value, json};

/// The rough cameras of the fixture with a focal length that is 4 % too long, as `init.json`.
fn write_starts(folder: &Path) {
    let mut cameras: Value = serde_json::from_slice(&fs::read(fixture("initial.json")).unwrap()).unwrap();
    for photo in cameras["photos"].as_array_mut().unwrap() {
        for key in ["fx", "fy"] {
            photo["K"][key] = json!(1.04 * photo["K"][key].as_f64().unwrap());
        }
    }
    fs::write(folder.join("init.json"), cameras.to_string()).unwrap();
}

/// Registers photos of the fixture jointly: their entries in `cameras.json`, in the order of the file names.
fn register(folder: &Path, photos: [usize; 3], threads: &str) -> Vec<Value> {
    let photos = photos.map(|k| fixture(&format!("photo_0{k}.jpg")).display().to_string());
    let model = fixture("model.ply").display().to_string();
    let mut args: Vec<&str> = vec!["register", &model];
    args.extend(photos.iter().map(String::as_str));
    args.extend("--init init.json --joint --share-intrinsics --refine focal -o out --threads".split(' '));
    args.push(threads);
    let run = run(folder, &args);
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    let cameras: Value = serde_json::from_slice(&fs::read(folder.join("out/cameras.json")).unwrap()).unwrap();
    let mut entries = cameras["photos"].as_array().unwrap().clone();
    entries.sort_by_key(|entry| entry["file"].as_str().unwrap().to_owned());
    entries
}

/// The rows of `texreg evaluate` for what was registered last.
fn scores(folder: &Path) -> Vec<Value> {
    let truth = fixture("truth.json").display().to_string();
    let evaluated = run(folder, &["evaluate", "out/cameras.json", "--truth", &truth, "--json"]);
    let scores: Value = serde_json::from_str(&evaluated.stdout).unwrap();
    scores["photos"].as_array().unwrap().clone()
}

#[test]
fn photos_of_one_camera_share_its_lens_in_any_order() {
    let folder = tempfile::tempdir().unwrap();
    write_starts(folder.path());
    let entries = register(folder.path(), [0, 1, 2], "2");
    let rows = scores(folder.path());
    for (row, entry) in rows.iter().zip(&entries) {
        assert!(row["mean_px"].as_f64().unwrap() < 1.5, "{row}");
        assert!(row["focal_pct"].as_f64().unwrap().abs() < 1.5, "from 4.8 % off: {row}");
        assert_eq!((&entry["K"], &entry["status"]), (&entries[0]["K"], &json!("registered")));
        let uncertainty = &entry["uncertainty"];
        assert!((0.01..2.0).contains(&uncertainty["pixels"].as_f64().unwrap()), "{uncertainty}");
        assert!(uncertainty["focal_distance_correlation"].as_f64().unwrap().abs() <= 1.0, "{uncertainty}");
    }
    let others = register(folder.path(), [2, 0, 1], "1");
    assert_eq!(entries, others, "neither the order of the photos nor the number of threads changes anything");
}
