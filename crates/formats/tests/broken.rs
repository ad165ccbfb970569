//! What is said of files that are broken: the file, the line or photo, the field; and that no bytes make a reader panic.

use std::fs;

use proptest::prelude::*;
use texreg_camera::{Camera, View};
use texreg_formats::{CameraEntry, CameraFile, Format, Scene, read_lenses};
use texreg_lie::Pose;

/// A file of a format with one photo, in a folder of its own; a folder's first file for COLMAP.
fn good(format: Format) -> (tempfile::TempDir, std::path::PathBuf, String) {
    let folder = tempfile::tempdir().unwrap();
    let view = View { camera: Camera::ideal(640, 480, 500.0), pose: Pose::identity() };
    let cameras = CameraFile { photos: vec![CameraEntry::new("a.jpg", &view)], ..CameraFile::default() };
    let scene = Scene { cameras, ..Scene::default() };
    let name = match format {
        Format::MeshLab => "p.mlp",
        Format::Bundler => "b.out",
        Format::Metashape => "m.xml",
        Format::Nerfstudio => "transforms.json",
        Format::Colmap => "images.txt",
        Format::ColmapBinary => "images.bin",
        _ => "cameras.json",
    };
    let path = folder.path().join(name);
    let target = if format.to_string().starts_with("colmap") { folder.path().to_owned() } else { path.clone() };
    format.write(&target, &scene).unwrap();
    let text = String::from_utf8_lossy(&fs::read(&path).unwrap()).into_owned();
    (folder, path, text)
}

/// Checks that a file with `from` replaced by `to` is refused with all of `words`, in one line.
fn check(format: Format, from: &str, to: &str, words: &[&str]) {
    let (_folder, path, text) = good(format);
    assert!(text.contains(from), "{format}: {from} is not in {text}");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
    let error = format.read(&path).expect_err("a broken file").to_string();
    assert!(!error.contains('\n'), "{error}");
    let file = path.file_name().unwrap().to_str().unwrap();
    for word in [file].iter().chain(words) {
        assert!(error.contains(word), "'{error}' does not say '{word}'");
    }
}

#[test]
fn meshlab() {
    let check = |from: &str, to: &str, words: &[&str]| check(Format::MeshLab, from, to, words);
    check("<RasterGroup>", "<RasterGroup", &["line 6", "not well-formed"]);
    check("MeshLabProject>", "Project>", &["not well-formed"]);
    check("FocalMm=\"3.90625\"", "FocalMm=\"far\"", &["line 7", "FocalMm", "'far'"]);
    check("FocalMm=\"3.90625\" ", "", &["line 7", "FocalMm"]);
    check("CameraType=\"0\"", "CameraType=\"1\"", &["line 7", "a.jpg", "CameraType"]);
    check("RotationMatrix=\"1 ", "RotationMatrix=\"-1 ", &["line 7", "RotationMatrix", "mirrors"]);
    check("RotationMatrix=\"1 ", "RotationMatrix=\"2 ", &["line 7", "RotationMatrix", "not a rotation"]);
}

#[test]
fn colmap() {
    let check = |from: &str, to: &str, words: &[&str]| check(Format::Colmap, from, to, words);
    check("1 1 0 0 0 ", "1 0 0 0 0 ", &["line 4", "a.jpg", "QW QX QY QZ", "norm zero"]);
    check("1 1 0 0 0 ", "1 1 0 x 0 ", &["line 4", "QY"]);
    check(" 1 a.jpg", " 7 a.jpg", &["line 4", "a.jpg", "CAMERA_ID", "camera 7"]);
    check(" 1 a.jpg", " 1", &["line 4", "NAME"]);
    let (folder, path, _) = good(Format::Colmap);
    let cameras = folder.path().join("cameras.txt");
    fs::write(&cameras, "# c\n1 OPENCV_FISHEYE 640 480 500 500 320 240 0 0 0 0\n").unwrap();
    let error = Format::Colmap.read(&path).unwrap_err().to_string();
    assert!(error.contains("cameras.txt: line 2: field MODEL"), "{error}");
    let (_folder, path, _) = good(Format::ColmapBinary);
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..40]).unwrap();
    let error = Format::ColmapBinary.read(&path).unwrap_err().to_string();
    assert!(error.contains("images.bin: byte 36"), "{error}");
}

#[test]
fn others() {
    check(Format::Bundler, "500 0 0", "500 0", &["line 3", "a.jpg", "f k1 k2"]);
    check(Format::Bundler, "1 0\n", "9 0\n", &["line 2", "has 9 cameras", "names 1"]);
    check(Format::Bundler, "0 -1 0", "0 1 0", &["line 6", "a.jpg", "field R", "mirrors"]);
    check(Format::Metashape, "sensor_id=\"0\"", "sensor_id=\"3\"", &["line 23", "a.jpg", "sensor 3"]);
    check(Format::Metashape, "type=\"frame\"", "type=\"fisheye\"", &["line 5", "fisheye"]);
    check(Format::Metashape, "<transform>1 0", "<transform>1 one", &["line 24", "a.jpg", "transform"]);
    check(Format::Nerfstudio, "\"OPENCV\"", "\"OPENCV_FISHEYE\"", &["line 2", "camera_model", "OPENCV_FISHEYE"]);
    check(Format::Nerfstudio, "\"fl_x\": 500.0", "\"fl_x\": \"far\"", &["line 34", "a.jpg", "fl_x"]);
    check(Format::Texreg, "500.0", "-1", &["line 7", "a.jpg", "K"]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Bytes changed, cut or put in anywhere lead to an error or to a file that is read, never to a panic.
    #[test]
    fn no_bytes_make_a_reader_panic(
        which in 0..7usize, at in any::<prop::sample::Index>(), put in prop::collection::vec(any::<u8>(), 0..12), cut in 0..40usize
    ) {
        let format = [
            Format::Texreg, Format::MeshLab, Format::Colmap, Format::ColmapBinary, Format::Bundler, Format::Metashape,
            Format::Nerfstudio,
        ][which];
        let (_folder, path, _) = good(format);
        let mut bytes = fs::read(&path).unwrap();
        let start = at.index(bytes.len());
        bytes.splice(start..(start + cut).min(bytes.len()), put);
        fs::write(&path, bytes).unwrap();
        let _ = format.read(&path);
        let _ = read_lenses(&path);
    }
}
