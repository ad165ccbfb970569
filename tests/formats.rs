//! `texreg convert` through the binary.

mod common;

use std::fs;
use std::path::Path;
use std::process::Command;

use common::{fixture, run};
use serde_json::Value;

/// Cameras go through every format that is read and come back as they were; the true cameras still score as true.
#[test]
fn cameras_go_out_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let truth = fixture("truth.json");
    let truth = truth.to_str().unwrap();
    for name in ["p.mlp", "bundle.out", "cameras.xml", "transforms.json", "colmap", "colmap-binary"] {
        let to = if name.starts_with("colmap") { name } else { "" };
        let option = if to.is_empty() { "" } else { "--to" };
        let there = run(folder.path(), &["convert", truth, "-o", name, option, to]);
        assert_eq!(there.status, 0, "{name}: {}", there.stderr);
        let back = run(folder.path(), &["convert", name, "-o", "cameras.json"]);
        assert_eq!(back.status, 0, "{name}: {}", back.stderr);
        let score = run(folder.path(), &["evaluate", "cameras.json", "--truth", truth, "--json"]);
        let score: Value = serde_json::from_str(&score.stdout).unwrap();
        for photo in score["photos"].as_array().unwrap() {
            let mean = photo["mean_px"].as_f64().unwrap();
            assert!(mean < 1e-3, "{name}: {photo}");
        }
    }
}

/// A photo whose lens a format cannot carry goes over as a picture without distortion, and the user is told.
#[test]
fn a_distorted_photo_is_handed_over_undistorted() {
    let folder = tempfile::tempdir().unwrap();
    let mut truth: Value = serde_json::from_slice(&fs::read(fixture("truth.json")).unwrap()).unwrap();
    for photo in truth["photos"].as_array_mut().unwrap() {
        photo["distortion"] = serde_json::json!([-0.1, 0.02, 0.0, 0.0, 0.0]);
    }
    fs::write(folder.path().join("in.json"), truth.to_string()).unwrap();
    let photos = fixture("");
    let done = run(folder.path(), &["convert", "in.json", "-o", "out/p.mlp", "--photos", photos.to_str().unwrap()]);
    assert_eq!(done.status, 0, "{}", done.stderr);
    assert!(done.stderr.contains("cannot carry its distortion"), "{}", done.stderr);
    let picture = image::open(folder.path().join("out/undistorted/photo_00.png")).unwrap();
    let size = |key: &str| truth["photos"][0][key].as_u64().unwrap() as u32;
    assert_eq!([picture.width(), picture.height()], [size("width"), size("height")]);
    let project = fs::read_to_string(folder.path().join("out/p.mlp")).unwrap();
    assert!(project.contains("fileName=\"undistorted/photo_00.png\""), "{project}");
}

/// What `pose` writes for other programs names the model and the photos, and its cameras are those of cameras.json; a lens that a
/// format cannot carry makes an undistorted photo beside that format's file alone.
#[test]
fn found_cameras_are_written_for_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let (model, photo, pairs) = (fixture("model.ply"), fixture("photo_00.jpg"), fixture("correspondences.json"));
    let mut truth: Value = serde_json::from_slice(&fs::read(fixture("truth.json")).unwrap()).unwrap();
    for photo in truth["photos"].as_array_mut().unwrap() {
        photo["distortion"] = serde_json::json!([-0.01, 0.0, 0.0, 0.0, 0.0]);
    }
    fs::write(folder.path().join("lens.json"), truth.to_string()).unwrap();
    let mut args: Vec<&std::ffi::OsStr> = vec!["pose".as_ref(), model.as_os_str(), photo.as_os_str()];
    args.extend(["--pairs".as_ref(), pairs.as_os_str(), "--camera".as_ref(), "lens.json".as_ref()]);
    args.extend(["--format", "meshlab,colmap,nerfstudio", "-o", "out", "--json"].map(AsRef::<std::ffi::OsStr>::as_ref));
    let done = run(folder.path(), &args);
    assert_eq!(done.status, 0, "{}", done.stderr);
    assert_eq!(done.stderr.matches("cannot carry").count(), 1, "{}", done.stderr);
    let said: Value = serde_json::from_str(&done.stdout).unwrap();
    assert_eq!(said["formats"].as_array().unwrap().len(), 3);
    let out = folder.path().join("out");
    let project = fs::read_to_string(out.join("meshlab/project.mlp")).unwrap();
    assert!(project.contains("fileName=\"undistorted/photo_00.png\"") && project.contains("model.ply"), "{project}");
    assert!(out.join("meshlab/undistorted/photo_00.png").is_file());
    let found: Value = serde_json::from_slice(&fs::read(out.join("cameras.json")).unwrap()).unwrap();
    for name in ["meshlab/project.mlp", "colmap", "nerfstudio/transforms.json"] {
        assert!(name.starts_with("meshlab") || !out.join(name).join("undistorted").exists());
        let input = format!("out/{name}");
        let back = run(folder.path(), &["convert", &input, "-o", "back.json"]);
        assert_eq!(back.status, 0, "{name}: {}", back.stderr);
        let back: Value = serde_json::from_slice(&fs::read(folder.path().join("back.json")).unwrap()).unwrap();
        for i in 0..3 {
            let [a, b] = [&found, &back].map(|file| file["photos"][0]["T"][i].as_f64().unwrap());
            assert!((a - b).abs() < 1e-6, "{name}: {a} {b}");
        }
    }
}

