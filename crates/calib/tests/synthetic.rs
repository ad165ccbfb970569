//! Boards rendered and projected by a known camera: what is found is what was there.

use nalgebra::{Point2, Vector3};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use std::sync::LazyLock;
use texreg_calib::{Board, BoardCorner, Error, Image, Model, Options, Sighting, calibrate, detect, other_size};
use texreg_camera::{Camera, Distortion, Intrinsics};
use texreg_lie::{Pose, so3};

const BOARD: Board = Board { columns: 9, rows: 6, square: 0.03 };

fn camera() -> Camera {
    Camera {
        width: 480,
        height: 360,
        intrinsics: Intrinsics { fx: 404.0, fy: 406.0, cx: 243.0, cy: 177.5, skew: 0.0 },
        distortion: Distortion { k1: -0.19, k2: 0.07, p1: 0.0004, p2: -0.0003, k3: 0.0 },
    }
}

/// A pose whose board's middle is seen `aside` of the axis, turned by a rotation vector.
fn pose(omega: [f64; 3], aside: [f64; 2], depth: f64) -> Pose {
    let rotation = so3::exp(&Vector3::from(omega));
    let middle = Vector3::new(0.12, 0.075, 0.0);
    Pose::new(rotation, Vector3::new(aside[0], aside[1], depth) - rotation * middle)
}

fn poses() -> Vec<Pose> {
    vec![
        pose([0.0, 0.0, 0.1], [0.0, 0.0], 0.34),
        pose([0.6, 0.1, 0.1], [0.01, -0.02], 0.36),
        pose([-0.5, 0.2, -0.2], [-0.02, 0.0], 0.4),
        pose([0.1, 0.7, 0.3], [0.03, 0.01], 0.38),
        pose([0.0, -0.6, 0.1], [-0.03, 0.02], 0.36),
        pose([0.4, -0.4, 1.3], [0.0, 0.02], 0.42),
    ]
}

/// Offsets of a pixel's samples, along each axis.
const STEPS: [f64; 5] = [-0.64, -0.32, 0.0, 0.32, 0.64];

/// Where the camera's samples look, pixel by pixel: x and y at z = 1.
static RAYS: LazyLock<Vec<[f32; 2]>> = LazyLock::new(|| {
    let camera = camera();
    let pixels = (0..camera.height).flat_map(|v| (0..camera.width).map(move |u| (f64::from(u), f64::from(v))));
    let samples = pixels.flat_map(|(u, v)| STEPS.into_iter().flat_map(move |y| STEPS.map(|x| (u + x, v + y))));
    samples
        .map(|(u, v)| camera.unproject(&Point2::new(u, v)).unwrap())
        .map(|ray| [ray.x as f32, ray.y as f32])
        .collect()
});

/// The board from a pose: 5 × 5 samples a pixel, from an area of 1.6 × 1.6 pixels as lenses blur, light that falls off to one side, and noise.
fn render(pose: &Pose, board: &Board, noise: f32) -> Vec<f32> {
    let mut random = StdRng::seed_from_u64(1);
    let world = pose.inverse();
    let center = pose.center();
    let value = |ray: &[f32; 2]| -> f32 {
        let direction = world.transform_vector(&Vector3::new(ray[0].into(), ray[1].into(), 1.0));
        let hit = center + direction * (-center.z / direction.z);
        let (x, y) = (hit.x / board.square, hit.y / board.square);
        let on = |t: f64, count: usize| t > -1.0 && t < count as f64;
        let margin = |t: f64, count: usize| t > -1.5 && t < count as f64 + 0.5;
        // The square beyond corner (0, 0) is dark.
        let is_dark = (x.floor() + y.floor()).rem_euclid(2.0) == 0.0;
        match (on(x, board.columns) && on(y, board.rows), margin(x, board.columns) && margin(y, board.rows)) {
            (true, _) if is_dark => 0.12,
            (_, true) => 0.8,
            _ => 0.4,
        }
    };
    let camera = camera();
    let samples = RAYS.chunks_exact(STEPS.len() * STEPS.len()).enumerate();
    let pixel = samples.map(|(i, rays)| {
        let mean = rays.iter().map(value).sum::<f32>() / rays.len() as f32;
        let light = 1.0 - 0.5 * (i as u32 % camera.width) as f32 / camera.width as f32;
        mean * light + noise * (random.random::<f32>() - 0.5) * 3.46
    });
    pixel.collect()
}

