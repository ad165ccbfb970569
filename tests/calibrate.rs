//! Calibrations through the binary: on boards drawn here, on a rendered board, and as the first step of a registration.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{Run, fixture, run};
use image::{GrayImage, Luma};
use nalgebra::{Matrix3, Point2, Point3, Rotation3, Vector3};
use serde_json::Value;
use texreg::camera::{Camera, Distortion, Intrinsics};

/// Draws a board of 7 × 5 inner corners, turned about x, y and z, as seen by a camera with the focal length 500.
fn draw(path: &Path, [width, height]: [u32; 2], [x, y, z]: [f64; 3], depth: f64) {
    let (columns, rows) = (7.0, 5.0);
    let rotation = Rotation3::from_euler_angles(x, y, z);
    let r = rotation.matrix();
    let middle = r * Vector3::new((columns - 1.0) / 2.0, (rows - 1.0) / 2.0, 0.0);
    let t = Vector3::new(0.0, 0.0, depth) - middle;
    let k = Matrix3::new(
        500.0,
        0.0,
        0.5 * f64::from(width) - 0.5,
        0.0,
        500.0,
        0.5 * f64::from(height) - 0.5,
        0.0,
        0.0,
        1.0,
    );
    let board_from_pixel =
        (k * Matrix3::from_columns(&[r.column(0).into(), r.column(1).into(), t])).try_inverse().unwrap();
    let value = |u: f64, v: f64| {
        let p = board_from_pixel * Vector3::new(u, v, 1.0);
        let (x, y) = (p.x / p.z, p.y / p.z);
        let on = x > -1.0 && y > -1.0 && x < columns && y < rows;
        if on && (x.floor() + y.floor()).rem_euclid(2.0) == 0.0 { 30.0 } else { 210.0 }
    };
    let picture = GrayImage::from_fn(width, height, |u, v| {
        let steps = [-0.6, -0.3, 0.0, 0.3, 0.6];
        let sum: f64 = steps.iter().flat_map(|y| steps.map(|x| value(f64::from(u) + x, f64::from(v) + y))).sum();
        Luma([(sum / 25.0).round() as u8])
    });
    picture.save(path).unwrap();
}

/// A folder with five photos of the board, two that face it, one of another size and one of nothing.
fn boards() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let size = [480, 360];
    let turned = [[0.5, 0.1, 0.1], [-0.5, 0.2, 0.0], [0.1, 0.5, 0.2], [0.0, -0.5, -0.1], [0.3, 0.3, 0.4]];
    for (i, turn) in turned.into_iter().enumerate() {
        draw(&folder.path().join(format!("board_{i}.png")), size, turn, 12.0);
    }
    for (i, depth) in [11.0, 12.5, 14.0].into_iter().enumerate() {
        draw(&folder.path().join(format!("facing_{i}.png")), size, [0.0, 0.0, 0.05], depth);
    }
    draw(&folder.path().join("larger.png"), [640, 480], [0.2, 0.4, 0.1], 12.0);
    GrayImage::from_fn(480, 360, |x, y| Luma([(x / 4 + y / 4) as u8])).save(folder.path().join("nothing.png")).unwrap();
    folder
}

fn run_in(folder: &Path, command: &str) -> Run {
    run(folder, &command.split_whitespace().collect::<Vec<_>>())
}

fn read(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// The camera a `camera.json` states.
fn camera(file: &Value) -> Camera {
    let k = |key: &str| number(&file["K"][key]);
    let c: Vec<f64> = file["distortion"].as_array().unwrap().iter().map(number).collect();
    Camera {
        width: file["width"].as_u64().unwrap() as u32,
        height: file["height"].as_u64().unwrap() as u32,
        intrinsics: Intrinsics { fx: k("fx"), fy: k("fy"), cx: k("cx"), cy: k("cy"), skew: k("skew") },
        distortion: Distortion { k1: c[0], k2: c[1], p1: c[2], p2: c[3], k3: c[4] },
    }
}

/// The folder of a larger case, outside the repository, if it is there.
fn case(name: &str) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found = here.ancestors().map(|up| up.join("shared/cases").join(name)).find(|path| path.is_dir());
    if found.is_none() {
        println!("skipped: no shared/cases/{name} above the repository");
    }
    found
}

/// The photos of a case, as words of a command.
fn photos(case: &Path) -> String {
    let mut photos: Vec<String> =
        fs::read_dir(case).unwrap().map(|entry| entry.unwrap().path().display().to_string()).collect();
    photos.retain(|path| path.ends_with(".jpg"));
    photos.sort();
    photos.join(" ")
}

