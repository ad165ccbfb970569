//! Loading: what the formats allow comes in, and what is broken is refused in one line that says where and why.
use std::path::{Path, PathBuf};

use texreg_surface::{Error, Mesh, load};

/// A folder for the test's files.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// Loads bytes as a file of this name.
fn load_bytes(name: &str, bytes: impl AsRef<[u8]>) -> Result<Mesh, Error> {
    let folder = folder();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file in the temporary folder");
    load(&path)
}

/// Checks that a file is refused with one line that names it and contains `parts`.
#[track_caller]
fn refuses(name: &str, bytes: impl AsRef<[u8]>, parts: &[&str]) {
    let message = load_bytes(name, bytes).expect_err("a broken file").to_string();
    for part in [name].iter().chain(parts) {
        assert!(message.contains(part), "{message:?} should contain {part:?}");
    }
    assert!(!message.contains('\n'), "{message:?} is more than one line");
}

/// The case folders, if they are there.
fn cases() -> Option<PathBuf> {
    let found = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|a| a.join("shared/cases")).find(|p| p.is_dir());
    if found.is_none() {
        println!("skipped: no folder shared/cases above the crate");
    }
    found
}

const QUAD: &str = "ply\nformat ascii 1.0\ncomment a unit square\nelement vertex 4\nproperty float x\n\
    property float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
    0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";

/// A binary file of a square, written value by value in the given byte order and types.
struct Binary {
    big: bool,
    bytes: Vec<u8>,
}

impl Binary {
    fn new(big: bool, body_header: &str) -> Binary {
        let order = if big { "big" } else { "little" };
        let header = format!("ply\nformat binary_{order}_endian 1.0\n{body_header}end_header\n");
        Binary { big, bytes: header.into_bytes() }
    }

    fn put(&mut self, kind: &str, value: f64) {
        macro_rules! write {
            ($t:ty) => {
                if self.big {
                    self.bytes.extend((value as $t).to_be_bytes())
                } else {
                    self.bytes.extend((value as $t).to_le_bytes())
                }
            };
        }
        match kind {
            "char" => write!(i8),
            "uchar" => write!(u8),
            "short" => write!(i16),
            "ushort" => write!(u16),
            "int" => write!(i32),
            "uint" => write!(u32),
            "float" => write!(f32),
            _ => write!(f64),
        }
    }
}

const SQUARE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];

fn binary_square(big: bool, real: &str, length: &str, index: &str, faces: &[&[i64]]) -> Vec<u8> {
    let header = format!(
        "element vertex 4\nproperty {real} x\nproperty {real} y\nproperty {real} z\nproperty uchar red\n\
         property uchar green\nproperty uchar blue\nproperty float quality\nelement face {}\n\
         property uchar flags\nproperty list {length} {index} vertex_index\nproperty list uchar float texcoord\n",
        faces.len()
    );
    let mut file = Binary::new(big, &header);
    for (i, point) in SQUARE.iter().enumerate() {
        point.iter().for_each(|&x| file.put(real, x));
        [10.0, 20.0, 30.0].iter().for_each(|c| file.put("uchar", c + i as f64));
        file.put("float", 0.25 * i as f64);
    }
    for face in faces {
        file.put("uchar", 7.0);
        file.put(length, face.len() as f64);
        face.iter().for_each(|&i| file.put(index, i as f64));
        file.put("uchar", 2.0);
        (0..2).for_each(|_| file.put("float", 0.5));
    }
    file.bytes
}

fn world(mesh: &Mesh) -> Vec<[f64; 3]> {
    (0..mesh.positions.len()).map(|i| mesh.point(i).coords.into()).collect()
}

#[test]
fn a_polygon_becomes_a_fan() {
    let mesh = load_bytes("quad.ply", QUAD).expect("a square");
    assert_eq!(world(&mesh), SQUARE);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    assert_eq!(mesh.normals, [[0.0, 0.0, 1.0]; 4]);
    assert_eq!((mesh.reflectance, mesh.colours), (None, None));
}

