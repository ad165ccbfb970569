//! The files: read back by ourselves, and by others where these are installed.

use image::{ImageFormat, Rgb, RgbImage};
use serde_json::Value;
use std::process::Command;
use texreg_surface::{Attributes, Mesh, load};
use texreg_texture::{Glb, Texture, mtl, obj, ply, png};

/// A tetrahedron at survey coordinates; each face has a corner of the texture of its own.
fn tetrahedron() -> (Mesh, Texture) {
    let far = [4_512_345.125, 5_401_234.5, 312.25];
    let corners = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 4.0]];
    let points = corners.map(|c| [c[0] + far[0], c[1] + far[1], c[2] + far[2]]);
    let triangles = vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
    let reflectance = Some(vec![0.5, 1.5, 2.5, 3.5]);
    let mesh = Mesh::new(&points, triangles, Attributes { reflectance, ..Attributes::default() }).unwrap();
    let uvs = (0..4).map(|i| {
        let (x, y) = (0.5 * (i % 2) as f32, 0.5 * (i / 2) as f32);
        [[x + 0.125, y + 0.125], [x + 0.375, y + 0.125], [x + 0.125, y + 0.375]]
    });
    let image = RgbImage::from_fn(8, 8, |x, y| Rgb([(30 * x) as u8, (30 * y) as u8, 77]));
    (mesh, Texture { image, uvs: uvs.collect() })
}

fn glb() -> Vec<u8> {
    let (mesh, texture) = tetrahedron();
    Glb::new(&mesh, &texture).unwrap().bytes().unwrap()
}

#[test]
fn a_glb_holds_the_mesh_and_its_texture() {
    let (mesh, texture) = tetrahedron();
    let bytes = glb();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
    let json: Value = serde_json::from_slice(&bytes[20..20 + word(12)]).unwrap();
    let buffer = &bytes[20 + word(12) + 8..];
    assert_eq!(json["buffers"][0]["byteLength"], buffer.len());
    let part = |view: usize| {
        let view = &json["bufferViews"][view];
        let start = view["byteOffset"].as_u64().unwrap() as usize;
        &buffer[start..start + view["byteLength"].as_u64().unwrap() as usize]
    };
    let floats =
        |view: usize| -> Vec<f32> { part(view).chunks(4).map(|c| f32::from_le_bytes(c.try_into().unwrap())).collect() };
    let (positions, uvs) = (floats(0), floats(2));
    let indices: Vec<usize> = part(3).chunks(4).map(|c| u32::from_le_bytes(c.try_into().unwrap()) as usize).collect();
    let origin = json["nodes"][0]["translation"].as_array().unwrap();
    for (corner, &index) in indices.iter().enumerate() {
        let vertex = mesh.triangles[corner / 3][corner % 3] as usize;
        for k in 0..3 {
            let x = origin[k].as_f64().unwrap() + f64::from(positions[3 * index + k]);
            assert_eq!(x, mesh.point(vertex)[k]);
        }
        assert_eq!([uvs[2 * index], uvs[2 * index + 1]], texture.uvs[corner / 3][corner % 3]);
    }
    let picture = image::load_from_memory_with_format(part(4), ImageFormat::Png).unwrap().to_rgb8();
    assert_eq!(picture, texture.image);
}

#[test]
fn an_obj_is_read_back_with_its_texture_coordinates() {
    let (mesh, texture) = tetrahedron();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, obj(&mesh, &texture, "a.mtl")).unwrap();
    let found = load(&path).unwrap();
    assert_eq!(found.triangles.len(), 4);
    let uvs = found.uvs.as_ref().unwrap();
    for (face, k) in (0..12).map(|corner| (corner / 3, corner % 3)) {
        let (here, there) = (mesh.triangles[face][k], found.triangles[face][k]);
        assert_eq!(mesh.point(here as usize), found.point(there as usize));
        let (a, b) = (texture.uvs[face][k], uvs[face][k]);
        assert!((a[0] - b[0]).abs() < 1e-6 && (a[1] - b[1]).abs() < 1e-6);
    }
    assert!(mtl("a.png").contains("map_Kd a.png"));
    assert_eq!(image::load_from_memory(&png(&texture.image).unwrap()).unwrap().to_rgb8(), texture.image);
}

#[test]
fn a_ply_is_read_back_with_its_colours() {
    let (mut mesh, _) = tetrahedron();
    let colours = vec![[1, 2, 3], [40, 50, 60], [7, 8, 9], [255, 0, 128]];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, ply(&mesh, &colours)).unwrap();
    let found = load(&path).unwrap();
    mesh.colours = Some(colours);
    assert_eq!(found, mesh);
}

/// Runs a program that reads the GLB named by its last argument; `None` where it or its library is not installed.
fn read_by(program: &str, args: &[&str], missing: &str) -> Option<String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.glb");
    std::fs::write(&path, glb()).unwrap();
    let output = Command::new(program).args(args).arg(&path).output().ok();
    let output =
        output.map(|o| (o.status.success(), String::from_utf8_lossy(&[o.stdout, o.stderr].concat()).into_owned()));
    match output {
        Some((true, text)) => Some(text),
        Some((false, text)) if !text.contains(missing) => panic!("{text}"),
        _ => {
            println!("skipped: {program} cannot read GLB files here ({missing})");
            None
        }
    }
}

#[test]
fn the_khronos_validator_has_no_complaint() {
    // Found through NODE_PATH: npm install gltf-validator.
    let script = "const v = require('gltf-validator'); const fs = require('fs');
        v.validateBytes(new Uint8Array(fs.readFileSync(process.argv.at(-1))))
         .then(r => console.log(JSON.stringify(r.issues)))";
    let Some(text) = read_by("node", &["-e", script], "Cannot find module") else { return };
    let issues: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&issues["numErrors"], &issues["numWarnings"]), (&0.into(), &0.into()), "{text}");
}

#[test]
fn trimesh_sees_the_texture() {
    let script = "import sys, trimesh
mesh = trimesh.load(sys.argv[-1], force='mesh')
print(len(mesh.faces), mesh.visual.material.baseColorTexture.size, [round(float(x), 3) for x in mesh.bounds[1]])";
    let Some(text) = read_by("python3", &["-c", script], "No module named") else { return };
    assert_eq!(text.trim(), "4 (8, 8) [4512347.125, 5401237.5, 316.25]");
}
