//! Textures through the binary.

mod common;

use std::fs;
use std::path::Path;

use common::{Run, fixture, run};
use serde_json::{Value, json};
use texreg::driver::read_truth;
use texreg::surface::load;
use texreg::texture::{Texture, agreement, draw};

/// Runs `texreg` in a folder, with `@name` standing for a file of the fixture.
fn run_in(folder: &Path, command: &str) -> Run {
    let word = |word: &str| match word.strip_prefix('@') {
        Some(name) => fixture(name).into_os_string(),
        None => word.into(),
    };
    run(folder, &command.split_whitespace().map(word).collect::<Vec<_>>())
}

/// Writes the fixture's true cameras as `cameras.json`, after a change.
fn cameras(folder: &Path, change: impl FnOnce(&mut Vec<Value>)) {
    let mut truth: Value = serde_json::from_slice(&fs::read(fixture("truth.json")).unwrap()).unwrap();
    change(truth["photos"].as_array_mut().unwrap());
    fs::write(folder.join("cameras.json"), truth.to_string()).unwrap();
}

#[test]
fn a_photo_left_out_is_what_the_textured_model_shows() {
    let folder = tempfile::tempdir().unwrap();
    cameras(folder.path(), |photos| drop(photos.remove(0)));
    let run = run_in(folder.path(), "texture @model.ply --cameras cameras.json -o out/bust.obj");
    assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
    assert!(run.stdout.contains("see out/bust.obj") && run.stdout.contains("photo_01.jpg"), "{run:?}");
    assert!(fs::read_to_string(folder.path().join("out/bust.mtl")).unwrap().contains("bust.png"));
    let mesh = load(folder.path().join("out/bust.obj")).unwrap();
    let image = image::open(folder.path().join("out/bust.png")).unwrap().to_rgb8();
    let texture = Texture { image, uvs: mesh.uvs.clone().unwrap() };
    let truth = read_truth(&fixture("truth.json")).unwrap();
    let (drawn, shares) = draw(&mesh, &texture, &truth.photos[0].view, 2);
    let photo = image::open(fixture("photo_00.jpg")).unwrap().to_rgb8();
    let mask: Vec<bool> = shares.iter().map(|share| *share == 1.0).collect();
    let found = agreement(&drawn, &photo, &mask).unwrap();
    assert!(found.psnr > 24.0 && found.ssim > 0.93, "{found:?}");
}

#[test]
fn a_glb_says_what_it_was_made_of() {
    let folder = tempfile::tempdir().unwrap();
    cameras(folder.path(), |photos| {
        photos[1]["status"] = json!("uncertain");
        photos[2]["status"] = json!("failed");
    });
    let command = "texture @model.ply --cameras cameras.json --size 512 --unseen mark --json -o bust.glb";
    let run = run_in(folder.path(), command);
    assert_eq!((run.status, run.stderr.as_str()), (3, ""), "{run:?}");
    let object: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((&object["width"], &object["height"]), (&json!(512), &json!(512)));
    assert_eq!((object["photos"].as_array().unwrap().len(), &object["left_out"]), (2, &json!(["photo_02.jpg"])));
    assert!(object["seen"].as_f64().is_some_and(|seen| (0.2..0.95).contains(&seen)), "{object}");
    assert_eq!(&fs::read(folder.path().join("bust.glb")).unwrap()[..4], b"glTF");
}

#[test]
fn vertices_are_coloured_whatever_the_threads() {
    let folder = tempfile::tempdir().unwrap();
    let files = ["1", "3"].map(|threads| {
        let command = format!(
            "texture @model.ply --cameras @truth.json --size 1024 --vertex-colours --threads {threads} -o {threads}.ply"
        );
        let run = run_in(folder.path(), &command);
        assert_eq!((run.status, run.stderr.as_str()), (0, ""), "{run:?}");
        folder.path().join(format!("{threads}.ply"))
    });
    assert_eq!(fs::read(&files[0]).unwrap(), fs::read(&files[1]).unwrap());
    let (given, coloured) = (load(fixture("model.ply")).unwrap(), load(&files[0]).unwrap());
    assert_eq!(given.triangles, coloured.triangles);
    let colours = coloured.colours.unwrap();
    // Plaster before a blue wall: no vertex is blue.
    let blue = colours.iter().filter(|c| i32::from(c[2]) > i32::from(c[0]) + 10).count();
    assert!(blue * 1000 < colours.len(), "{blue} of {}", colours.len());
}

#[test]
fn wrong_input_is_said_in_one_line_and_spoils_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out.glb");
    fs::write(&out, "kept").unwrap();
    let fails = |change: &dyn Fn(&mut Vec<Value>), options: &str, parts: &[&str]| {
        cameras(folder.path(), |photos| change(photos));
        let run = run_in(folder.path(), &format!("texture @model.ply --cameras cameras.json -o out.glb {options}"));
        assert_eq!((run.status, run.stderr.lines().count()), (1, 1), "{run:?}");
        parts.iter().for_each(|part| assert!(run.stderr.contains(part), "{part}: {run:?}"));
        assert_eq!(fs::read_to_string(&out).unwrap(), "kept");
    };
    fails(&|photos| photos[1]["file"] = json!("gone.jpg"), "", &["cameras.json", "gone.jpg", "--photos"]);
    fails(&|_| (), "--photos nowhere", &["photo_00.jpg", "nowhere"]);
    fails(&|photos| photos[1]["width"] = json!(640), "", &["cameras.json", "640 × 900", "photo_01.jpg", "1200 × 900"]);
    fails(&Vec::clear, "", &["cameras.json", "names no photo"]);
    fails(&|photos| photos.iter_mut().for_each(|p| p["status"] = json!("failed")), "", &["cameras.json", "failed"]);
    fails(
        &|photos| photos.iter_mut().for_each(|p| p["T"] = json!([0, 0, -900])),
        "",
        &["cameras.json", "sees the model"],
    );
    fs::write(folder.path().join("broken.jpg"), "no photo").unwrap();
    fails(&|photos| photos[0]["file"] = json!("broken.jpg"), "", &["broken.jpg"]);
    let run = run_in(folder.path(), "texture @model.ply --cameras cameras.json -o out.stl");
    assert!(run.status == 2 && run.stderr.contains(".glb, .obj or .ply"), "{run:?}");
}
