//! Whole registrations through the binary.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{Run, fixture, run};
use serde_json::Value;

/// Runs `texreg` in a folder, with `@name` standing for a file of `data`.
fn run_on(data: &Path, folder: &Path, command: &str) -> Run {
    let word = |word: &str| match word.strip_prefix('@') {
        Some(name) => data.join(name).into_os_string(),
        None => word.into(),
    };
    run(folder, &command.split_whitespace().map(word).collect::<Vec<_>>())
}

fn run_fixture(folder: &Path, command: &str) -> Run {
    run_on(&fixture(""), folder, command)
}

/// The rows of `texreg evaluate --json`, and its exit status.
fn scores(data: &Path, folder: &Path, cameras: &str) -> (Vec<Value>, i32) {
    let run = run_on(data, folder, &format!("evaluate {cameras} --truth @truth.json --json"));
    let object: Value = serde_json::from_str(&run.stdout).unwrap();
    (object["photos"].as_array().unwrap().clone(), run.status)
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap()
}

/// The folder of a larger case, outside the repository, if it is there.
fn case(name: &str) -> Option<PathBuf> {
    let found = Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .map(|up| up.join("shared/cases").join(name))
        .find(|p| p.is_dir());
    if found.is_none() {
        println!("skipped: no shared/cases/{name} above the repository");
    }
    found
}

#[test]
fn a_photo_is_registered_from_point_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let command = "register @model.ply @photo_00.jpg @photo_01.jpg @photo_02.jpg --pairs @correspondences.json \
                   --camera @truth.json -o out";
    let run = run_fixture(folder.path(), command);
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    assert!(run.stdout.contains("3 of 3 registered; see out/report.html"), "{run:?}");
    let (rows, status) = scores(&fixture(""), folder.path(), "out/cameras.json");
    assert_eq!((rows.len(), status), (3, 0));
    for row in &rows {
        assert!(number(row, "mean_px") < 1.0, "{row}");
    }
    let cameras: Value = serde_json::from_slice(&fs::read(folder.path().join("out/cameras.json")).unwrap()).unwrap();
    for entry in cameras["photos"].as_array().unwrap() {
        assert_eq!(entry["status"], "registered");
        assert!(number(&entry["similarity"], "end") >= number(&entry["similarity"], "start"), "{entry}");
        let picture = folder.path().join("out/overlay").join(entry["file"].as_str().unwrap());
        let (width, height) = image::image_dimensions(picture).unwrap();
        assert!(width <= 1600 && height <= 1000 && width > 600, "{width} × {height}");
    }
    let report = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert_eq!(report.matches("data:image/jpeg;base64,").count(), 3);
    assert!(!report.contains("<script") && !report.contains("http"), "the report stands alone");
}

#[test]
fn the_focal_length_comes_from_the_photo_and_is_refined() {
    let folder = tempfile::tempdir().unwrap();
    let command = "register @model.ply @photo_01.jpg --pairs @correspondences.json --refine focal -o out --json";
    let run = run_fixture(folder.path(), command);
    assert_eq!(run.status, 0, "{run:?}");
    let object: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&object["options"]["refine"], &object["options"]["solver"]), (&"focal".into(), &"lm".into()));
    assert_eq!(object["options"]["signal"], "reflectance,normals", "the signals that were taken");
    let photo = &object["photos"][0];
    assert_eq!((&photo["file"], &photo["stop"]), (&"photo_01.jpg".into(), &"converged".into()));
    assert!(photo["stages"].as_array().is_some_and(|stages| !stages.is_empty()));
    let (rows, _) = scores(&fixture(""), folder.path(), "out/cameras.json");
    let row = rows.iter().find(|row| row["file"] == "photo_01.jpg").unwrap();
    assert!(number(row, "mean_px") < 1.8, "within 0.2 % of the diagonal even with EXIF's focal length: {row}");
    assert!(number(row, "focal_pct").abs() < 3.0 && number(row, "focal_pct") != 0.775, "{row}");
}

/// The fixture's vertices without its triangles.
fn cloud() -> Vec<u8> {
    let mesh = fs::read(fixture("model.ply")).unwrap();
    let end = mesh.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = str::from_utf8(&mesh[..end]).unwrap();
    let of_vertices = |line: &&str| !line.starts_with("element face") && !line.starts_with("property list");
    let kept: Vec<&str> = header.lines().filter(of_vertices).collect();
    let count: usize = header.lines().find_map(|l| l.strip_prefix("element vertex ")).unwrap().parse().unwrap();
    let size = 4 * kept.iter().filter(|line| line.starts_with("property float")).count();
    [(kept.join("\n") + "\n").as_bytes(), &mesh[end..end + count * size]].concat()
}

