//! Overlays and layers of a square whose outline is known.

use nalgebra::{Rotation3, Vector3};
use texreg_camera::{Camera, View};
use texreg_driver::{Panel, Photo, layer, overlay};
use texreg_lie::Pose;
use texreg_surface::{Attributes, Mesh, SignalName, joint_signal};

/// A square of side 2 at survey coordinates, facing the camera at a distance of 4: with a focal length of 200 px it
/// covers 100 px in the middle of a photo of 301×201.
fn scene() -> (Mesh, Photo, View) {
    let middle = Vector3::new(4e6, -5e6, 100.0);
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
    let points = corners.map(|[x, y]| [middle.x + x, middle.y + y, middle.z]);
    let attributes = Attributes { reflectance: Some(vec![0.0, 1.0, 1.0, 0.0]), ..Attributes::default() };
    // Counter-clockwise seen from the camera, whose y points down: the normal is -z.
    let mesh = Mesh::new(&points, vec![[0, 2, 1], [0, 3, 2]], attributes).unwrap();
    let photo = Photo {
        file: "photo.jpg".into(),
        width: 301,
        height: 201,
        luma: vec![0.5; 301 * 201],
        rgb: vec![[128; 3]; 301 * 201],
        focal_35mm: None,
        mask: None,
    };
    let pose = Pose::new(Rotation3::identity(), Vector3::new(0.0, 0.0, 4.0) - middle);
    (mesh, photo, View { camera: Camera::ideal(301, 201, 200.0), pose })
}

#[test]
fn the_outline_is_drawn_where_the_model_ends() {
    let (mesh, photo, view) = scene();
    let red = [255, 0, 0];
    let panel = |label| Panel { label, view: &view, colour: red };
    let picture = overlay(&mesh, &photo, &[panel("a"), panel("b")]);
    assert!(picture.width() <= 1600 && picture.height() <= 1000, "{:?}", picture.dimensions());
    // The panels are side by side, each showing the square with the same margin on all sides.
    let panel_width = (picture.width() - 6) / 2;
    let row = picture.height() / 2;
    let marked: Vec<u32> = (0..picture.width()).filter(|&x| picture.get_pixel(x, row).0 == red).collect();
    let edges: Vec<u32> = marked.iter().copied().filter(|x| !marked.contains(&(x.wrapping_sub(1)))).collect();
    let [left, right, second_left, _] = edges[..] else { panic!("four strokes, not {edges:?}") };
    assert!((second_left - left).abs_diff(panel_width + 6) <= 1, "{edges:?}");
    assert!((left + right + 1).abs_diff(panel_width) <= 4, "in the middle of the panel: {edges:?} of {panel_width}");
    // 100 px of the photo lie between the strokes.
    let margin = 0.08 * 100.0 + 8.0;
    let scale = f64::from(panel_width) / (100.0 + 2.0 * margin);
    let shown = f64::from(right - left) / scale;
    assert!((shown - 100.0).abs() < 2.0, "{shown}");
    // The backdrop is the photo's.
    assert_eq!(picture.get_pixel(panel_width - 3, row).0, [128; 3]);
}

#[test]
fn wide_models_are_stacked() {
    let (mesh, mut photo, mut view) = scene();
    (photo.height, view.camera.height) = (60, 60);
    photo.rgb.truncate(301 * 60);
    view.camera.intrinsics.cy = 29.5;
    view.camera.intrinsics.fx = 500.0;
    let panel = Panel { label: "a", view: &view, colour: [255, 0, 0] };
    let picture = overlay(&mesh, &photo, &[panel, panel]);
    let strip = picture.get_pixel(picture.width() / 2, picture.height() / 2).0;
    assert_eq!(strip, picture.get_pixel(3, picture.height() / 2).0, "a strip lies between the two");
    assert_ne!(strip, [128; 3]);
    assert!(picture.width() > picture.height());
}

#[test]
fn layers_show_what_they_say() {
    let (mesh, _, view) = scene();
    let at = |name, x, y| {
        let signal = joint_signal(&mesh, &[name]).unwrap();
        layer(&mesh, &*signal, &view).get_pixel(x, y).0
    };
    assert_eq!(at(SignalName::Silhouette, 150, 100), [255; 3]);
    assert_eq!(at(SignalName::Silhouette, 95, 100), [0; 3]);
    // Facing the camera: x and y in the middle of their range, −z at the top.
    assert_eq!(at(SignalName::Normals, 150, 100), [128, 128, 255]);
    assert_eq!(at(SignalName::Normals, 95, 100), [0; 3]);
    // 0 at the left and 1 at the right edge, background 0.
    let (left, right) = (at(SignalName::Reflectance, 101, 100)[0], at(SignalName::Reflectance, 199, 100)[0]);
    assert!((25..30).contains(&left) && right > 250, "{left} {right}");
    // However shallow the model is, its depth takes all greys but the background's.
    let signal = joint_signal(&mesh, &[SignalName::Depth]).unwrap();
    let tilted = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.1);
    let pose = Pose::new(tilted, Vector3::new(0.0, 0.0, 4.0) - tilted * mesh.origin);
    let depth = layer(&mesh, &*signal, &View { camera: view.camera, pose });
    let seen = || depth.pixels().map(|pixel| pixel[0]).filter(|&grey| grey > 0);
    assert_eq!((seen().min(), seen().max()), (Some(26), Some(255)));
}

#[test]
fn a_model_out_of_sight_is_no_reason_to_fail() {
    let (mesh, photo, mut view) = scene();
    view.pose.translation.z -= 20.0;
    let picture = overlay(&mesh, &photo, &[Panel { label: "behind", view: &view, colour: [255, 0, 0] }]);
    assert!(picture.width() > 600);
}