/// `register` does the same with what it found.
#[test]
fn registered_cameras_are_written_for_other_programs() {
    let folder = tempfile::tempdir().unwrap();
    let [model, photo, initial, truth] = ["model.ply", "photo_00.jpg", "initial.json", "truth.json"].map(fixture);
    let mut args: Vec<&std::ffi::OsStr> = vec!["register".as_ref(), model.as_os_str(), photo.as_os_str()];
    args.extend(["--init".as_ref(), initial.as_os_str(), "--camera".as_ref(), truth.as_os_str()]);
    args.extend(["--format", "meshlab,colmap", "-o", "out"].map(AsRef::<std::ffi::OsStr>::as_ref));
    let done = run(folder.path(), &args);
    assert_eq!((done.status, done.stderr.as_str()), (0, ""), "{}", done.stdout);
    for name in ["out/meshlab/project.mlp", "out/colmap"] {
        let back = run(folder.path(), &["convert", name, "-o", "back.json"]);
        assert_eq!(back.status, 0, "{name}: {}", back.stderr);
        let truth = truth.to_str().unwrap();
        let scores = ["back.json", "out/cameras.json"].map(|cameras| {
            let score = run(folder.path(), &["evaluate", cameras, "--truth", truth, "--json"]);
            let score: Value = serde_json::from_str(&score.stdout).unwrap();
            score["photos"][0]["mean_px"].as_f64().unwrap()
        });
        assert!(scores[1] < 1.0 && (scores[0] - scores[1]).abs() < 1e-6, "{name}: {scores:?}");
    }
    let project = fs::read_to_string(folder.path().join("out/meshlab/project.mlp")).unwrap();
    assert!(project.contains("photo_00.jpg") && project.contains("model.ply"), "{project}");
}