#[test]
fn a_photo_is_registered_to_a_cloud() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cloud.ply"), cloud()).unwrap();
    let model = folder.path().join("cloud.ply").display().to_string();
    let command = format!("register {model} @photo_01.jpg --init @initial.json --camera @truth.json -o out");
    let run = run_fixture(folder.path(), &command);
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    let (rows, _) = scores(&fixture(""), folder.path(), "out/cameras.json");
    let row = rows.iter().find(|row| row["file"] == "photo_01.jpg").unwrap();
    assert!(number(row, "mean_px") < 1.5, "{row}");
}

#[test]
fn a_photo_is_registered_with_nothing_to_start_from() {
    let folder = tempfile::tempdir().unwrap();
    let command = "register @model.ply @photo_02.jpg --start search --camera @truth.json -o out";
    let run = run_fixture(folder.path(), command);
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    let (rows, _) = scores(&fixture(""), folder.path(), "out/cameras.json");
    let row = rows.iter().find(|row| row["file"] == "photo_02.jpg").unwrap();
    assert!(number(row, "mean_px") < 1.0, "{row}");
}

#[test]
fn the_result_does_not_depend_on_threads() {
    let folder = tempfile::tempdir().unwrap();
    let cameras = ["1", "2", "5"].map(|threads| {
        let out = format!("out{threads}");
        let command = format!("register @model.ply @photo_02.jpg --init @initial.json --threads {threads} -o {out}");
        let run = run_fixture(folder.path(), &command);
        assert!(run.status == 0 || run.status == 3, "{run:?}");
        let out = folder.path().join(out);
        (fs::read_to_string(out.join("cameras.json")).unwrap(), fs::read(out.join("overlay/photo_02.jpg")).unwrap())
    });
    assert!(cameras[0] == cameras[1] && cameras[1] == cameras[2], "{} {} {}", cameras[0].0, cameras[1].0, cameras[2].0);
}

#[test]
fn poses_come_from_pairs_alone() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_fixture(
        folder.path(),
        "pose @model.ply @photo_00.jpg --pairs @correspondences.json --camera @truth.json -o out",
    );
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    let (rows, status) = scores(&fixture(""), folder.path(), "out/cameras.json");
    assert!(number(&rows[0], "mean_px") < 8.0, "no worse than the clicks: {}", rows[0]);
    assert_eq!(rows[1]["missing"], true);
    assert_eq!(status, 3, "two photos are missing");
    assert!(folder.path().join("out/overlay/photo_00.jpg").is_file());
}

#[test]
fn renderings_show_the_model_where_the_camera_sees_it() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_fixture(folder.path(), "render @model.ply --cameras @truth.json --signal normals,silhouette -o out");
    assert_eq!(run.status, 0, "{run:?}");
    let silhouette = image::open(folder.path().join("out/photo_00.jpg.silhouette.png")).unwrap().to_luma8();
    let normals = image::open(folder.path().join("out/photo_00.jpg.normals.png")).unwrap().to_rgb8();
    assert_eq!((silhouette.dimensions(), normals.dimensions()), ((1200, 900), (1200, 900)));
    let truth: Value = serde_json::from_slice(&fs::read(fixture("truth.json")).unwrap()).unwrap();
    let photo = &truth["photos"][0];
    let at = |value: &Value, i: usize| value[i].as_f64().unwrap();
    let points = photo["visible_points"].as_array().unwrap();
    let seen = points.iter().filter(|point| {
        let [x, y, z] =
            [0, 1, 2].map(|i| (0..3).map(|j| at(&photo["R"][i], j) * at(point, j)).sum::<f64>() + at(&photo["T"], i));
        let k = |key: &str| photo["K"][key].as_f64().unwrap();
        let (u, v) = ((k("fx") * x / z + k("cx")).round() as u32, (k("fy") * y / z + k("cy")).round() as u32);
        // Blue is −z of the normal: what is seen looks towards the camera.
        silhouette.get_pixel(u, v)[0] == 255 && normals.get_pixel(u, v)[2] >= 120
    });
    assert!(seen.count() * 100 >= points.len() * 95, "only points on the outline may round into the background");
}