/// A name that ends in .yml makes a calibration of OpenCV's, which serves as --camera.
#[test]
fn a_calibration_is_written_for_opencv() {
    let folder = boards();
    for name in ["cam.yml", "camera.json"] {
        let images = "board_0.png board_1.png board_2.png board_3.png board_4.png";
        let run = run_in(folder.path(), &format!("calibrate {images} --board 7x5 --square 20 -o {name}"));
        assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    }
    let text = fs::read_to_string(folder.path().join("cam.yml")).unwrap();
    assert!(text.starts_with("%YAML:1.0\n---\nimage_width: 480\nimage_height: 360\ncamera_matrix: !!opencv-matrix\n"));
    let numbers = |name: &str| -> Vec<f64> {
        let data = text.split_once(name).unwrap().1.split(['[', ']']).nth(1).unwrap();
        data.split(',').map(|number| number.trim().parse().unwrap()).collect()
    };
    let camera = camera(&read(&folder.path().join("camera.json")));
    let k = numbers("camera_matrix");
    assert_eq!([k[0], k[4], k[2], k[5], k[1]], camera.intrinsics.to_array());
    assert_eq!(numbers("distortion_coefficients"), camera.distortion.to_array());
    let yaml = fs::read(folder.path().join("cam.yml")).unwrap();
    fs::write(folder.path().join("bad.yml"), String::from_utf8(yaml).unwrap().replace("cols: 3", "cols: [3")).unwrap();
    for (name, words) in [("bad.yml", "is not YAML"), ("gone.yml", "cannot be read")] {
        let command = format!("pose @model.ply @photo_00.jpg --pairs @correspondences.json --camera {name}");
        let words = [name, words];
        let args: Vec<_> = command.split(' ').map(|word| word.strip_prefix('@').map_or(word.into(), fixture)).collect();
        let run = run(folder.path(), &args);
        assert!(run.status == 1 && words.iter().all(|word| run.stderr.contains(word)), "{run:?}");
    }
}

#[test]
fn a_drawn_board_gives_its_camera_a_report_and_pictures() {
    let folder = boards();
    let images = "board_0.png board_1.png board_2.png board_3.png board_4.png";
    let command =
        format!("calibrate {images} --board 7x5 --square 20 --model pinhole -o lens/camera.json --debug seen");
    let run = run_in(folder.path(), &command);
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    assert!(run.stdout.contains("over 5 of 5 photos; see lens/camera.html"), "{run:?}");
    let file = read(&folder.path().join("lens/camera.json"));
    let found = camera(&file);
    let truth = [500.0, 500.0, 239.5, 179.5];
    for (value, truth) in found.intrinsics.to_array().into_iter().zip(truth) {
        assert!((value - truth).abs() < 0.5, "{value}, not {truth}");
    }
    assert!(found.distortion.is_none() && number(&file["rms_px"]) < 0.1, "{file}");
    assert_eq!(file["boards"].as_array().unwrap().len(), 5);
    assert_eq!(file["boards"][0]["corners"], 35);
    // Poses are in the square's unit.
    assert!((number(&file["boards"][0]["T"][2]) - 240.0).abs() < 60.0, "{}", file["boards"][0]);
    let report = fs::read_to_string(folder.path().join("lens/camera.html")).unwrap();
    assert!(report.contains("5 photos are few") && report.contains("<svg") && report.contains("Coverage"));
    assert!(!report.contains("<script") && !report.contains("http"), "the report stands alone");
    assert_eq!(report.matches("data:image/jpeg;base64,").count(), 5);
    let picture = image::open(folder.path().join("seen/board_0.png.jpg")).unwrap().to_rgb8();
    let coloured = picture.pixels().filter(|p| p.0.iter().max().unwrap() - p.0.iter().min().unwrap() > 80).count();
    assert!(picture.dimensions() == (480, 360) && coloured > 500, "corners are drawn: {coloured}");
}

#[test]
fn photos_without_a_board_are_named_and_the_rest_is_used() {
    let folder = boards();
    let images = "board_0.png nothing.png board_1.png board_2.png board_3.png";
    let run = run_in(folder.path(), &format!("calibrate {images} --board 7x5 --square 20 --json"));
    assert_eq!(run.status, 3, "{run:?}");
    let object: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(object["boards"][1]["status"], "no board");
    assert_eq!(object["boards"][2]["status"], "used");
    assert_eq!((&object["camera"], &object["report"]), (&"camera.json".into(), &"camera.html".into()));
}

