//! Every format that is read gives back the cameras it was given, to rounding, where it can carry them.

use std::fs;

use nalgebra::{Matrix4, Point3, Rotation3, Vector3};
use texreg_camera::{Camera, Distortion, View};
use texreg_formats::{
    CameraEntry, CameraFile, Format, Lens, LensFile, PlacedMesh, Scene, lost, read_cameras, read_lenses, write_lens,
};
use texreg_lie::Pose;

/// Two photos of different cameras, far from the world's origin, on their sides.
fn views() -> [View; 2] {
    let mut first = Camera::ideal(1600, 1200, 1812.5);
    first.intrinsics.fy = 1809.25;
    (first.intrinsics.cx, first.intrinsics.cy) = (811.3, 590.2);
    first.intrinsics.skew = 0.7;
    first.distortion = Distortion::from([-0.21, 0.08, 1.5e-3, -7e-4, 0.02]);
    let second = Camera::ideal(900, 1200, 1234.5);
    let pose =
        |axis: [f64; 3], t: [f64; 3]| Pose::new(Rotation3::from_scaled_axis(Vector3::from(axis)), Vector3::from(t));
    [
        View { camera: first, pose: pose([0.3, -1.2, 2.0], [-4e5, 1.0 / 3.0, 5e6]) },
        View { camera: second, pose: pose([-2.9, 0.4, 0.1], [0.1, -0.2, 2.5]) },
    ]
}

fn scene(format: Format) -> Scene {
    let names = ["photos/a & b.jpg", "photos/c.jpg"].map(|name| match format {
        Format::Bundler => name.replace(" & ", "_"),
        _ => name.to_owned(),
    });
    let entry = |(view, name): (&View, String)| {
        CameraEntry::new(name, &View { camera: format.carried(&view.camera), pose: view.pose })
    };
    let photos = views().iter().zip(names).map(entry).collect();
    Scene { cameras: CameraFile { photos, ..CameraFile::default() }, ..Scene::default() }
}

/// The formats that are read, each with a name of a file.
const READ: [(Format, &str); 7] = [
    (Format::Texreg, "cameras.json"),
    (Format::MeshLab, "project.mlp"),
    (Format::Colmap, "sparse"),
    (Format::ColmapBinary, "sparse"),
    (Format::Bundler, "bundle.out"),
    (Format::Metashape, "cameras.xml"),
    (Format::Nerfstudio, "transforms.json"),
];

#[test]
fn cameras_come_back_from_every_format() {
    for (format, name) in READ {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        if name == "sparse" {
            fs::create_dir(&path).unwrap();
        }
        let scene = scene(format);
        format.write(&path, &scene).unwrap();
        assert_eq!(Format::of(&path), Some(format), "{name}");
        let read = read_cameras(&path).unwrap();
        assert_eq!(read.photos.len(), 2, "{format}");
        for (there, back) in scene.cameras.photos.iter().zip(&read.photos) {
            assert_eq!(there.file, back.file, "{format}");
            let size = there.lens.size.unwrap();
            let (there, back) = (there.view(size), back.view(size));
            let (a, b) = (there.camera, back.camera);
            assert_eq!([a.width, a.height], [b.width, b.height], "{format}");
            for (a, b) in a.intrinsics.to_array().iter().zip(b.intrinsics.to_array()) {
                assert!((a - b).abs() < 1e-9, "{format}: intrinsics {a} came back as {b}");
            }
            assert_eq!(a.distortion, b.distortion, "{format}");
            let turn = there.pose.rotation.matrix() - back.pose.rotation.matrix();
            assert!(turn.amax() < 1e-14, "{format}: {turn}");
            let point = back.pose.inverse().transform_point(&Point3::new(0.3, 0.2, 4.0));
            let off = (there.project(&point).unwrap() - back.project(&point).unwrap()).norm();
            assert!(off < 1e-4, "{format}: the same point is {off} px off");
        }
    }
}

#[test]
fn what_a_format_cannot_carry_is_named() {
    let camera = views()[0].camera;
    let missing = |format: Format| lost(&camera, &format.carried(&camera));
    assert_eq!(missing(Format::Metashape), Vec::<&str>::new());
    assert_eq!(missing(Format::Colmap), ["skew"]);
    assert_eq!(missing(Format::MeshLab), ["distortion", "skew"]);
    assert_eq!(missing(Format::Bundler), ["distortion", "principal point", "skew", "ratio of focal lengths"]);
    let mut radial = Camera::ideal(800, 600, 700.0);
    radial.distortion = Distortion::from([0.1, -0.05, 0.0, 0.0, 0.0]);
    assert_eq!(lost(&radial, &Format::Bundler.carried(&radial)), Vec::<&str>::new());
}

