//! What a person who clicks pairs needs: pictures of the model, the point under a pixel, and judged pairs, on the fixture.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use nalgebra::{Point2, Point3};
use texreg_camera::View;
use texreg_driver::{
    Photo, Projected, Shading, Skin, Viewer, fit_of_pairs, outline_picture, pick, pose_and_focal_from_pairs,
    pose_from_pairs, read_truth,
};
use texreg_formats::{PairsEntry, read_pairs, write_pairs};
use texreg_posit::{Correspondence, Solution};
use texreg_surface::Mesh;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/nefertiti").join(name)
}

/// The model, the first photo's true view, and points that it shows.
fn scene() -> (Mesh, View, Vec<Point3<f64>>) {
    let mesh = texreg_surface::load(fixture("model.ply")).unwrap();
    let photo = read_truth(&fixture("truth.json")).unwrap().photos.remove(0);
    (mesh, photo.view, photo.visible)
}

#[test]
fn the_point_under_a_pixel_is_the_one_it_shows() {
    let (mesh, view, visible) = scene();
    let mut distances: Vec<f64> = visible
        .iter()
        .filter_map(|point| {
            let pixel = view.project(point)?;
            let found = pick(&mesh, &view, &pixel)?;
            // It lies on the pixel's ray, wherever the surface is.
            let back = view.project(&found)?;
            assert!((back - pixel).norm() < 1e-3, "{pixel} {back}");
            Some((found - point).norm())
        })
        .collect();
    assert!(distances.len() * 100 > visible.len() * 98, "{} of {}", distances.len(), visible.len());
    distances.sort_by(f64::total_cmp);
    let median = distances[distances.len() / 2];
    assert!(median < 1e-4 * mesh.diagonal(), "{median}");
    assert_eq!(pick(&mesh, &view, &Point2::new(5.0, 5.0)), None);
}

#[test]
fn a_viewer_shows_what_is_before_and_hides_what_is_behind() {
    let (mesh, view, visible) = scene();
    let mut viewer = Viewer::default();
    let back = [9, 8, 7, 0];
    for shading in Shading::of(&mesh) {
        let skin = Skin::new(&mesh, shading).unwrap();
        let picture = viewer.draw(&mesh, &view, &skin, back);
        assert_eq!(picture.len(), (view.camera.width * view.camera.height) as usize);
        assert_eq!(picture[0], back);
        let opaque = picture.iter().filter(|pixel| pixel[3] == 255).count();
        assert!(opaque > picture.len() / 20, "{shading}: {opaque}");
    }
    assert!(Skin::new(&mesh, Shading::Reflectance).is_none() || mesh.reflectance.is_some());
    let shown = visible.iter().filter(|point| viewer.shows(&mesh, &view, point)).count();
    assert!(shown * 100 > visible.len() * 97, "{shown} of {}", visible.len());
    // The centre of the model lies within it.
    assert!(!viewer.shows(&mesh, &view, &mesh.centre()));
}

#[test]
fn a_photo_laid_on_the_model_looks_like_itself_from_where_it_was_taken() {
    let (mesh, view, visible) = scene();
    let photo = Arc::new(Photo::load(fixture("photo_00.jpg")).unwrap());
    let skin = Skin::Photo(Box::new(Projected::new(&mesh, Arc::clone(&photo), &view)));
    let mut viewer = Viewer::default();
    let picture = viewer.draw(&mesh, &view, &skin, [0; 4]);
    let same = visible.iter().filter(|point| {
        let at = view.project(point).unwrap();
        let at = at.y.round() as usize * photo.width as usize + at.x.round() as usize;
        photo.rgb[at].iter().zip(&picture[at][..3]).all(|(a, b)| a.abs_diff(*b) <= 24)
    });
    assert!(same.count() * 100 > visible.len() * 95);
}

#[test]
fn the_outline_is_a_line() {
    let (mesh, view, _) = scene();
    let outline = outline_picture(&mesh, &view, [10, 20, 30]);
    let marked = outline.iter().filter(|pixel| pixel[3] > 0).count();
    assert!((1_000..outline.len() / 20).contains(&marked), "{marked}");
}

#[test]
fn a_wrong_pair_is_told_from_the_others() {
    let (_, view, visible) = scene();
    let exact = |point: &Point3<f64>| Correspondence::new(*point, view.project(point).unwrap());
    let mut pairs: Vec<Correspondence> = visible.iter().step_by(60).take(8).map(exact).collect();
    // A pixel of noise, and one pair 20 pixels off: less than what the robust pose leaves out.
    for (i, pair) in pairs.iter_mut().enumerate() {
        pair.pixel.x += if i % 2 == 0 { 0.7 } else { -0.7 };
        pair.pixel.y += if i % 3 == 0 { 0.7 } else { -0.5 };
    }
    let clean = pose_from_pairs(&pairs, &view.camera).unwrap();
    assert!(fit_of_pairs(&pairs, &clean.view, &[]).iter().all(|fit| !fit.suspicious));
    pairs[3].pixel.y += 20.0;
    let solution = pose_from_pairs(&pairs, &view.camera).unwrap();
    let suspects = |pairs: &[Correspondence], solution: &Solution| -> Vec<usize> {
        let fits = fit_of_pairs(pairs, &solution.view, &solution.rejected);
        (0..pairs.len()).filter(|&i| fits[i].suspicious).collect()
    };
    assert_eq!(suspects(&pairs, &solution), [3]);
    // One that is far off is left out at once, and casts no doubt on the others.
    pairs[3].pixel.y += 200.0;
    let solution = pose_from_pairs(&pairs, &view.camera).unwrap();
    assert_eq!((&solution.rejected[..], &suspects(&pairs, &solution)[..]), (&[3][..], &[3][..]));
}

#[test]
fn a_focal_length_is_found_where_none_is_known() {
    let (_, view, visible) = scene();
    let pairs: Vec<Correspondence> =
        visible.iter().step_by(50).map(|point| Correspondence::new(*point, view.project(point).unwrap())).collect();
    let solution = pose_and_focal_from_pairs(&pairs, [view.camera.width, view.camera.height]).unwrap();
    let focal = solution.view.camera.intrinsics.fx / view.camera.intrinsics.fx;
    assert!((focal - 1.0).abs() < 0.01, "{focal}");
}

#[test]
fn pairs_are_read_as_they_were_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("correspondences.json");
    let mut entry = PairsEntry { file: "a \"quoted\" name.jpg".into(), ..PairsEntry::default() };
    for i in 0..3 {
        let x = f64::from(i) / 3.0;
        entry.points.push(Correspondence::new(Point3::new(x, 1e6 + x, -x), Point2::new(100.0 * x, -0.25)));
        entry.names.push(if i == 1 { "tip of the nose".into() } else { String::new() });
    }
    entry.other.insert("pending".into(), serde_json::json!({"uv": [1.5, 2.0]}));
    let empty = PairsEntry { file: "b.jpg".into(), ..PairsEntry::default() };
    write_pairs(&path, &[entry.clone(), empty.clone()]).unwrap();
    assert_eq!(read_pairs(&path).unwrap(), [entry, empty]);
}