#[test]
fn what_makes_no_calibration_is_said_in_one_line() {
    let folder = boards();
    let fails = |images: &str, board: &str, words: &[&str]| {
        let run = run_in(folder.path(), &format!("calibrate {images} --board {board} --square 20 -o no.json"));
        assert_eq!((run.status, run.stdout.as_str()), (1, ""), "{run:?}");
        assert!(run.stderr.starts_with("error: ") && run.stderr.trim_end().lines().count() == 1, "{run:?}");
        for word in words {
            assert!(run.stderr.contains(word), "{word:?} is not in {}", run.stderr);
        }
        assert!(!folder.path().join("no.json").exists() && !folder.path().join("no.html").exists());
    };
    let all = "board_0.png board_1.png board_2.png board_3.png";
    fails("board_0.png nothing.png board_1.png", "7x5", &["2 photos", "at least 3", "no board in nothing.png"]);
    fails("facing_0.png facing_1.png facing_2.png", "7x5", &["parallel to the image", "tilt the board"]);
    fails("board_0.png larger.png board_1.png", "7x5", &["larger.png", "640 × 480", "board_0.png", "480 × 360"]);
    fails("nothing.png", "7x5", &["nothing.png", "no photo shows a board of 7x5"]);
    let bust = fixture("photo_00.jpg").display().to_string();
    fails(&bust, "7x5", &["photo_00.jpg", "no photo shows a board"]);
    fails("nothing.png missing.png", "7x5", &["missing.png", "no such file"]);
    for wrong in ["8x6", "6x4", "9x5", "7x7"] {
        fails(all, wrong, &["7x5 inner corners", wrong, "--board 7x5"]);
    }
}

#[test]
fn wrong_usage_is_told() {
    let folder = tempfile::tempdir().unwrap();
    for (options, word) in [
        ("--board 9 --square 1", "9x6"),
        ("--board 1x5 --square 1", "from 2 to 200"),
        ("--board 9x6 --square 0", "above zero"),
        ("--board 9x6", "--square"),
        ("--board 9x6 --square 1 --model fisheye", "brown5"),
    ] {
        let run = run_in(folder.path(), &format!("calibrate photo.png {options}"));
        assert!(run.status == 2 && run.stderr.contains(word), "{run:?}");
    }
}

#[test]
fn a_rendered_board_gives_the_true_camera() {
    let Some(case) = case("lion_board") else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path(), &format!("calibrate {} --board 9x6 --square 0.03", photos(&case)));
    assert_eq!(run.status, 0, "{run:?}");
    let found = camera(&read(&folder.path().join("camera.json")));
    let truth = camera(&read(&case.join("truth.json"))["photos"][0]);
    let (k, true_k) = (found.intrinsics, truth.intrinsics);
    assert!((k.fx / true_k.fx - 1.0).abs() < 1e-3 && (k.fy / true_k.fy - 1.0).abs() < 1e-3, "{k:?}");
    assert!(Point2::new(k.cx - true_k.cx, k.cy - true_k.cy).coords.norm() < 1.0, "{k:?}");
    // The effect of the distortion, through the true camera matrix, over the whole image.
    let distorted = Camera { intrinsics: true_k, ..found };
    for (u, v) in (0..=12).flat_map(|i| (0..=9).map(move |j| (100.0 * f64::from(i), 100.0 * f64::from(j)))) {
        let pixel = Point2::new(u, v);
        let ray = truth.unproject(&pixel).unwrap();
        let off = distorted.project(&Point3::from(ray)).unwrap() - pixel;
        assert!(off.norm() < 0.3, "{off:?} at {pixel}");
    }
}

/// The whole of the thesis' Algorithm 2: calibrate with a pattern, then register.
#[test]
fn a_calibrated_camera_registers_better() {
    let (Some(board), Some(lion)) = (case("lion_board"), case("lion_multiview8")) else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = run_in(folder.path(), &format!("calibrate {} --board 9x6 --square 0.03", photos(&board)));
    assert_eq!(run.status, 0, "{run:?}");
    let lion = lion.display();
    let errors = |camera: &str, out: &str| -> Vec<f64> {
        let photos = format!("{lion}/photo_00.jpg {lion}/photo_03.jpg");
        let pairs = format!("{lion}/correspondences.json");
        run_in(
            folder.path(),
            &format!("register {lion}/model.ply {photos} --pairs {pairs} --camera {camera} -o {out}"),
        );
        let run = run_in(folder.path(), &format!("evaluate {out}/cameras.json --truth {lion}/truth.json --json"));
        let object: Value = serde_json::from_str(&run.stdout).unwrap();
        let rows = object["photos"].as_array().unwrap();
        rows.iter().filter(|row| row["missing"] != true).map(|row| number(&row["mean_px"])).collect()
    };
    let calibrated = errors("camera.json", "calibrated");
    let nominal = errors(&format!("{lion}/initial.json"), "nominal");
    assert_eq!((calibrated.len(), nominal.len()), (2, 2));
    for (with, without) in calibrated.iter().zip(&nominal) {
        assert!(with < without && *with < 1.5, "{with} px with the calibrated camera, {without} px without");
    }
}