#[test]
fn binary_of_either_order_and_any_types_reads_the_same() {
    let triangles: [&[i64]; 2] = [&[0, 1, 2], &[0, 2, 3]];
    let mixed: [&[i64]; 2] = [&[0, 1, 2, 3], &[0, 1]];
    for big in [false, true] {
        for real in ["float", "double"] {
            for (length, index) in
                [("uchar", "int"), ("int", "uint"), ("ushort", "ushort"), ("uint", "uchar"), ("char", "short")]
            {
                for faces in [&triangles, &mixed] {
                    let mesh =
                        load_bytes("square.ply", binary_square(big, real, length, index, faces)).expect("a square");
                    assert_eq!(world(&mesh), SQUARE);
                    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
                    assert_eq!(mesh.reflectance.as_deref(), Some(&[0.0, 0.25, 0.5, 0.75][..]));
                    assert_eq!(mesh.colours.as_ref().map(|c| c[3]), Some([13, 23, 33]));
                }
            }
        }
    }
}

#[test]
fn unknown_elements_and_properties_are_skipped() {
    let text = "ply\r\nformat ascii 1.0\r\nelement camera 1\r\nproperty float view_px\r\nproperty list uchar int tags\r\n\
        element vertex 3\r\nproperty list uchar float weights\r\nproperty double y\r\nproperty float x\r\n\
        property short z\r\nproperty float nx\r\nproperty float ny\r\nproperty float nz\r\n\
        property float scalar_Intensity\r\nelement edge 0\r\nelement face 1\r\nproperty uchar flag\r\n\
        property list uchar uint vertex_index\r\nend_header\r\n1.5 2 8 9\r\n\r\n1 9 0 0 0 0 0 2 5\r\n\
        0 0 1 0 nan 0 0 7\r\n2 9 9 1 0 0 0 0 3 nan\r\n1 3 0 1 2\r\n";
    let mesh = load_bytes("odd.ply", text).expect("one triangle");
    assert_eq!(world(&mesh), [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    // One normal is given, not of unit length; the others are invalid and computed.
    assert_eq!(mesh.normals, [[0.0, 0.0, 1.0]; 3]);
    assert_eq!(mesh.reflectance, Some(vec![5.0, 7.0, 6.0]));
}

#[test]
fn survey_coordinates_keep_their_millimetres() {
    let points: Vec<[f64; 3]> =
        (0..5).map(|i| [4_512_345.0 + 0.001 * f64::from(i), 5_412_345.0 + f64::from(i * i), 312.5]).collect();
    let header = "element vertex 5\nproperty double x\nproperty double y\nproperty double z\n\
        element face 3\nproperty list uchar int vertex_indices\n";
    let mut binary = Binary::new(false, header);
    let mut ascii = format!("ply\nformat ascii 1.0\n{header}end_header\n");
    for p in &points {
        p.iter().for_each(|&x| binary.put("double", x));
        ascii += &format!("{} {} {}\n", p[0], p[1], p[2]);
    }
    for i in 0..3 {
        ascii += &format!("3 {i} {} {}\n", i + 1, i + 2);
        binary.put("uchar", 3.0);
        (i..i + 3).for_each(|k| binary.put("int", f64::from(k)));
    }
    let obj: String =
        points.iter().map(|p| format!("v {} {} {}\n", p[0], p[1], p[2])).chain(["f 1 2 3\nf 3 4 5\n".into()]).collect();
    for mesh in [load_bytes("a.ply", ascii), load_bytes("b.ply", binary.bytes), load_bytes("c.obj", obj)] {
        let mesh = mesh.expect("a strip");
        for (read, point) in world(&mesh).iter().zip(&points) {
            for k in 0..3 {
                assert!((read[k] - point[k]).abs() < 1e-6, "{read:?} is not {point:?}");
            }
        }
        assert!((mesh.origin - mesh.centre().coords).norm() < 0.1 * mesh.diagonal());
    }
}

#[test]
fn obj_objects_polygons_and_colours() {
    let text = "# two objects\nmtllib absent.mtl\no first\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0 1 1 1\n\
        vt 0 0\nvn 0 0 1\nusemtl none\nf 1/1/1 2/1/1 3/1/1 4/1/1\no second\nv 0 0 1 0 0 0\nf -1 1 2\nl 1 2\np 1\n";
    let mesh = load_bytes("two.obj", text).expect("three triangles");
    assert_eq!(mesh.positions.len(), 5);
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 0, 1]]);
    assert_eq!(mesh.colours.as_ref().map(|c| c[1]), Some([0, 255, 0]));
}

