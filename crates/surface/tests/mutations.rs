//! Whatever is done to the bytes of a model, loading it gives a valid mesh or an error of one line, never a panic.
mod scans;

use std::sync::OnceLock;

use proptest::prelude::*;
use scans::{ScanPoint, e57, las};
use texreg_surface::load;

const ASCII: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nproperty list uchar int tags\nelement face 2\n\
    property list uchar int vertex_indices\nproperty uchar flag\nelement edge 1\nproperty int a\nend_header\n\
    0 0 0 1 2 3 0\n1 0 0 1 2 3 1 5\n1 1 0 1 2 3 0\n0 1 0 1 2 3 0\n3 0 1 2 9\n4 0 1 2 3 9\n7\n";

const OBJ: &str = "mtllib a.mtl\no one\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nvt 0 0\nvn 0 0 1\n\
    usemtl m\nf 1/1/1 2//1 -1/1\nf 1 2 3\nl 1 2\n";

/// A binary file of four vertices and two faces, bulk or mixed.
fn binary(order: &str, mixed: bool) -> Vec<u8> {
    let big = order == "big";
    let mut bytes = format!(
        "ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property float nx\nproperty float ny\nproperty float nz\nproperty float intensity\nelement face 2\n\
         property list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    for p in [[0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]] {
        for v in [p[0], p[1], p[2], 0.0, 0.0, 1.0, p[0]] {
            bytes.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() });
        }
    }
    for face in [&[0i32, 1, 2][..], if mixed { &[0, 1, 2, 3] } else { &[0, 2, 3] }] {
        bytes.push(face.len() as u8);
        for &i in face {
            bytes.extend(if big { i.to_be_bytes() } else { i.to_le_bytes() });
        }
    }
    bytes
}

/// One change to a file.
#[derive(Debug, Clone)]
enum Change {
    Set(usize, u8),
    Insert(usize, u8),
    Remove(usize, usize),
    Cut(usize),
}

fn change() -> impl Strategy<Value = Change> {
    let byte = prop_oneof![any::<u8>(), proptest::sample::select(b"0123456789 -.eE\n\r/\xff\x00".to_vec())];
    prop_oneof![
        4 => (any::<usize>(), byte.clone()).prop_map(|(at, b)| Change::Set(at, b)),
        2 => (any::<usize>(), byte).prop_map(|(at, b)| Change::Insert(at, b)),
        2 => (any::<usize>(), 1..20usize).prop_map(|(at, n)| Change::Remove(at, n)),
        1 => any::<usize>().prop_map(Change::Cut),
    ]
}

fn apply(bytes: &mut Vec<u8>, change: &Change) {
    let length = bytes.len().max(1);
    match *change {
        Change::Set(at, b) => {
            if let Some(byte) = bytes.get_mut(at % length) {
                *byte = b;
            }
        }
        Change::Insert(at, b) => bytes.insert(at % length, b),
        Change::Remove(at, n) => {
            let start = (at % length).min(bytes.len());
            bytes.drain(start..(start + n).min(bytes.len()));
        }
        Change::Cut(at) => bytes.truncate(at % length),
    }
}

/// Files of a point cloud in the formats that libraries read.
fn clouds() -> &'static [(&'static str, Vec<u8>)] {
    static FILES: OnceLock<Vec<(&str, Vec<u8>)>> = OnceLock::new();
    FILES.get_or_init(|| {
        let points: Vec<ScanPoint> = (0..40).map(|i| ScanPoint::grid(i, 8)).collect();
        vec![("g.las", las(&points, false)), ("h.laz", las(&points, true)), ("i.e57", e57(&points, [1.0, 2.0, 3.0]))]
    })
}

/// Loads the bytes and checks what comes of it.
fn check(name: &str, bytes: &[u8]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).expect("a file in the temporary folder");
    match load(&path) {
        Ok(mesh) => {
            let vertices = mesh.positions.len();
            assert!(!mesh.triangles.is_empty());
            assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < vertices));
            assert!(mesh.positions.iter().flatten().all(|x| x.is_finite()));
            assert_eq!(mesh.normals.len(), vertices);
            let unit = |n: &[f32; 3]| (n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-4;
            assert!(mesh.normals.iter().all(unit));
            assert!(mesh.reflectance.is_none_or(|r| r.len() == vertices && r.iter().all(|v| v.is_finite())));
            assert!(mesh.colours.is_none_or(|c| c.len() == vertices));
        }
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains(name) && !message.contains('\n') && message.len() < 400, "{message:?}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn mutated_files_never_panic(
        kind in 0..9usize,
        changes in proptest::collection::vec(change(), 1..6),
    ) {
        let (name, mut bytes) = match kind {
            0 => ("a.ply", ASCII.as_bytes().to_vec()),
            1 => ("b.ply", binary("little", false)),
            2 => ("c.ply", binary("little", true)),
            3 => ("d.ply", binary("big", false)),
            4 => ("e.ply", binary("big", true)),
            5 => ("f.obj", OBJ.as_bytes().to_vec()),
            _ => clouds()[kind - 6].clone(),
        };
        changes.iter().for_each(|change| apply(&mut bytes, change));
        check(name, &bytes);
    }
}

#[test]
fn a_flipped_byte_of_a_cloud_is_told_or_does_no_harm() {
    for (name, whole) in clouds() {
        // Most of an E57 file are words.
        let is_e57 = name.ends_with("e57");
        for at in (0..whole.len()).step_by(if is_e57 { 3 } else { 1 }) {
            let mut bytes = whole.clone();
            bytes[at] ^= if at % 2 == 0 { 0xff } else { 1 << (at / 2 % 8) };
            if is_e57 {
                mend_checksums(&mut bytes);
            }
            check(name, &bytes);
        }
    }
}

/// Makes the checksums of an E57 file right again: CRC-32C at the end of each page of 1024 bytes.
fn mend_checksums(bytes: &mut [u8]) {
    for page in bytes.chunks_exact_mut(1024) {
        let (data, sum) = page.split_at_mut(1020);
        let crc = data.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0x82f6_3b78 } else { crc >> 1 })
        });
        sum.copy_from_slice(&(!crc).to_be_bytes());
    }
}

#[test]
fn the_unchanged_files_load() {
    for (name, bytes) in clouds() {
        let mut mended = bytes.clone();
        mend_checksums(&mut mended);
        assert!(!name.ends_with("e57") || mended == *bytes, "the checksums are E57's");
    }
    for bytes in [ASCII.as_bytes().to_vec(), binary("little", false), binary("big", true)] {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("whole.ply");
        std::fs::write(&path, bytes).expect("a file in the temporary folder");
        assert!(load(&path).is_ok());
    }
}