#[test]
fn a_lens_comes_back_from_opencvs_formats() {
    let folder = tempfile::tempdir().unwrap();
    let lens = Lens::from(&Format::OpenCv.carried(&views()[0].camera));
    for (name, format) in [("c.yml", Format::OpenCv), ("c.json", Format::OpenCv), ("camera.json", Format::Texreg)] {
        let path = folder.path().join(name);
        write_lens(&path, &lens, format).unwrap();
        let LensFile::Shared(back) = read_lenses(&path).unwrap() else { panic!("{name}: one lens") };
        assert_eq!(back, lens, "{name}");
    }
}

/// What OpenCV 4's sample data have, tags, layout and all.
#[test]
fn opencvs_own_file_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("left_intrinsics.yml");
    let text = "%YAML:1.0\n---\ncalibration_time: \"Thu 17 Sep 2020 12:00:00\"\nnframes: 13\nimage_width: 640\nimage_height: 480\n\
        board_width: 9\nflags: 0\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ \
        5.3591573396163199e+02, 0., 3.4228315473308373e+02, 0.,\n       5.3591573396163199e+02, 2.3557082909788173e+02, 0., 0., \
        1. ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   data: [ \
        -2.6637260909660682e-01, -3.8588898922304653e-02,\n       1.7831947042852964e-03, -2.8122100441115472e-04,\n       \
        2.3839153080878486e-01 ]\navg_reprojection_error: 3.9e-01\n";
    fs::write(&path, text).unwrap();
    let LensFile::Shared(lens) = read_lenses(&path).unwrap() else { panic!("one lens") };
    assert_eq!(lens.size, Some([640, 480]));
    assert_eq!(lens.focal, [5.359_157_339_616_32e2; 2]);
    assert_eq!(lens.distortion.to_array()[4], 2.3839153080878486e-01);
}

/// The meshes of a project come back, each with its matrix.
#[test]
fn meshes_of_a_project_keep_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let turned = Matrix4::new(0.0, -1.0, 0.0, 1e6, 1.0, 0.0, 0.0, 1.0 / 3.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let meshes = vec![PlacedMesh::new("a & b.ply"), PlacedMesh { file: "c.obj".into(), world_from_mesh: turned }];
    let path = folder.path().join("p.mlp");
    Format::MeshLab.write(&path, &Scene { meshes: meshes.clone(), ..Scene::default() }).unwrap();
    let back = Format::MeshLab.read(&path).unwrap().meshes;
    let here = |mesh: &PlacedMesh| PlacedMesh { file: folder.path().join(&mesh.file), ..mesh.clone() };
    assert_eq!(back, meshes.iter().map(here).collect::<Vec<_>>());
}

/// A camera as MeshLab 2022 writes it, and where its own projection (vcglib, `Camera::Project`) puts a point: the image's
/// middle is where the optical axis meets it, and up is up.
#[test]
fn meshlabs_conventions_are_met() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("p.mlp");
    let text = "<!DOCTYPE MeshLabDocument>\n<MeshLabProject>\n <MeshGroup>\n  <MLMesh label=\"m\" filename=\"m.ply\" visible=\"1\"/>\n \
        </MeshGroup>\n <RasterGroup>\n  <MLRaster label=\"a.jpg\">\n   <VCGCamera FocalMm=\"50\" CameraType=\"0\" BinaryData=\"0\" \
        TranslationVector=\"0 0 -5 1\" PixelSizeMm=\"0.05 0.05\" RotationMatrix=\"1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 \" \
        ViewportPx=\"800 600\" CenterPx=\"400 300\" LensDistortion=\"0 0\"/>\n   <Plane semantic=\"1\" fileName=\"a.jpg\"/>\n  \
        </MLRaster>\n </RasterGroup>\n</MeshLabProject>\n";
    fs::write(&path, text).unwrap();
    let scene = Format::MeshLab.read(&path).unwrap();
    assert_eq!(scene.meshes, [PlacedMesh::new(folder.path().join("m.ply"))]);
    let view = scene.cameras.photos[0].view([800, 600]);
    assert_eq!(view.pose.center(), Point3::new(0.0, 0.0, 5.0));
    // One unit to the right and one up, five away: 200 pixels right of and above the middle.
    let pixel = view.project(&Point3::new(1.0, 1.0, 0.0)).unwrap();
    assert!((pixel.x - 599.5).abs() < 1e-9 && (pixel.y - 99.5).abs() < 1e-9, "{pixel}");
}

/// A scene of several files is written whole or not at all: where one cannot be, the others stay as they were.
#[test]
fn files_of_a_scene_are_written_together() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    std::fs::write(path.join("cameras.txt"), "kept").unwrap();
    std::fs::write(path.join("images.txt"), "kept").unwrap();
    // The last of COLMAP's files cannot take its place.
    std::fs::create_dir(path.join("points3D.txt")).unwrap();
    let error = Format::Colmap.write(path, &Scene::default()).unwrap_err().to_string();
    assert!(error.contains("points3D.txt: cannot be written"), "{error}");
    for name in ["cameras.txt", "images.txt"] {
        assert_eq!(std::fs::read_to_string(path.join(name)).unwrap(), "kept", "{name}");
    }
    assert_eq!(std::fs::read_dir(path).unwrap().count(), 3);
}