#[test]
fn broken_files_are_refused_in_one_line() {
    let vertices = QUAD.split_once("0 0 0").expect("a body").0;
    refuses("empty.ply", "", &["empty"]);
    refuses("text.ply", "hello\n", &["line 1", "not a PLY file"]);
    refuses("photo.jpg", "\u{fffd}JFIF", &["not a PLY, OBJ"]);
    refuses("header.ply", "ply\nformat ascii 1.0\n", &["line 3", "end_header"]);
    refuses("format.ply", "ply\nformat ebcdic 1.0\nend_header\n", &["line 2", "ebcdic"]);
    refuses("type.ply", QUAD.replace("float y", "quad y"), &["line 6", "quad y"]);
    refuses("count.ply", QUAD.replace("face 1", "face many"), &["line 8", "many"]);
    refuses("junk.ply", QUAD.replace("comment", "command"), &["line 3", "command"]);
    refuses("noxyz.ply", QUAD.replace("float x", "float u"), &["x, y and z"]);
    refuses("novertex.ply", QUAD.replace("vertex 4", "vertices 4"), &["vertex"]);
    refuses("nolist.ply", QUAD.replace("vertex_indices", "indices"), &["vertex_indices"]);
    refuses(
        "nothing.ply",
        vertices.replace("vertex 4", "vertex 0").replace("face 1", "face 0"),
        &["no faces", "0 points"],
    );
    refuses("lines.ply", QUAD.replace("4 0 1 2 3", "2 0 1"), &["no faces"]);
    refuses("nan.ply", QUAD.replace("1 1 0", "1 NaN 0"), &["line 13", "vertex 2", "NaN"]);
    refuses("infinite.ply", QUAD.replace("1 1 0", "1 1e999 0"), &["line 13", "vertex 2", "inf"]);
    refuses("range.ply", QUAD.replace("4 0 1 2 3", "4 0 1 2 4"), &["line 15", "face 0", "vertex 4", "only 4"]);
    refuses("negative.ply", QUAD.replace("4 0 1 2 3", "4 0 -1 2 3"), &["line 15", "vertex -1"]);
    refuses("word.ply", QUAD.replace("1 1 0", "1 one 0"), &["line 13", "one"]);
    refuses("few.ply", QUAD.replace("1 1 0", "1 1"), &["line 13", "fewer values"]);
    refuses("many.ply", QUAD.replace("1 1 0", "1 1 0 0"), &["line 13", "more values"]);
    refuses("cut.ply", &QUAD[..QUAD.len() - 10], &["line 14", "cut short"]);
    refuses("hostile.ply", QUAD.replace("face 1", "face 123456789012345"), &["123456789012345", "cut short"]);
    refuses("hostile2.ply", QUAD.replace("vertex 4", "vertex 18446744073709551615"), &["18446744073709551615"]);
    refuses("list.ply", format!("{vertices}0 0 0\n1 0 0\n1 1 0\n0 1 0\n4000000000 0 1 2 3\n"), &["line 15", "fewer"]);
    refuses("huge.ply", QUAD.replace("1 1 0", "1e30 1 0"), &["choose a larger unit"]);
    refuses(
        "binary.ply",
        binary_square(false, "float", "uchar", "int", &[&[0, 1, 9]]),
        &["byte", "face 0", "vertex 9"],
    );
    refuses(
        "binary.ply",
        binary_square(true, "double", "int", "int", &[&[0, 1, 2], &[0, -7, 1]]),
        &["byte", "face 1", "vertex -7"],
    );
    refuses(
        "binary.ply",
        binary_square(true, "double", "int", "int", &[&[0, 1, 2, 3], &[0, -7, 1]]),
        &["byte", "face 1", "vertex -7"],
    );
}

#[test]
fn truncated_binary_files_are_refused_at_their_end() {
    for faces in [&[&[0, 1, 2][..], &[0, 2, 3][..]], &[&[0, 1, 2, 3][..], &[0, 2, 3][..]]] {
        let bytes = binary_square(false, "float", "uchar", "int", faces);
        let body = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
        for length in body..bytes.len() {
            refuses("cut.ply", &bytes[..length], &[&format!("byte {length}"), "cut short"]);
        }
    }
}

#[test]
fn not_finite_vertices_of_binary_files_are_named() {
    for real in ["float", "double"] {
        let mut bytes = binary_square(false, real, "uchar", "int", &[&[0, 1, 2]]);
        let body = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
        let (size, nan) =
            if real == "float" { (4, f32::NAN.to_le_bytes().to_vec()) } else { (8, f64::NAN.to_le_bytes().to_vec()) };
        let record = body + 2 * (3 * size + 7);
        bytes[record + size..record + 2 * size].copy_from_slice(&nan);
        refuses("nan.ply", bytes, &[&format!("byte {record}"), "vertex 2", "NaN"]);
    }
}

