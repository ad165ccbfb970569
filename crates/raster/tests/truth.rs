//! Pictures against an exact ray caster.

mod common;

use common::{Scene, camera, distorting_camera, judge, pose};
use nalgebra::Point2;
use texreg_raster::{DISTORTION_TOLERANCE, NO_FACE, Options, Raycaster, render};

/// Snapping moves a corner by at most half of 1/4096 pixel each way.
const SNAP: f64 = 1.0 / 4096.0;

#[test]
fn soup_of_small_triangles() {
    let (scene, camera, pose) = (Scene::soup(600, 0.1, 1), camera(96, 72), pose(4.0));
    let picture = render(&scene.triangles(), &camera, &pose, &Options::default());
    let moved = judge(&scene, &camera, &pose, &picture, SNAP);
    assert!(moved <= 7, "{moved} of 6912 pixels see another face than the exact ray");
}

#[test]
fn soup_of_large_triangles() {
    let (scene, camera, pose) = (Scene::soup(40, 1.5, 2), camera(160, 120), pose(5.0));
    let picture = render(&scene.triangles(), &camera, &pose, &Options::default());
    let moved = judge(&scene, &camera, &pose, &picture, SNAP);
    assert!(moved <= 10, "{moved} of 19200 pixels see another face than the exact ray");
}

#[test]
fn soup_around_the_camera() {
    for seed in 3..8 {
        let (scene, camera, pose) = (Scene::soup(60, 1.0, seed), camera(80, 60), pose(0.0));
        let picture = render(&scene.triangles(), &camera, &pose, &Options::default());
        judge(&scene, &camera, &pose, &picture, 4.0 * SNAP);
    }
}

#[test]
fn distorted_soup() {
    for (count, size, distance) in [(600, 0.1, 4.0), (40, 1.5, 5.0), (60, 1.0, 0.0)] {
        let (scene, pose) = (Scene::soup(count, size, 9), pose(distance));
        let camera = distorting_camera(160, 120);
        let picture = render(&scene.triangles(), &camera, &pose, &Options::default());
        judge(&scene, &camera, &pose, &picture, DISTORTION_TOLERANCE + SNAP);
    }
}

#[test]
fn barycentrics_give_the_point_on_the_ray() {
    let scene = Scene::bumpy_sphere(24);
    for camera in [camera(120, 90), distorting_camera(120, 90)] {
        let (mesh, pose) = (scene.triangles(), pose(3.0));
        let options = Options { barycentric: true, ..Options::default() };
        let picture = render(&mesh, &camera, &pose, &options);
        let points = picture.interpolate(mesh.indices, mesh.positions, [f32::NAN; 3]);
        let mut raycaster = Raycaster::new(&camera, &pose);
        let mut seen = 0;
        for (index, &face) in picture.face.iter().enumerate().filter(|&(_, &f)| f != NO_FACE) {
            let pixel = Point2::new((index % 120) as f64, (index / 120) as f64);
            let point = Point2::from(pixel);
            let surface = nalgebra::Point3::from(points[index].map(f64::from));
            let projected = camera.project(&pose.transform_point(&surface)).unwrap();
            // A pixel at an edge may lie outside of its face by the rasterizer's tolerance.
            assert!((projected - point).norm() < DISTORTION_TOLERANCE, "{projected} for {point}");
            let again = raycaster.point(&mesh, face, point).unwrap();
            assert!((again - surface).norm() < 1e-6);
            seen += 1;
        }
        assert_eq!(seen, picture.covered());
        assert!(seen > 3000);
    }
}

#[test]
fn many_pixels_together_are_what_they_are_one_by_one() {
    let scene = Scene::bumpy_sphere(24);
    for camera in [camera(120, 90), distorting_camera(120, 90)] {
        let (mesh, pose) = (scene.triangles(), pose(3.0));
        let picture = render(&mesh, &camera, &pose, &Options::default());
        // In an order in which few are near the one before.
        let pixel = |i: usize| Point2::new((i % 120) as f64, (i / 120) as f64);
        let pixels: Vec<(u32, Point2<f64>)> =
            (0..10_800).map(|i| i * 37 % 10_800).map(|i| (picture.face[i], pixel(i))).collect();
        let together = Raycaster::new(&camera, &pose).barycentrics(&mesh, &pixels);
        for (found, &(face, pixel)) in together.iter().zip(&pixels) {
            let alone = Raycaster::new(&camera, &pose).barycentric(&mesh, face, pixel).unwrap_or([f32::NAN; 2]);
            assert_eq!(alone[0].is_nan(), found[0].is_nan());
            assert!(alone.iter().zip(found).all(|(a, b)| a.is_nan() || (a - b).abs() < 1e-6), "{alone:?}, {found:?}");
        }
        let pixels: Vec<Point2<f64>> = pixels.into_iter().map(|(_, pixel)| pixel).collect();
        for (ray, pixel) in Raycaster::new(&camera, &pose).rays(&pixels).into_iter().zip(pixels) {
            assert!((pose.rotation * ray - camera.unproject(&pixel).unwrap()).norm() < 1e-12);
        }
    }
}

#[test]
fn closed_surfaces_look_the_same_without_their_back() {
    let scene = Scene::bumpy_sphere(40);
    let (camera, pose) = (camera(160, 120), pose(3.0));
    let both = render(&scene.triangles(), &camera, &pose, &Options::default());
    let culled = Options { cull_back_faces: true, ..Options::default() };
    assert_eq!(both, render(&scene.triangles(), &camera, &pose, &culled));
    let mut inside_out = scene.clone();
    inside_out.indices.iter_mut().for_each(|t| t.swap(1, 2));
    let back = render(&inside_out.triangles(), &camera, &pose, &culled);
    assert_eq!(back.silhouette(), both.silhouette());
    assert!(back.depth.iter().zip(&both.depth).all(|(b, f)| b > f || b == &f32::INFINITY));
}
