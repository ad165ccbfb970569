//! STL, OFF, glTF and MeshLab projects: what comes in, and what is said of broken ones.
use std::path::Path;

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;
use texreg_surface::{Error, Mesh, load};

fn load_bytes(name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, Error> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file in the temporary folder");
    load(&path)
}

#[track_caller]
fn refuses(name: &str, bytes: impl AsRef<[u8]>, words: &[&str]) {
    let message = load_bytes(name, bytes).expect_err("a broken file").to_string();
    for word in [name].iter().chain(words) {
        assert!(message.contains(word), "{message:?} should contain {word:?}");
    }
    assert!(!message.contains('\n'), "{message:?} is more than one line");
}

/// The area and the volume of a mesh: both tell whether triangles face outside and are where they should be.
fn measure(mesh: &Mesh) -> (f64, f64) {
    let sums = mesh.triangles.iter().map(|t| {
        let [a, b, c] = t.map(|i| mesh.point(i as usize).coords);
        (0.5 * (b - a).cross(&(c - a)).norm(), a.dot(&b.cross(&c)) / 6.0)
    });
    sums.fold((0.0, 0.0), |(area, volume), (a, v)| (area + a, volume + v))
}

/// The corner of the unit cube at the origin, volume 1/6, turned outside.
const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const FACES: [[u16; 3]; 4] = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];

fn is_the_corner(mesh: &Mesh) {
    let (area, volume) = measure(mesh);
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (4, 4));
    assert!((area - (1.5 + 0.75f64.sqrt())).abs() < 1e-6 && (volume - 1.0 / 6.0).abs() < 1e-6, "{area}, {volume}");
}

fn ascii_stl() -> String {
    let facet = |face: &[u16; 3]| {
        let vertex = |i: &u16| {
            let [x, y, z] = CORNERS[*i as usize];
            format!("vertex {x} {y} {z}\n")
        };
        let vertices: String = face.iter().map(vertex).collect();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    };
    let facets: String = FACES.iter().map(facet).collect();
    format!("solid corner\n{facets}endsolid corner\n")
}

fn binary_stl() -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend(4u32.to_le_bytes());
    for face in FACES {
        bytes.extend([0; 12]);
        face.iter().flat_map(|&i| CORNERS[i as usize]).for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

const OFF: &str = "OFF # a corner\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3 255 0 0\n3 0 3 2\n3 1 2 3\n";

/// A GLB of the corner, shown by a node.
fn glb(node: &str) -> Vec<u8> {
    let mut binary: Vec<u8> = CORNERS.as_flattened().iter().flat_map(|x| x.to_le_bytes()).collect();
    binary.extend(FACES.as_flattened().iter().flat_map(|i| i.to_le_bytes()));
    let mut json = format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]}}], "nodes": [{node}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1}}]}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}},
          {{"bufferView": 1, "componentType": 5123, "count": 12, "type": "SCALAR"}}],
        "bufferViews": [{{"buffer": 0, "byteOffset": 0, "byteLength": 48}}, {{"buffer": 0, "byteOffset": 48, "byteLength": 24}}],
        "buffers": [{{"byteLength": {}}}]}}"#,
        binary.len()
    )
    .into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let mut bytes = b"glTF".to_vec();
    bytes.extend(2u32.to_le_bytes());
    bytes.extend(((28 + json.len() + binary.len()) as u32).to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    bytes
}