#[test]
fn broken_obj_files_are_refused_in_one_line() {
    refuses("nothing.obj", "", &["no faces"]);
    refuses("points.obj", "v 0 0 0\nv 1 0 0\n", &["no faces", "2 points"]);
    refuses("word.obj", "v 0 0 0\nv 1 zero 0\nv 0 1 0\nf 1 2 3\n", &["line 2", "three finite coordinates"]);
    refuses("nan.obj", "v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n", &["line 2", "three finite coordinates"]);
    refuses("range.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", &["line 4", "vertex 4", "only 3"]);
    refuses("zero.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", &["line 4", "vertex 0"]);
    refuses("relative.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -9 1 2\n", &["line 4", "vertex -9"]);
    refuses("corner.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf a b c\n", &["line 4", "whole numbers"]);
}

#[test]
fn missing_files_and_folders_are_said() {
    let folder = folder();
    let message = load(folder.path().join("absent.ply")).expect_err("no file").to_string();
    assert!(message.contains("absent.ply: No such file"), "{message}");
    let named = folder.path().join("folder.ply");
    std::fs::create_dir(&named).expect("a folder");
    let message = load(&named).expect_err("a folder").to_string();
    assert!(message.contains("folder.ply: "), "{message}");
}

#[test]
fn every_case_loads() {
    let Some(cases) = cases() else { return };
    for (case, vertices, triangles, reflectance, colours) in [
        ("nefertiti_soft", 35_002, 70_000, true, false),
        ("lucy_silhouette", 50_002, 100_000, false, false),
        ("laurana_plain", 27_861, 49_954, false, true),
        ("leeperry_clutter", 8_838, 17_672, true, true),
    ] {
        let mesh = load(cases.join(case).join("model.ply")).expect("a case's model");
        assert_eq!((mesh.positions.len(), mesh.triangles.len()), (vertices, triangles));
        assert_eq!((mesh.reflectance.is_some(), mesh.colours.is_some()), (reflectance, colours));
        // A closed scan's normals point away from its middle more often than not.
        let centre = mesh.centre();
        let outward =
            |i: usize| (mesh.point(i) - centre).dot(&nalgebra::Vector3::from(mesh.normals[i].map(f64::from))) > 0.0;
        let share = (0..vertices).filter(|&i| outward(i)).count() as f64 / vertices as f64;
        assert!(share > 0.6, "{case}: {share} of the normals point outward");
    }
}

/// A square of two triangles, text, whose texture coordinates are declared and written so.
fn textured(vertex: &str, values: [&str; 4], face: &str, faces: [&str; 2]) -> String {
    let corners = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
    let vertices: Vec<String> = corners.iter().zip(values).map(|(corner, value)| format!("{corner} {value}")).collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n{vertex}\
         element face 2\nproperty list uchar int vertex_indices\n{face}end_header\n{}\n3 0 1 2 {}\n3 0 2 3 {}\n",
        vertices.join("\n"),
        faces[0],
        faces[1]
    )
}

#[test]
fn texture_coordinates_of_faces_and_of_vertices() {
    // As MeshLab writes them, v upwards; ours goes down.
    let expected = vec![[[0.0, 1.0], [0.5, 1.0], [0.5, 0.25]], [[0.0, 1.0], [0.5, 0.25], [0.0, 0.25]]];
    let corners = ["0 0", "0.5 0", "0.5 0.75", "0 0.75"];
    for names in ["s t", "texture_u texture_v"] {
        let vertex: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
        assert_eq!(load_bytes("a.ply", textured(&vertex, corners, "", ["", ""])).unwrap().uvs, Some(expected.clone()));
    }
    let list = "property list uchar float texcoord\n";
    let faces = ["6 0 0 0.5 0 0.5 0.75", "6 0 0 0.5 0.75 0 0.75"];
    let mesh = load_bytes("b.ply", textured("", [""; 4], list, faces)).unwrap();
    assert_eq!(mesh.uvs, Some(expected.clone()));
    // Binary, as we write them; and none where a face has none.
    let mut bytes = Vec::new();
    mesh.write_ply(&mut bytes).unwrap();
    assert_eq!(load_bytes("c.ply", bytes).unwrap(), mesh);
    assert_eq!(load_bytes("d.ply", textured("", [""; 4], list, [faces[0], "0"])).unwrap().uvs, None);
}
