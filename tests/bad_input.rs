//! Bad input: each a one-line error that names the file and says what to do, and the exit status the README states.

mod common;
#[path = "../crates/surface/tests/scans/mod.rs"]
mod scans;

use std::fs;
use std::path::PathBuf;

use common::{Run, fixture, run};
use scans::{ScanPoint, e57, las};
use serde_json::{Value, json};

/// A folder with a small model, a photo of nothing, and files about it, to be broken one at a time.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self { folder: tempfile::tempdir().unwrap() };
        bench.put("model.ply", TETRAHEDRON);
        image::RgbImage::from_fn(160, 120, |x, y| image::Rgb([x as u8, y as u8, 90]))
            .save(bench.path("photo.png"))
            .unwrap();
        bench.put("camera.json", r#"{"width": 160, "height": 120, "K": {"fx": 150}}"#);
        bench.put_json("init.json", &cameras([0.0, 0.0, 5.0]));
        bench.put_json("pairs.json", &pairs("photo.png", 6));
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    fn put_json(&self, name: &str, value: &Value) {
        self.put(name, value.to_string());
    }

    /// Runs a command whose words are separated by spaces, in this folder.
    fn run(&self, command: &str) -> Run {
        run(self.folder.path(), &command.split(' ').collect::<Vec<_>>())
    }

    fn register(&self) -> Run {
        self.run("register model.ply photo.png --init init.json -o out")
    }

    fn register_pairs(&self) -> Run {
        self.run("register model.ply photo.png --pairs pairs.json --camera camera.json -o out")
    }
}

const TETRAHEDRON: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    element face 4\nproperty list uchar int vertex_indices\nend_header\n\
    1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n";

fn cameras(t: [f64; 3]) -> Value {
    json!({"photos": [{"file": "photo.png", "width": 160, "height": 120, "K": {"fx": 150},
        "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": t}]})
}

fn pairs(photo: &str, count: usize) -> Value {
    let corners = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0], [1, 0, 0]];
    let pair = |[x, y, z]: [i32; 3]| {
        let depth = f64::from(z) + 5.0;
        json!({"xyz": [x, y, z], "uv": [79.5 + 150.0 * f64::from(x) / depth, 59.5 + 150.0 * f64::from(y) / depth]})
    };
    let points: Vec<Value> = corners.into_iter().take(count).map(pair).collect();
    json!({"photos": [{"file": photo, "points": points}]})
}

impl Run {
    /// An error in one line with these words in it, exit status 1, and nothing on standard output.
    #[track_caller]
    fn fails_with(&self, words: &[&str]) {
        assert_eq!(self.status, 1, "{self:?}");
        assert_eq!(self.stdout, "", "{self:?}");
        assert!(self.stderr.starts_with("error: ") && self.stderr.trim_end().lines().count() == 1, "{self:?}");
        for word in words {
            assert!(self.stderr.contains(word), "no '{word}' in: {}", self.stderr);
        }
    }
}

#[test]
fn the_bench_itself_is_sound() {
    let bench = Bench::new();
    let run = bench.register_pairs();
    assert!(run.status == 0 || run.status == 3, "{run:?}");
    assert!(bench.path("out/cameras.json").is_file());
}