fn look(pose: &Pose, shown: &Board, wanted: &Board) -> Option<Sighting> {
    let values = render(pose, shown, 0.01);
    detect(&Image::new(480, 360, &values).unwrap(), wanted)
}

fn exact(camera: &Camera, pose: &Pose) -> Vec<BoardCorner> {
    let cells = (0..BOARD.rows).flat_map(|row| (0..BOARD.columns).map(move |column| (column, row)));
    let pixel = |column, row| camera.project(&pose.transform_point(&BOARD.point(column, row))).unwrap();
    cells.map(|(column, row)| BoardCorner { column, row, pixel: pixel(column, row) }).collect()
}

/// Root mean square of the distances to where the corners are.
fn error(corners: &[BoardCorner], camera: &Camera, pose: &Pose) -> f64 {
    let square = |c: &BoardCorner| {
        let truth = camera.project(&pose.transform_point(&BOARD.point(c.column, c.row))).unwrap();
        (c.pixel - truth).norm_squared()
    };
    (corners.iter().map(square).sum::<f64>() / corners.len() as f64).sqrt()
}

#[test]
fn corners_are_found_to_a_small_fraction_of_a_pixel_and_make_the_camera() {
    let camera = camera();
    let photos: Vec<Vec<BoardCorner>> = poses()
        .iter()
        .map(|pose| {
            let sighting = look(pose, &BOARD, &BOARD).unwrap();
            assert!(sighting.is_whole(&BOARD), "{:?}", sighting.grid);
            // The index of every corner is the board's own.
            let error = error(&sighting.corners, &camera, pose);
            assert!(error < 0.06, "{error}");
            sighting.corners
        })
        .collect();
    let found = calibrate(&photos, &BOARD, [480, 360], &Options::default()).unwrap();
    let values = found.camera.intrinsics.to_array();
    for (i, (value, truth)) in values.iter().zip(camera.intrinsics.to_array()).enumerate() {
        assert!((value - truth).abs() <= 5.0 * found.deviations[i], "{i}: {value}, not {truth}");
    }
}

#[test]
fn a_part_of_the_board_is_found_where_the_picture_ends() {
    let camera = camera();
    let pose = pose([0.1, 0.2, 0.1], [0.14, 0.0], 0.34);
    let sighting = look(&pose, &BOARD, &BOARD).unwrap();
    assert!(sighting.corners.len() > 20 && sighting.corners.len() < 54, "{}", sighting.corners.len());
    // What is missing lies outside, so that the indices are the board's own.
    let error = error(&sighting.corners, &camera, &pose);
    assert!(error < 0.06, "{error}");
}

#[test]
fn another_board_is_named() {
    let shown = Board { columns: 7, rows: 5, ..BOARD };
    let turned = [[0.0, 0.0, 0.0], [0.3, 0.2, 0.0], [0.2, -0.3, 0.1]];
    let sightings = turned.map(|omega| look(&pose(omega, [0.02, 0.0], 0.36), &shown, &BOARD));
    assert_eq!(other_size(&sightings, &BOARD), Some((7, 5)));
    assert_eq!(other_size(&sightings, &Board { columns: 5, rows: 7, ..BOARD }), None);
    let larger = look(&poses()[0], &BOARD, &shown);
    assert_eq!(other_size(&[larger], &shown), Some((9, 6)));
}

#[test]
fn a_picture_of_nothing_shows_no_board() {
    let flat = vec![0.3; 200 * 150];
    assert_eq!(detect(&Image::new(200, 150, &flat).unwrap(), &BOARD), None);
    let mut random = StdRng::seed_from_u64(2);
    let noise: Vec<f32> = (0..200 * 150).map(|_| random.random()).collect();
    assert_eq!(detect(&Image::new(200, 150, &noise).unwrap(), &BOARD), None);
    let broken: Vec<f32> = noise.iter().map(|v| if *v < 0.1 { f32::NAN } else { 1e30 * (v - 0.5) }).collect();
    assert_eq!(detect(&Image::new(200, 150, &broken).unwrap(), &BOARD), None);
    assert_eq!(detect(&Image::new(0, 0, &[]).unwrap(), &BOARD), None);
    assert!(Image::new(3, 3, &flat).is_none());
}