#[test]
fn the_same_corner_comes_from_every_format() {
    is_the_corner(&load_bytes("corner.stl", ascii_stl()).unwrap());
    is_the_corner(&load_bytes("corner.stl", binary_stl()).unwrap());
    is_the_corner(&load_bytes("corner.off", OFF).unwrap());
    is_the_corner(&load_bytes("corner.glb", glb(r#"{"mesh": 0}"#)).unwrap());
}

#[test]
fn nodes_move_their_meshes() {
    let moved = load_bytes("c.glb", glb(r#"{"mesh": 0, "translation": [10, 0, 0], "scale": [2, 2, 2]}"#)).unwrap();
    assert!((measure(&moved).1 - 8.0 / 6.0).abs() < 1e-5);
    assert_eq!(moved.point(1), Point3::new(12.0, 0.0, 0.0));
    // A mirror turns the triangles over, and outside stays outside.
    let mirrored = load_bytes("c.glb", glb(r#"{"mesh": 0, "scale": [-1, 1, 1]}"#)).unwrap();
    assert!((measure(&mirrored).1 - 1.0 / 6.0).abs() < 1e-6);
}

#[test]
fn a_project_puts_its_meshes_where_its_matrices_say() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("corner.stl"), binary_stl()).unwrap();
    std::fs::write(folder.path().join("corner.off"), OFF).unwrap();
    let project = |matrix: &str| {
        format!(
            "<!DOCTYPE MeshLabDocument>\n<MeshLabProject>\n<MeshGroup>\n<MLMesh filename=\"corner.stl\">\n<MLMatrix44>\n{matrix}\n\
             </MLMatrix44></MLMesh>\n<MLMesh filename=\"corner.off\"/>\n</MeshGroup></MeshLabProject>\n"
        )
    };
    let path = folder.path().join("p.mlp");
    let load_with = |matrix: &str| {
        std::fs::write(&path, project(matrix)).unwrap();
        load(&path)
    };
    // A quarter turn about z and a shift far away: the first mesh's normals turn with it.
    let mesh = load_with("0 -1 0 1000000\n1 0 0 0\n0 0 1 0\n0 0 0 1").unwrap();
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (8, 8));
    let place = |point: Point3<f64>| (0..8).find(|&i| (mesh.point(i) - point).norm() < 1e-6).expect("a vertex there");
    let turned = place(Point3::new(1_000_000.0, 1.0, 0.0));
    let there = Vector3::from(mesh.normals[turned]);
    let alone = load_bytes("corner.stl", binary_stl()).unwrap();
    let at_x = (0..4).find(|&i| alone.point(i).x > 0.5).unwrap();
    let before = Vector3::from(alone.normals[at_x]);
    assert!((there - Vector3::new(-before.y, before.x, before.z)).norm() < 1e-6, "{there} from {before}");

    let message = load_with("1 2 3").unwrap_err().to_string();
    assert!(message.contains("p.mlp: line 5: field MLMatrix44"), "{message}");
    std::fs::write(&path, project("").replace("<MLMatrix44>\n\n</MLMatrix44>", "").replace("corner.off", "no.off"))
        .unwrap();
    let message = load(&path).unwrap_err().to_string();
    assert!(message.contains("p.mlp: line 6: field filename") && message.contains("no.off"), "{message}");
}

#[test]
fn broken_files_are_refused_in_one_line() {
    refuses("a.off", "OFF\n4 1 0\n0 0 0\n1 0 0\n0 1 0\n", &["line 5", "vertices"]);
    refuses("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 x\n3 0 1 2\n", &["line 5", "coordinates"]);
    refuses("a.off", OFF.replace("3 1 2 3", "3 1 2 9"), &["line 10", "vertex 9"]);
    refuses("a.off", "solid\n", &["line 1", "OFF"]);
    refuses("a.stl", &binary_stl()[..100], &["cut short"]);
    refuses("a.glb", &glb(r#"{"mesh": 0}"#)[..200], &["a.glb"]);
    let replaced = |from: &str, to: &str| {
        let bytes = glb(r#"{"mesh": 0}"#);
        let at = bytes.windows(from.len()).position(|window| window == from.as_bytes()).unwrap();
        [&bytes[..at], to.as_bytes(), &bytes[at + from.len()..]].concat()
    };
    refuses("a.glb", replaced(r#""count": 4"#, r#""count": 9"#), &["POSITION", "beyond its buffer"]);
    refuses("a.glb", glb(r#"{"mesh": 0, "children": [0]}"#), &["node 0", "ancestor"]);
    refuses("a.glb", glb(r#"{"mesh": 0, "rotation": [0, 0, 0, 0]}"#), &["node 0", "field rotation", "norm zero"]);
    refuses("a.mlp", "<MeshLabProject>\n<MeshGroup>", &["line", "well-formed"]);
    refuses("a.mlp", "<MeshLabProject/>", &["no mesh"]);
}

/// A cloud in a project stays a cloud, and texture coordinates stay with their corners, also where a matrix mirrors.
#[test]
fn projects_keep_clouds_and_texture_coordinates() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let project = |file: &str| {
        format!(
            "<MeshLabProject><MeshGroup><MLMesh filename=\"{file}\"><MLMatrix44>-1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</MLMatrix44>\
             </MLMesh></MeshGroup></MeshLabProject>"
        )
    };
    let points: String = (0..25).map(|i| format!("{} {} 0\n", i % 5, i / 5)).collect();
    let header =
        "ply\nformat ascii 1.0\nelement vertex 25\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
    put("cloud.ply", &format!("{header}{points}"));
    put("p.mlp", &project("cloud.ply"));
    let cloud = load(folder.path().join("p.mlp")).unwrap();
    assert!(cloud.is_cloud && cloud.positions.len() == 100);

    put("square.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 1\nvt 1 1\nvt 0 0\nf 1/1 2/2 3/3\n");
    put("p.mlp", &project("square.obj"));
    let mesh = load(folder.path().join("p.mlp")).unwrap();
    let uvs = mesh.uvs.as_ref().expect("texture coordinates");
    for (&i, uv) in mesh.triangles[0].iter().zip(&uvs[0]) {
        // u runs along −x here, v (from the top) along y.
        let point = mesh.point(i as usize);
        assert_eq!(uv.map(f64::from), [-point.x, point.y]);
    }
}

/// The texture coordinates of a glTF are those of its vertices.
#[test]
fn gltf_brings_texture_coordinates() {
    let numbers: [f32; 15] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.25, 0.5, 0.75, 0.5, 0.25, 1.0];
    let bytes: Vec<u8> = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("b.bin"), bytes).unwrap();
    let text = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}}]}],
        "buffers": [{"byteLength": 60, "uri": "b.bin"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
                      {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}]}"#;
    let path = folder.path().join("t.gltf");
    std::fs::write(&path, text).unwrap();
    assert_eq!(load(&path).unwrap().uvs, Some(vec![[[0.25, 0.5], [0.75, 0.5], [0.25, 1.0]]]));
    let kind = "\"componentType\": 5126, \"count\": 3, \"type\": \"VEC2\"";
    assert!(text.contains(kind));
    for (change, words) in [
        (kind.replace('3', "4"), "beyond its buffer"),
        (kind.replace('3', "2"), "one a vertex"),
        (kind.replace("5126", "5125"), "pairs of floats"),
    ] {
        std::fs::write(&path, text.replace(kind, &change)).unwrap();
        let message = load(&path).unwrap_err().to_string();
        assert!(message.contains("node 0, primitive 0: TEXCOORD_0") && message.contains(words), "{message}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn no_bytes_make_a_reader_panic(
        which in 0..4usize, at in any::<prop::sample::Index>(), put in prop::collection::vec(any::<u8>(), 0..8), cut in 0..30usize
    ) {
        let (name, mut bytes) = match which {
            0 => ("a.stl", ascii_stl().into_bytes()),
            1 => ("a.stl", binary_stl()),
            2 => ("a.off", OFF.as_bytes().to_vec()),
            _ => ("a.glb", glb(r#"{"mesh": 0, "rotation": [0, 0, 0, 1]}"#)),
        };
        let start = at.index(bytes.len());
        bytes.splice(start..(start + cut).min(bytes.len()), put);
        if let Ok(mesh) = load_bytes(name, bytes) {
            prop_assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.positions.len()));
        }
    }
}

/// A real model through STL keeps its triangles and where they are.
#[test]
fn a_real_model_survives_stl() {
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti/model.ply");
    let mesh = load(model).unwrap();
    let mut bytes = vec![0; 80];
    bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
    for triangle in &mesh.triangles {
        bytes.extend([0; 12]);
        for &i in triangle {
            let p = mesh.point(i as usize);
            [p.x, p.y, p.z].iter().for_each(|&x| bytes.extend((x as f32).to_le_bytes()));
        }
        bytes.extend([0; 2]);
    }
    let back = load_bytes("model.stl", bytes).unwrap();
    assert_eq!(back.triangles.len(), mesh.triangles.len());
    let ((area, volume), (a, v)) = (measure(&mesh), measure(&back));
    assert!((area / a - 1.0).abs() < 1e-5 && (volume / v - 1.0).abs() < 1e-4);
}