#[test]
fn signals_are_stored_and_read_again() {
    let folder = tempfile::tempdir().unwrap();
    let run = run_fixture(folder.path(), "signals @model.ply -o stored.ply --json");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    let object: Value = serde_json::from_str(&run.stdout).unwrap();
    let occlusion = &object["properties"][0];
    assert_eq!((&object["file"], &occlusion["property"]), (&"stored.ply".into(), &"ambient_occlusion".into()));
    assert!(number(occlusion, "greatest") <= 1.0 && number(occlusion, "least") < 0.5, "{occlusion}");
    // The stored model is drawn as the one that it was made from.
    let names = ["ambient-occlusion", "curvature", "reflectance", "normals"];
    for (model, out) in [("@model.ply", "computed"), ("stored.ply", "stored")] {
        let command = format!("render {model} --cameras @truth.json --signal {} -o {out}", names.join(","));
        let run = run_fixture(folder.path(), &command);
        assert_eq!((run.status, run.stdout.lines().count()), (0, 12), "{run:?}");
    }
    for name in names {
        let [computed, stored] = ["computed", "stored"].map(|out| {
            image::open(folder.path().join(out).join(format!("photo_01.jpg.{name}.png"))).unwrap().to_rgb8()
        });
        assert!(computed == stored, "{name}");
        assert!(computed.pixels().any(|pixel| pixel.0[0] > 200), "{name}");
    }
    let run = run_fixture(folder.path(), "signals @model.ply -o stored.obj");
    assert_eq!(run.status, 1);
    assert!(run.stderr.contains("stored.obj: signals are stored in a PLY file"), "{run:?}");
}

#[test]
fn a_photo_is_registered_by_a_product_of_signals() {
    let folder = tempfile::tempdir().unwrap();
    let command = "register @model.ply @photo_00.jpg --init @initial.json --camera @truth.json \
                   --signal normals,ambient-occlusion -o out --json";
    let run = run_fixture(folder.path(), command);
    assert_eq!(run.status, 0, "{run:?}");
    let object: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(object["options"]["signal"], "normals,ambient-occlusion");
    let (rows, _) = scores(&fixture(""), folder.path(), "out/cameras.json");
    assert!(number(&rows[0], "mean_px") < 1.0, "{}", rows[0]);
}

#[test]
fn scores_are_those_of_the_published_formulas() {
    // Worked by hand: the camera turned by 90° about its axis, moved by 3 of a diagonal of 10, with twice the focal length.
    let folder = tempfile::tempdir().unwrap();
    let truth = r#"{"bbox_diagonal": 10, "photos": [{"file": "a.jpg", "width": 400, "height": 300, "K": {"fx": 100},
        "R": [[1,0,0],[0,1,0],[0,0,1]], "T": [0,0,5], "visible_points": [[0,0,0],[1,0,0]]}]}"#;
    let guess = r#"{"photos": [{"file": "a.jpg", "K": {"fx": 200}, "R": [[0,-1,0],[1,0,0],[0,0,1]], "T": [0,0,8]}]}"#;
    fs::write(folder.path().join("truth.json"), truth).unwrap();
    fs::write(folder.path().join("guess.json"), guess).unwrap();
    let (rows, status) = scores(folder.path(), folder.path(), "guess.json");
    // The second point moves from (20, 0) to (0, 25) right and below of the centre.
    for (key, value) in [
        ("rotation_deg", 90.0),
        ("centre_over_bbox", 0.3),
        ("mean_px", 0.5 * f64::hypot(20.0, 25.0)),
        ("max_px", f64::hypot(20.0, 25.0)),
        ("focal_pct", 100.0),
    ] {
        assert!((number(&rows[0], key) - value).abs() < 1e-9, "{key}: {} instead of {value}", rows[0][key]);
    }
    assert_eq!((&rows[0]["ok"], &rows[0]["strict"], status), (&Value::Bool(false), &Value::Bool(false), 3));
}

#[test]
fn a_painted_object_is_registered_by_its_reflectance() {
    let Some(case) = case("igea_painted") else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = run_on(
        &case,
        folder.path(),
        "register @model.ply @photo_00.jpg --init @truth.json --signal normals,reflectance -o out",
    );
    assert!(run.status == 0 || run.status == 3, "{run:?}");
    let (rows, _) = scores(&case, folder.path(), "out/cameras.json");
    assert!(number(&rows[0], "mean_px") < 4.0, "{}", rows[0]);
}