#[test]
fn exact_corners_give_the_exact_camera() {
    let camera = camera();
    let photos: Vec<_> = poses().iter().map(|pose| exact(&camera, pose)).collect();
    let options = Options { model: Some(Model::Brown4), ..Options::default() };
    let found = calibrate(&photos, &BOARD, [480, 360], &options).unwrap();
    assert!(found.rms < 1e-7, "{}", found.rms);
    let numbers = |c: &Camera| [c.intrinsics.to_array(), c.distortion.to_array()].concat();
    for (value, truth) in numbers(&found.camera).iter().zip(numbers(&camera)) {
        assert!((value - truth).abs() < 1e-6 * truth.abs().max(1.0), "{value}, not {truth}");
    }
    for (fit, pose) in found.photos.iter().zip(poses()) {
        assert!((fit.pose.matrix() - pose.matrix()).norm() < 1e-7);
    }
}

#[test]
fn standard_deviations_are_those_of_repeated_calibrations() {
    let camera = camera();
    let mut random = StdRng::seed_from_u64(3);
    let mut squares = [0.0; 10];
    let runs = 60;
    let options = Options { model: Some(Model::Brown4), ..Options::default() };
    for _ in 0..runs {
        let mut photos: Vec<_> = poses().iter().map(|pose| exact(&camera, pose)).collect();
        for corner in photos.iter_mut().flatten() {
            // Uniform noise of standard deviation 0.1.
            corner.pixel.x += 0.1 * 12f64.sqrt() * (random.random::<f64>() - 0.5);
            corner.pixel.y += 0.1 * 12f64.sqrt() * (random.random::<f64>() - 0.5);
        }
        let found = calibrate(&photos, &BOARD, [480, 360], &options).unwrap();
        assert!((found.sigma - 0.1).abs() < 0.015, "{}", found.sigma);
        let values = [found.camera.intrinsics.to_array(), found.camera.distortion.to_array()].concat();
        let truth = [camera.intrinsics.to_array(), camera.distortion.to_array()].concat();
        for i in Model::Brown4.parameters() {
            squares[*i] += ((values[*i] - truth[*i]) / found.deviations[*i]).powi(2);
        }
    }
    for i in Model::Brown4.parameters() {
        let ratio = (squares[*i] / f64::from(runs)).sqrt();
        assert!((0.7..1.35).contains(&ratio), "parameter {i}: {ratio}");
    }
}

#[test]
fn a_photo_of_another_board_is_named_and_left_out() {
    let camera = camera();
    let mut photos: Vec<_> = poses().iter().map(|pose| exact(&camera, pose)).collect();
    let mut random = StdRng::seed_from_u64(4);
    for corner in photos.iter_mut().flatten() {
        corner.pixel.x += 0.2 * (random.random::<f64>() - 0.5);
    }
    // Its corners are not where a plane's are.
    for corner in &mut photos[2] {
        corner.pixel.y += 3.0 * (corner.column as f64).sin();
    }
    let found = calibrate(&photos, &BOARD, [480, 360], &Options::default()).unwrap();
    let left_out: Vec<bool> = found.photos.iter().map(|photo| photo.is_outlier).collect();
    assert_eq!(left_out, [false, false, true, false, false, false]);
    assert!(found.rms < 0.2 && found.photos[2].rms > 1.0);
}

#[test]
fn photos_that_leave_the_camera_open_are_refused() {
    let camera = camera();
    let options = Options::default();
    let of = |poses: &[Pose]| -> Vec<_> { poses.iter().map(|pose| exact(&camera, pose)).collect() };
    let two = of(&poses()[..2]);
    assert_eq!(calibrate(&two, &BOARD, [480, 360], &options).unwrap_err(), Error::TooFew { found: 2, needed: 3 });
    let facing = [0.3, 0.35, 0.4].map(|depth| pose([0.0; 3], [0.0; 2], depth));
    let error = calibrate(&of(&facing), &BOARD, [480, 360], &options).unwrap_err();
    assert!(matches!(error, Error::ParallelToImage { .. }), "{error}");
    let parallel = [0.35, 0.4, 0.45].map(|depth| pose([0.4, 0.2, 0.0], [0.0; 2], depth));
    let error = calibrate(&of(&parallel), &BOARD, [480, 360], &options).unwrap_err();
    assert!(matches!(error, Error::ParallelBoards { .. }), "{error}");
    let line: Vec<_> = exact(&camera, &poses()[0]).into_iter().filter(|c| c.row == 0).collect();
    let photos = [of(&poses()[..2]), vec![line]].concat();
    assert_eq!(calibrate(&photos, &BOARD, [480, 360], &options).unwrap_err(), Error::Degenerate { photo: 2 });
}
