//! The JSON files: round trips, defaults, and what is said of broken ones.

use std::fs;
use std::path::PathBuf;

use nalgebra::{Point3, Rotation3, Vector3};
use serde_json::json;
use texreg_camera::{Camera, Distortion, View};
use texreg_formats::{
    CameraEntry, CameraFile, LensFile, read_cameras, read_lenses, read_pairs, write_atomic, write_cameras,
};
use texreg_lie::Pose;

fn view() -> View {
    let mut camera = Camera::ideal(640, 480, 512.25);
    camera.intrinsics.skew = 0.1;
    camera.distortion = Distortion::from([0.1, -0.02, 1e-4, -3e-5, 0.004]);
    let rotation = Rotation3::from_scaled_axis(Vector3::new(0.3, -1.2, 2.0));
    View { camera, pose: Pose::new(rotation, Vector3::new(0.1, 1.0 / 3.0, 4e6)) }
}

/// Writes `text` to a file and gives back its folder (which lives as long as it is held) and path.
fn file(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.json");
    fs::write(&path, text).unwrap();
    (folder, path)
}

#[test]
fn cameras_read_back_as_they_were_written() {
    let (_folder, path) = file("");
    let mut entry = CameraEntry::new("photo.jpg", &view());
    entry.other.insert("status".into(), json!("registered"));
    let other = json!({"case": "bust"}).as_object().cloned().unwrap();
    write_cameras(&path, &CameraFile { photos: vec![entry], other }).unwrap();
    let read = read_cameras(&path).unwrap();
    assert_eq!(read.other["case"], "bust");
    assert_eq!(read.photos[0].other["status"], "registered");
    let got = read.entry("photo.jpg").unwrap().view([640, 480]);
    assert_eq!(got.camera, view().camera);
    assert_eq!(got.pose.translation, view().pose.translation);
    assert!(got.pose.rotation.angle_to(&view().pose.rotation) < 1e-15);
}

#[test]
fn what_is_left_out_takes_its_value_from_the_photo() {
    let (_folder, path) = file(r#"{"K": {"fx": 700}}"#);
    let LensFile::Shared(lens) = read_lenses(&path).unwrap() else { panic!("one lens for all photos") };
    assert_eq!(lens.camera([101, 51]), Camera::ideal(101, 51, 700.0));
    let (_folder, path) = file(
        r#"{"photos": [{"file": "in/a.jpg", "K": [[700, 2, 49], [0, 710, 26], [0, 0, 1]], "distortion": [0.1]}]}"#,
    );
    let lenses = read_lenses(&path).unwrap();
    let camera = lenses.lens("a.jpg").unwrap().camera([101, 51]);
    let k = camera.intrinsics;
    assert_eq!([k.fx, k.fy, k.cx, k.cy, k.skew], [700.0, 710.0, 49.0, 26.0, 2.0]);
    assert_eq!(camera.distortion.to_array(), [0.1, 0.0, 0.0, 0.0, 0.0]);
    assert!(lenses.lens("b.jpg").is_none());
}

#[test]
fn rotations_are_made_orthogonal_or_refused() {
    let entry = |r: &str| format!(r#"{{"photos": [{{"file": "a.jpg", "K": {{"fx": 1}}, "R": {r}, "T": [0, 0, 1]}}]}}"#);
    let (_folder, path) = file(&entry("[[1, 0, 0.0004], [0, 1, 0], [0, 0, 1]]"));
    let r = read_cameras(&path).unwrap().photos[0].pose.rotation;
    assert!((r.matrix() * r.matrix().transpose() - nalgebra::Matrix3::identity()).amax() < 1e-15);
    for (rows, cause) in [
        ("[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", "mirrors"),
        ("[[2, 0, 0], [0, 1, 0], [0, 0, 1]]", "not a rotation"),
        ("[[0, 0, 0], [0, 0, 0], [0, 0, 0]]", "not a rotation"),
        ("[[1, 0, 0], [0, 1, 0]]", "field R"),
    ] {
        let (_folder, path) = file(&entry(rows));
        let error = read_cameras(&path).unwrap_err().to_string();
        assert!(error.contains("photo a.jpg") && error.contains(cause), "{error}");
    }
}

#[test]
fn a_mistake_is_told_with_file_photo_and_field() {
    let photo = r#"{"file": "a.jpg", "K": {"fx": 1}, "R": [[1,0,0],[0,1,0],[0,0,1]], "T": [0, 0, 1]}"#;
    for (text, places) in [
        ("", vec!["not JSON"]),
        ("[]", vec!["no JSON object"]),
        ("{}", vec!["field photos"]),
        (r#"{"photos": [{}]}"#, vec!["photo number 1", "field file"]),
        (&format!(r#"{{"photos": [{photo}, {{"file": "b.jpg"}}]}}"#), vec!["photo b.jpg", "field K"]),
        (&format!(r#"{{"photos": [{}]}}"#, photo.replace(r#""fx": 1"#, r#""fx": "1""#)), vec!["a.jpg", "field K.fx"]),
        (
            &format!(r#"{{"photos": [{}]}}"#, photo.replace(r#""fx": 1"#, r#""fx": 0"#)),
            vec!["a.jpg", "field K", "positive"],
        ),
        (&format!(r#"{{"photos": [{}]}}"#, photo.replace("0, 0, 1]}", "0, null, 1]}")), vec!["a.jpg", "field T[1]"]),
        (&format!(r#"{{"photos": [{}]}}"#, photo.replace("0, 0, 1]}", "0, NaN, 1]}")), vec!["not JSON"]),
    ] {
        let (_folder, path) = file(text);
        let error = read_cameras(&path).unwrap_err().to_string();
        assert!(error.starts_with(&path.display().to_string()), "{error}");
        assert!(!error.contains('\n'), "{error}");
        assert!(places.iter().all(|place| error.contains(place)), "{error}");
    }
}

#[test]
fn pairs_are_read_in_their_order() {
    let (_folder, path) = file(
        r#"{"note": 1, "photos": [{"file": "a.jpg", "points": [{"xyz": [1, 2, 3], "uv": [4, 5.5]}, {"xyz": [6, 7, 8], "uv": [9, 10]}]}]}"#,
    );
    let pairs = read_pairs(&path).unwrap();
    assert_eq!(pairs[0].file, "a.jpg");
    assert_eq!(pairs[0].points[1].point, Point3::new(6.0, 7.0, 8.0));
    assert_eq!(pairs[0].points[0].pixel, nalgebra::Point2::new(4.0, 5.5));
    let (_folder, path) = file(r#"{"photos": [{"file": "a.jpg", "points": [{"xyz": [1, 2, 3], "uv": [4]}]}]}"#);
    let error = read_pairs(&path).unwrap_err().to_string();
    assert!(error.contains("photo a.jpg, field points[0].uv"), "{error}");
}

#[test]
fn a_write_that_fails_leaves_the_old_file_and_no_other() {
    let (folder, path) = file("old");
    write_atomic(&path, b"new").unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"new");
    // A folder in the way cannot be replaced by a file.
    let taken = folder.path().join("taken");
    fs::create_dir_all(taken.join("inside")).unwrap();
    let error = write_atomic(&taken, b"new").unwrap_err().to_string();
    assert!(error.contains("taken") && error.contains("cannot be written"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}
