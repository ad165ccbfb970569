//! Every solver through the binary, and the bounds that all of them keep to.

mod common;

use std::fs;
use std::path::Path;

use common::{fixture, run};
use serde_json::{Value, json};

/// A photo of the fixture from its true camera, moved by 1 % and turned by a degree, as `near.json`; the true focal length.
fn write_start(folder: &Path) -> f64 {
    let truth: Value = serde_json::from_slice(&fs::read(fixture("truth.json")).unwrap()).unwrap();
    let mut photo = truth["photos"][0].clone();
    let number = |value: &Value| value.as_f64().unwrap();
    let (sin, cos) = 0.0175f64.sin_cos();
    let rows: Vec<Vec<f64>> = (0..3).map(|i| (0..3).map(|j| number(&photo["R"][i][j])).collect()).collect();
    let turned = |j: usize| [cos * rows[0][j] + sin * rows[2][j], rows[1][j], cos * rows[2][j] - sin * rows[0][j]];
    photo["R"] = json!((0..3).map(|i| (0..3).map(|j| turned(j)[i]).collect::<Vec<f64>>()).collect::<Vec<_>>());
    photo["T"][2] = json!(1.01 * number(&photo["T"][2]));
    fs::write(folder.join("near.json"), json!({"photos": [photo]}).to_string()).unwrap();
    number(&photo["K"]["fx"])
}

/// Registers the photo: its entry in `cameras.json`, and its row of `texreg evaluate`.
fn register(folder: &Path, options: &str) -> (Value, Value) {
    let [model, photo, truth] =
        ["model.ply", "photo_00.jpg", "truth.json"].map(|name| fixture(name).display().to_string());
    let mut args: Vec<&str> = vec!["register", &model, &photo];
    args.extend("--init near.json -o out".split(' ').chain(options.split(' ')));
    let run_of = run(folder, &args);
    assert!([0, 3].contains(&run_of.status) && run_of.stderr.is_empty(), "{options}: {run_of:?}");
    let cameras: Value = serde_json::from_slice(&fs::read(folder.join("out/cameras.json")).unwrap()).unwrap();
    let evaluated = run(folder, &["evaluate", "out/cameras.json", "--truth", &truth, "--json"]);
    let scores: Value = serde_json::from_str(&evaluated.stdout).unwrap();
    (cameras["photos"][0].clone(), scores["photos"][0].clone())
}

fn all_find_the_camera(solvers: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    write_start(folder.path());
    for solver in solvers {
        let (entry, row) = register(folder.path(), &format!("--solver {solver}"));
        let off = row["mean_px"].as_f64().unwrap();
        // What follows batches ends near the maximum, not at it.
        let most = if *solver == "sgd" { 2.0 } else { 1.0 };
        assert!(off < most && entry["status"] == "registered", "{solver}: {off} px, {entry}");
    }
}

#[test]
fn solvers_with_gradients_find_the_camera() {
    all_find_the_camera(&["lm", "gradient", "cg", "bfgs", "lbfgs"]);
}

#[test]
fn solvers_with_batches_and_without_gradients_find_the_camera() {
    all_find_the_camera(&["sgd", "bobyqa", "nelder-mead"]);
}

#[test]
fn bounds_hold_where_the_photo_asks_for_more() {
    let folder = tempfile::tempdir().unwrap();
    let focal = write_start(folder.path());
    let free = "--refine focal,principal";
    let number = |value: &Value| value.as_f64().unwrap();
    let [fx, cx] = ["fx", "cx"].map(|key| move |entry: &Value| entry["K"][key].as_f64().unwrap());
    let centre = texreg::surface::load(fixture("model.ply")).unwrap().centre();
    let distance = |entry: &Value| {
        let turned: f64 = (0..3).map(|k| number(&entry["R"][2][k]) * centre[k]).sum();
        turned + number(&entry["T"][2])
    };
    let (without, _) = register(folder.path(), free);
    // A focal length two per cent longer needs a longer distance, and may not have it.
    let (least, off, near) = (1.02 * fx(&without).max(focal), 0.25, distance(&without));
    for solver in ["lm", "lbfgs", "sgd", "bobyqa"] {
        let bounds = format!(
            "{free} --solver {solver} --focal-range {least},{} --principal-within {off} --distance-range {},{near}",
            2.0 * focal,
            0.5 * near
        );
        let (entry, _) = register(folder.path(), &bounds);
        assert!(fx(&entry) >= least * (1.0 - 1e-12) && fx(&entry) < 1.01 * least, "{solver}: {entry}");
        assert!(distance(&entry) <= near * (1.0 + 1e-12), "{solver}: {entry}");
        assert!((cx(&entry) - 599.5).abs() <= off * (1.0 + 1e-12), "{solver}: {entry}");
        assert_eq!(entry["status"], "uncertain", "{solver}: {entry}");
        assert!(entry["reasons"].to_string().contains("at the end of its bounds"), "{solver}: {entry}");
    }
}