/// Broken files of every format: one line that names the file, the line or byte and the field, and nothing is written.
#[test]
fn broken_files_are_told_with_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let truth = fixture("truth.json");
    let truth = truth.to_str().unwrap();
    let at = |name: &str| folder.path().join(name);
    for name in ["p.mlp", "b.out", "m.xml", "transforms.json", "cameras.json"] {
        assert_eq!(run(folder.path(), &["convert", truth, "-o", name]).status, 0, "{name}");
    }
    for name in ["colmap", "colmap-binary"] {
        assert_eq!(run(folder.path(), &["convert", truth, "-o", name, "--to", name]).status, 0, "{name}");
    }
    let refused = |input: &str, file: &str, change: &dyn Fn(&mut Vec<u8>), words: &[&str]| {
        let whole = fs::read(at(file)).unwrap();
        let mut bytes = whole.clone();
        change(&mut bytes);
        assert_ne!(bytes, whole, "{file}: {words:?}");
        fs::write(at(file), bytes).unwrap();
        let done = run(folder.path(), &["convert", input, "-o", "out.json"]);
        fs::write(at(file), whole).unwrap();
        assert_eq!((done.status, done.stderr.lines().count()), (1, 1), "{file}: {done:?}");
        let file = Path::new(file).file_name().unwrap().to_str().unwrap();
        for word in [file].iter().chain(words) {
            assert!(done.stderr.contains(word), "no '{word}' in: {}", done.stderr);
        }
        assert!(!at("out.json").exists());
    };
    let text = |from: &'static str, to: &'static str| {
        move |bytes: &mut Vec<u8>| {
            let text = String::from_utf8(std::mem::take(bytes)).unwrap();
            *bytes = text.replacen(from, to, 1).into_bytes();
        }
    };
    let row = |line: usize, new: &'static str| {
        move |bytes: &mut Vec<u8>| {
            let text = String::from_utf8(std::mem::take(bytes)).unwrap();
            let rows: Vec<&str> =
                text.lines().enumerate().map(|(i, old)| if i + 1 == line { new } else { old }).collect();
            *bytes = rows.join("\n").into_bytes();
        }
    };
    refused("p.mlp", "p.mlp", &text("<RasterGroup>", "<RasterGroup"), &["line", "not well-formed XML"]);
    refused("p.mlp", "p.mlp", &text("RotationMatrix=\"", "RotationMatrix=\"0 0 0 "), &["line 7", "RotationMatrix"]);
    refused("m.xml", "m.xml", &text("</sensors>", ""), &["line", "not well-formed XML"]);
    refused("m.xml", "m.xml", &text("type=\"frame\"", "type=\"spherical\""), &["line 5", "field type", "spherical"]);
    let mirrored = row(24, "<transform>1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1</transform>");
    refused("m.xml", "m.xml", &mirrored, &["line 24", "photo_00.jpg", "field transform", "mirrors"]);
    refused("b.out", "b.out", &row(3, "100 0 zero"), &["line 3", "photo_00.jpg", "f k1 k2"]);
    refused("b.out", "b.out", &row(4, "0 0 0"), &["line 6", "photo_00.jpg", "field R", "not a rotation"]);
    let zero = "1 0 0 0 0 1 2 3 1 photo_00.jpg";
    refused("colmap", "colmap/images.txt", &row(4, zero), &["line 4", "photo_00.jpg", "QW QX QY QZ", "norm zero"]);
    refused("colmap", "colmap/cameras.txt", &text("PINHOLE", "FOV"), &["line 3", "field MODEL", "not supported"]);
    let zero = |bytes: &mut Vec<u8>| bytes[12..44].fill(0);
    refused("colmap-binary", "colmap-binary/images.bin", &zero, &["byte 8", "photo_00.jpg", "norm zero"]);
    let fisheye = |bytes: &mut Vec<u8>| bytes[12] = 5;
    refused("colmap-binary", "colmap-binary/cameras.bin", &fisheye, &["byte", "camera 1", "MODEL", "not supported"]);
    let cut = |bytes: &mut Vec<u8>| bytes.truncate(30);
    refused("colmap-binary", "colmap-binary/images.bin", &cut, &["byte 28", "too early"]);
    let kind = text("\"OPENCV\"", "\"EQUIRECTANGULAR\"");
    refused("transforms.json", "transforms.json", &kind, &["line 2", "camera_model", "EQUIRECTANGULAR"]);
    let no_focal = text("\"fl_x\"", "\"fl\"");
    refused("transforms.json", "transforms.json", &no_focal, &["line 4", "photo_00.jpg", "fl_x", "missing"]);
    refused("transforms.json", "transforms.json", &|bytes| bytes.truncate(200), &["not JSON", "line"]);
    let short = text("\"R\": [[", "\"R\": [[2, 3], [");
    refused("cameras.json", "cameras.json", &short, &["line", "photo_00.jpg", "field R"]);
}

#[test]
fn an_unknown_format_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let truth = fixture("truth.json");
    let done = run(folder.path(), &["convert", truth.to_str().unwrap(), "-o", "cameras.abc"]);
    assert_eq!(done.status, 1);
    assert!(done.stderr.contains("cameras.abc") && done.stderr.contains("--to"), "{}", done.stderr);
}

/// What the programs themselves make of our files, where they are installed; `TEXREG_PYTHON` names the Python that has them.
#[test]
fn other_programs_agree() {
    let python = std::env::var("TEXREG_PYTHON").unwrap_or_else(|_| "python3".into());
    let has_numpy =
        Command::new(&python).args(["-c", "import numpy"]).output().is_ok_and(|output| output.status.success());
    if !has_numpy {
        eprintln!("skipped: {python} has no numpy, so no program's reading of our files can be checked");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/programs.py");
    let output = Command::new(&python)
        .args([script.as_os_str(), env!("CARGO_BIN_EXE_texreg").as_ref(), folder.path().as_os_str()])
        .env("QT_QPA_PLATFORM", "offscreen")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
    eprintln!("{said}");
}