/// Scans of a wall, each in a file of its format.
fn scans() -> [(&'static str, Vec<u8>); 3] {
    let points: Vec<ScanPoint> = (0..200).map(|i| ScanPoint::grid(i, 20)).collect();
    [("scan.las", las(&points, false)), ("scan.laz", las(&points, true)), ("scan.e57", e57(&points, [0.0; 3]))]
}

#[test]
fn broken_scans() {
    let bench = Bench::new();
    for (name, whole) in scans() {
        let render = |bytes: &[u8]| {
            bench.put(name, bytes);
            bench.run(&format!("render {name} --cameras init.json -o out"))
        };
        assert_eq!(render(&whole).status, 0, "the bench itself is sound");
        for kept in [5, 50, 200, whole.len() / 2, whole.len() - 100] {
            render(&whole[..kept]).fails_with(&[name]);
        }
        let mut other = whole.clone();
        other[..4].copy_from_slice(b"none");
        render(&other).fails_with(&[name]);
        // Any other byte may be one of a coordinate, and then there is a point elsewhere.
        for at in (4..whole.len()).step_by(whole.len() / 40) {
            let mut flipped = whole.clone();
            flipped[at] ^= 0xff;
            let run = render(&flipped);
            if run.status == 0 {
                assert_eq!(run.stderr, "", "{name}, byte {at}");
            } else {
                run.fails_with(&[name]);
            }
        }
    }
}

#[test]
fn too_few_pairs() {
    let bench = Bench::new();
    bench.put_json("pairs.json", &pairs("photo.png", 3));
    bench.register_pairs().fails_with(&["pairs.json", "photo photo.png has 3 pairs", "add pairs"]);
    bench
        .run("pose model.ply photo.png --pairs pairs.json --camera camera.json")
        .fails_with(&["has 3 pairs", "add pairs"]);
}

#[test]
fn a_lens_is_shared_by_photos_of_one_size_and_only_if_it_is_refined() {
    let bench = Bench::new();
    image::RgbImage::from_pixel(80, 60, image::Rgb([90, 90, 90])).save(bench.path("small.png")).unwrap();
    let mut both = cameras([0.0, 0.0, 5.0]);
    let small = json!({"file": "small.png", "K": {"fx": 75}, "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [0, 0, 5]});
    both["photos"].as_array_mut().unwrap().push(small);
    bench.put_json("both.json", &both);
    let command = "register model.ply photo.png small.png --init both.json --share-intrinsics";
    bench.run(&format!("{command} --refine focal -o out")).fails_with(&[
        "small.png",
        "80 × 60",
        "160 × 120",
        "one size",
    ]);
    let run = bench.run(command);
    assert!(run.status == 2 && run.stderr.contains("--refine"), "{run:?}");
}

#[test]
fn pairs_that_fit_no_pose() {
    let bench = Bench::new();
    let mut same = pairs("photo.png", 6);
    for point in same["photos"][0]["points"].as_array_mut().unwrap() {
        point["xyz"] = json!([1, 1, 1]);
    }
    bench.put_json("pairs.json", &same);
    bench.register_pairs().fails_with(&["pairs.json", "photo photo.png", "no pose fits", "check them"]);
}

#[test]
fn files_that_do_not_name_the_photo() {
    let bench = Bench::new();
    bench.put_json("pairs.json", &pairs("other.png", 6));
    bench.register_pairs().fails_with(&[
        "pairs.json",
        "no entry names the photo photo.png",
        "it names other.png",
        "add one",
    ]);
    fs::copy(bench.path("photo.png"), bench.path("second.png")).unwrap();
    let words = ["init.json", "no entry names the photo second.png", "add one"];
    bench.run("register model.ply photo.png second.png --init init.json").fails_with(&words);
    let words = ["cameras.json", "no entry names the photo second.png"];
    bench.put_json("cameras.json", &cameras([0.0; 3]));
    bench.put_json("pairs.json", &pairs("second.png", 6));
    bench.run("register model.ply second.png --pairs pairs.json --camera cameras.json").fails_with(&words);
}

#[test]
fn two_photos_of_one_name() {
    let bench = Bench::new();
    fs::create_dir(bench.path("more")).unwrap();
    fs::copy(bench.path("photo.png"), bench.path("more/photo.png")).unwrap();
    let words = ["more/photo.png", "same name", "rename"];
    bench.run("register model.ply photo.png more/photo.png --init init.json").fails_with(&words);
}

#[test]
fn a_model_without_faces() {
    let bench = Bench::new();
    let lines = TETRAHEDRON.replace("element face 4", "element face 1").split("3 0 1 2").next().unwrap().to_owned();
    bench.put("model.ply", lines + "2 0 1\n");
    bench.register().fails_with(&["model.ply", "no faces", "reconstruct"]);
}

#[test]
fn a_vertex_that_is_not_a_number() {
    let bench = Bench::new();
    bench.put("model.ply", TETRAHEDRON.replace("1 -1 -1\n", "1 nan -1\n"));
    bench.register().fails_with(&["model.ply", "vertex 1", "not finite", "repair"]);
}

#[test]
fn a_face_with_a_vertex_that_is_not_there() {
    let bench = Bench::new();
    bench.put("model.ply", TETRAHEDRON.replace("3 0 3 1", "3 0 4 1"));
    bench.register().fails_with(&["model.ply", "face 1 names vertex 4", "only 4", "export the model again"]);
}

#[test]
fn a_truncated_model() {
    let bench = Bench::new();
    bench.put("model.ply", &TETRAHEDRON[..TETRAHEDRON.len() - 12]);
    bench.register().fails_with(&["model.ply", "export the model again"]);
    let whole = fs::read(fixture("model.ply")).unwrap();
    bench.put("model.ply", &whole[..whole.len() / 2]);
    bench.register().fails_with(&["model.ply", "export the model again"]);
}

#[test]
fn a_model_of_another_format() {
    let bench = Bench::new();
    fs::copy(bench.path("photo.png"), bench.path("model.fbx")).unwrap();
    bench.run("register model.fbx photo.png --init init.json").fails_with(&["model.fbx", "not a PLY, OBJ", "convert"]);
}

#[test]
fn a_photo_that_is_no_image() {
    let bench = Bench::new();
    bench.put("photo.png", "this is no image");
    bench.register().fails_with(&["photo.png", "not a JPEG, PNG or TIFF image", "convert"]);
    bench.put("photo.png", "");
    bench.register().fails_with(&["photo.png", "empty", "copy the photo again"]);
    let whole = fs::read(fixture("photo_00.jpg")).unwrap();
    bench.put("photo.png", &whole[..200]);
    bench.register().fails_with(&["photo.png", "copy or export the photo again"]);
    fs::remove_file(bench.path("photo.png")).unwrap();
    fs::create_dir(bench.path("photo.png")).unwrap();
    bench.register().fails_with(&["photo.png", "is a directory", "check the path"]);
}

#[test]
fn files_that_are_missing() {
    let bench = Bench::new();
    for (command, file) in [
        ("register no.ply photo.png --init init.json -o out", "no.ply"),
        ("register model.ply no.png --init init.json -o out", "no.png"),
        ("register model.ply photo.png --init no.json -o out", "no.json"),
        ("register model.ply photo.png --pairs no.json -o out", "no.json"),
        ("register model.ply photo.png --pairs pairs.json --camera no.json -o out", "no.json"),
        ("render model.ply --cameras no.json -o out", "no.json"),
        ("evaluate no.json --truth init.json", "init.json"),
        ("evaluate init.json --truth no.json", "no.json"),
    ] {
        let word = if file == "init.json" { "bbox_diagonal" } else { "check the path" };
        bench.run(command).fails_with(&[file, word]);
    }
}

#[test]
fn a_model_behind_the_camera_or_outside_the_photo() {
    let bench = Bench::new();
    for t in [[0.0, 0.0, -5.0], [40.0, 0.0, 5.0]] {
        bench.put_json("init.json", &cameras(t));
        bench.register().fails_with(&["init.json", "photo photo.png", "not in sight", "check its pose"]);
    }
}

#[test]
fn no_focal_length() {
    let bench = Bench::new();
    let words = ["photo.png", "no 35 mm focal length", "--camera FILE"];
    bench.run("register model.ply photo.png --pairs pairs.json -o out").fails_with(&words);
}

#[test]
fn a_camera_for_photos_of_another_size() {
    let bench = Bench::new();
    bench.put("camera.json", r#"{"width": 120, "height": 160, "K": {"fx": 150}}"#);
    bench.register_pairs().fails_with(&["camera.json", "120 × 160", "photo.png", "160 × 120", "scale K"]);
}

#[test]
fn a_mirrored_rotation() {
    let bench = Bench::new();
    let mut mirrored = cameras([0.0, 0.0, 5.0]);
    mirrored["photos"][0]["R"] = json!([[1, 0, 0], [0, -1, 0], [0, 0, 1]]);
    bench.put_json("init.json", &mirrored);
    bench.register().fails_with(&["init.json", "photo photo.png", "field R", "mirrors", "x right, y down, z forward"]);
}

#[test]
fn no_reflectance_to_look_at() {
    let bench = Bench::new();
    let words = ["model.ply", "no reflectance", "leave out"];
    bench.run("register model.ply photo.png --init init.json --signal reflectance").fails_with(&words);
    bench.run("render model.ply --cameras init.json --signal reflectance").fails_with(&words);
}

#[test]
fn an_output_folder_that_cannot_be_written() {
    let bench = Bench::new();
    bench.put("out", "a file where the folder should be");
    bench.register().fails_with(&["out", "cannot be written", "-o DIR"]);
    assert_eq!(fs::read(bench.path("out")).unwrap(), b"a file where the folder should be");
}

#[test]
fn a_failed_run_leaves_an_earlier_result_alone() {
    let bench = Bench::new();
    let run = bench.register();
    assert!(run.status == 0 || run.status == 3, "{run:?}");
    let files = ["cameras.json", "report.html", "overlay/photo.png.jpg"];
    let contents = || files.map(|file| fs::read(bench.path("out").join(file)).unwrap());
    let before = contents();
    bench.put_json(
        "init.json",
        &json!({"photos": [cameras([0.1, 0.0, 5.0])["photos"][0], {"file": "second.png",
        "K": {"fx": 150}, "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "T": [0, 0, 5]}]}),
    );
    bench.put("second.png", "no image");
    bench.run("register model.ply photo.png second.png --init init.json -o out").fails_with(&["second.png"]);
    assert!(before == contents());
    assert_eq!(fs::read_dir(bench.path("out")).unwrap().count(), 3, "nothing is left lying around");
}

#[test]
fn options_that_do_not_go_together() {
    let bench = Bench::new();
    let run = bench.run("register model.ply photo.png --init init.json --joint --solver sgd");
    assert_eq!(run.status, 2, "{run:?}");
    assert!(run.stderr.starts_with("error: --solver sgd draws its batches from one photo: "), "{run:?}");
    for bound in ["--focal-range 100,200", "--principal-within 5 --refine focal"] {
        let run = bench.run(&format!("register model.ply photo.png --init init.json {bound}"));
        assert!(run.status == 2 && run.stderr.contains("add it"), "{run:?}");
    }
    for bound in ["--distance-range 5", "--distance-range 5,4", "--distance-range=-1,4", "--focal-range a,b"] {
        let run = bench.run(&format!("register model.ply photo.png --init init.json --refine focal {bound}"));
        assert!(run.status == 2 && run.stderr.contains("MIN,MAX"), "{run:?}");
    }
}

#[test]
fn wrong_usage_exits_with_2() {
    let bench = Bench::new();
    for command in [
        "",
        "nonsense",
        "register model.ply --init init.json",
        "register model.ply photo.png",
        "register model.ply photo.png --init init.json --pairs pairs.json",
        "register model.ply photo.png --init init.json --metric nonsense",
        "register model.ply photo.png --init init.json --signal nonsense",
        "register model.ply photo.png --init init.json --refine nonsense",
        "register model.ply photo.png --init init.json --seed -1",
        "register model.ply photo.png --init init.json --threads 0",
        "pose model.ply photo.png",
        "render model.ply",
        "evaluate init.json",
    ] {
        let run = bench.run(command);
        assert_eq!((run.status, run.stdout.as_str()), (2, ""), "{command}: {run:?}");
    }
    let run = bench.run("register model.ply photo.png --init init.json --metric nonsense");
    assert!(run.stderr.contains("mi, nmi"), "the possible values are named: {run:?}");
}
