//! The solvers one by one.

use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};
use proptest::prelude::*;
use texreg_camera::{Camera, Intrinsics, View};
use texreg_lie::{Pose, so3};
use texreg_posit::*;

fn see(pose: &Pose, points: &[Point3<f64>]) -> Vec<Bearing> {
    let bearing = |p: &Point3<f64>| {
        let y = pose.transform_point(p);
        Bearing { point: p.coords, image: y.xy().coords / y.z }
    };
    points.iter().map(bearing).collect()
}

fn points(n: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Point3<f64>>> {
    prop::collection::vec(prop::array::uniform3(-1.0..1.0_f64).prop_map(Point3::from), n)
}

fn pose_at(depth: std::ops::Range<f64>) -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(-1.8..1.8_f64), depth, prop::array::uniform2(-0.2..0.2_f64))
        .prop_map(|(w, z, xy)| Pose::new(so3::exp(&w.into()), Vector3::new(xy[0] * z, xy[1] * z, z)))
}

fn distance(a: &Pose, b: &Pose) -> f64 {
    (a.matrix() - b.matrix()).norm()
}

/// The smallest of a point set's three extents.
fn thickness(points: &[Point3<f64>]) -> f64 {
    let mean = points.iter().fold(Vector3::zeros(), |s, p| s + p.coords) / points.len() as f64;
    let scatter = points.iter().map(|p| p.coords - mean).fold(Matrix3::zeros(), |s, d| s + d * d.transpose());
    scatter.symmetric_eigenvalues().min().max(0.0).sqrt()
}

/// Eight corners of a cube of edge 10 and their pixels at focal length 760, the example program of DeMenthon & Davis.
fn cube() -> (Vec<Bearing>, f64) {
    let corners = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
    let pixels = [[0, 0], [80, -93], [245, -77], [185, 32], [32, 135], [99, 35], [247, 62], [195, 179]];
    let focal = 760.0;
    let bearing = |(c, p): ([i32; 3], [i32; 2])| Bearing {
        point: Vector3::from(c.map(f64::from)) * 10.0,
        image: Vector2::from(p.map(f64::from)) / focal,
    };
    (corners.into_iter().zip(pixels).map(bearing).collect(), focal)
}

#[test]
fn posit_solves_the_authors_cube() {
    let (bearings, focal) = cube();
    // They stop when the pixels as scaled orthography would have them, u (1 + ε), settle to a pixel.
    let found = posit(&bearings, &Iteration { tolerance: 1.0 / 250.0, most: 20 }).unwrap();
    assert!(found.converged && found.iterations <= 4, "{found:?}");
    let end = posit(&bearings, &Iteration::default()).unwrap();
    assert!(end.converged);
    assert!((end.pose.translation - Vector3::new(0.0, 0.0, 40.0)).norm() < 0.1, "{end:?}");
    // The pixels are rounded to integers.
    for b in &bearings {
        let y = end.pose.transform_point(&b.point.into());
        assert!((y.xy().coords / y.z - b.image).norm() * focal < 1.0);
    }
}

/// The farther, the fewer: two to four iterations from ten diameters on.
#[test]
fn posit_converges_fast_from_afar() {
    let corners: Vec<Point3<f64>> =
        (0..8).map(|i| Point3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))).collect();
    let mut last = usize::MAX;
    for (depth, most) in [(4.0, 14), (10.0, 7), (30.0, 5), (100.0, 4)] {
        let pose = Pose::new(so3::exp(&Vector3::new(0.5, 0.6, -0.7)), Vector3::new(0.1, 0.2, depth));
        let found = posit(&see(&pose, &corners), &Iteration { tolerance: 1e-6, most: 100 }).unwrap();
        assert!(found.converged && found.iterations <= most && found.iterations <= last, "{depth}: {found:?}");
        assert!(distance(&found.pose, &pose) < 1e-4 * depth);
        last = found.iterations;
    }
}

proptest! {
    #[test]
    fn posit_is_exact(points in points(4..20), pose in pose_at(8.0..30.0)) {
        if thickness(&points) < 0.3 {
            return Ok(());
        }
        let found = posit(&see(&pose, &points), &Iteration { tolerance: 1e-13, most: 500 }).unwrap();
        prop_assert!(!found.converged || distance(&found.pose, &pose) < 1e-6, "{} {found:?}", distance(&found.pose, &pose));
        prop_assert!(found.converged || points.len() < 6);
    }

    #[test]
    fn coplanar_posit_has_the_pose_among_its_two(points in points(5..20), pose in pose_at(6.0..20.0)) {
        let points: Vec<_> = points.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let turned = Pose::new(pose.rotation, Vector3::zeros());
        let slant = turned.transform_vector(&Vector3::z()).z.abs();
        let extent = points.iter().fold(Matrix3::zeros(), |s, p| s + p.coords * p.coords.transpose());
        let wide = extent.symmetric_eigenvalues().iter().filter(|v| **v > 0.5).count() == 2;
        if !wide || !(0.3..0.95).contains(&slant) {
            return Ok(());
        }
        let found = coplanar_posit(&see(&pose, &points), &Iteration { tolerance: 1e-13, most: 1000 }).unwrap();
        prop_assert!(found.len() <= 2);
        // The iteration has no guarantee; what does not converge says so.
        let stuck = found.iter().any(|f| !f.converged);
        prop_assert!(stuck || found.iter().any(|f| distance(&f.pose, &pose) < 1e-5), "{found:?} {pose:?}");
    }

    #[test]
    fn p3p_has_the_pose_among_its_four(points in points(3..4), pose in pose_at(2.5..20.0)) {
        let normal = (points[1] - points[0]).cross(&(points[2] - points[0]));
        if normal.norm() < 0.05 {
            return Ok(());
        }
        let b = see(&pose, &points);
        let found: Vec<Pose> = p3p(&[b[0], b[1], b[2]]).collect();
        prop_assert!(found.len() <= 4);
        let best = found.iter().map(|f| distance(f, &pose)).fold(f64::INFINITY, f64::min);
        for f in &found {
            for c in &b {
                let y = f.transform_point(&c.point.into());
                prop_assert!(y.z > 0.0);
                prop_assert!((y.xy().coords / y.z - c.image).norm() < 1e-5);
            }
        }
        // Near the danger cylinder two of the poses meet, and digits are lost.
        prop_assert!(best < 1e-3, "{best:e} of {}", found.len());
    }

    #[test]
    fn global_has_the_pose_first(points in points(6..30), pose in pose_at(4.0..10.0)) {
        if thickness(&points) < 0.3 {
            return Ok(());
        }
        let found = global(&see(&pose, &points)).unwrap();
        prop_assert!(distance(&found[0], &pose) < 1e-6, "{:e}", distance(&found[0], &pose));
    }

    #[test]
    fn dlt_is_exact(points in points(8..30), pose in pose_at(4.0..10.0), f in 500.0..3000.0_f64, skew in -5.0..5.0_f64) {
        if thickness(&points) < 0.5 {
            return Ok(());
        }
        let intrinsics = Intrinsics { fx: f, fy: 1.1 * f, cx: 600.0, cy: 400.0, skew };
        let camera = Camera { intrinsics, ..Camera::ideal(1200, 800, f) };
        let c: Vec<_> = points.iter().map(|p| Correspondence::new(*p, camera.project(&pose.transform_point(p)).unwrap())).collect();
        for p in [dlt(&c).unwrap(), resection(&c).unwrap()] {
            let (k, found) = p.decompose().unwrap();
            prop_assert!(distance(&found, &pose) < 1e-6);
            prop_assert!(k.to_array().iter().zip(intrinsics.to_array()).all(|(a, b)| (a - b).abs() < 1e-6 * f));
        }
    }

    /// The geometric minimum is one: no nearby pose or matrix is better, and the start does not matter.
    #[test]
    fn refinement_ends_in_a_minimum(points in points(8..20), pose in pose_at(4.0..10.0), noise in prop::collection::vec(-2.0..2.0_f64, 40), push in prop::array::uniform6(-0.05..0.05_f64)) {
        if thickness(&points) < 0.5 {
            return Ok(());
        }
        let camera = Camera::ideal(1200, 800, 1000.0);
        let c: Vec<_> = points.iter().enumerate().map(|(i, p)| {
            let pixel = camera.project(&pose.transform_point(p)).unwrap();
            Correspondence::new(*p, Point2::new(pixel.x + noise[2 * i], pixel.y + noise[2 * i + 1]))
        }).collect();
        let at = |pose: &Pose| refine(&c, &View { camera, pose: *pose }, &Refinement::default()).unwrap();
        let end = at(&pose);
        let pushed = texreg_lie::se3::exp(&push.into());
        prop_assert!((at(&(pushed * pose)).cost - end.cost).abs() < 1e-6 * end.cost);
        let error = |pose: &Pose| c.iter().map(|c| (camera.project(&pose.transform_point(&c.point)).unwrap() - c.pixel).norm_squared()).sum::<f64>();
        prop_assert!((error(&end.view.pose) - end.cost).abs() < 1e-9 * end.cost);
        for k in 0..6 {
            for sign in [-1e-4, 1e-4] {
                let mut step = nalgebra::Vector6::zeros();
                step[k] = sign;
                prop_assert!(error(&(texreg_lie::se3::exp(&step) * end.view.pose)) >= end.cost * (1.0 - 1e-12));
            }
        }
        // Eleven degrees of freedom fit better than six.
        let total = |p: &texreg_camera::ProjectionMatrix| c.iter().map(|c| (p.project(&c.point).unwrap() - c.pixel).norm_squared()).sum::<f64>();
        if let (Ok(linear), Ok(best)) = (dlt(&c), resection(&c)) {
            prop_assert!(total(&best) <= total(&linear) * (1.0 + 1e-9));
            prop_assert!(total(&best) <= end.cost * (1.0 + 1e-6));
        }
    }
}

/// The covariance is that of the poses found from repeated noise.
#[test]
fn covariance_predicts_the_scatter() {
    let camera = Camera::ideal(1200, 800, 1000.0);
    let pose = Pose::new(so3::exp(&Vector3::new(0.4, -0.3, 0.2)), Vector3::new(0.3, -0.2, 6.0));
    let points: Vec<Point3<f64>> = (0..12)
        .map(|i| {
            let t = f64::from(i);
            Point3::new((t * 1.7).sin(), (t * 2.3).cos(), (t * 0.9 + 0.5).sin()) + Vector3::new(3.0, -2.0, 5.0)
        })
        .collect();
    let pose = Pose::new(pose.rotation, pose.translation - pose.rotation * Vector3::new(3.0, -2.0, 5.0));
    let mut state = 1u64;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let rounds = 3000;
    let mut scatter = nalgebra::Matrix6::zeros();
    let mut predicted = nalgebra::Matrix6::zeros();
    for _ in 0..rounds {
        // The sum of twelve uniform numbers is nearly normal, with unit variance.
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let c: Vec<_> = points
            .iter()
            .map(|p| {
                let pixel = camera.project(&pose.transform_point(p)).unwrap();
                Correspondence::new(*p, Point2::new(pixel.x + normal(), pixel.y + normal()))
            })
            .collect();
        let found = refine(&c, &View { camera, pose }, &Refinement::default()).unwrap();
        let error = texreg_lie::se3::log(&(found.view.pose * pose.inverse()));
        scatter += error * error.transpose() / f64::from(rounds);
        predicted = found.covariance;
    }
    // In the coordinates in which the prediction is the identity, every variance is one.
    let whiten = predicted.cholesky().unwrap().l().try_inverse().unwrap();
    let ratio = (whiten * scatter * whiten.transpose()).symmetric_eigenvalues();
    assert!(ratio.min() > 0.85 && ratio.max() < 1.15, "{ratio}");
}

/// The two poses of a distant square are both reported, and near one another in error.
#[test]
fn ambiguous_squares_are_reported() {
    let camera = Camera::ideal(1200, 800, 1000.0);
    let square = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| Point3::new(x, y, 0.0));
    let pose = Pose::new(so3::exp(&Vector3::new(0.5, 0.1, 0.0)), Vector3::new(0.0, 0.0, 60.0));
    let jitter = [0.3, -0.2, 0.1, 0.25, -0.3, 0.2, -0.1, -0.25];
    let c: Vec<_> = square
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let pixel = camera.project(&pose.transform_point(p)).unwrap();
            Correspondence::new(*p, Point2::new(pixel.x + jitter[2 * i], pixel.y + jitter[2 * i + 1]))
        })
        .collect();
    let found = texreg_posit::pose(&c, &camera, &Options::default()).unwrap();
    let other = found.alternative.unwrap();
    let tilt = |p: &Pose| p.rotation.matrix().m23;
    assert!(tilt(&found.view.pose) * tilt(&other) < 0.0, "{found:?}");
    let near = |p: &Pose| so3::log(&(p.rotation * pose.rotation.inverse())).norm() < 0.4;
    assert!(near(&found.view.pose) || near(&other));
}

#[test]
fn degenerate_sets_have_no_solution() {
    let pose = Pose::new(so3::exp(&Vector3::new(0.5, 0.1, 0.0)), Vector3::new(0.0, 0.0, 6.0));
    let space = |f: &dyn Fn(f64) -> Point3<f64>| -> Vec<Bearing> {
        see(&pose, &(0..8).map(|i| f(f64::from(i) * 0.7)).collect::<Vec<_>>())
    };
    let solid = space(&|t| Point3::new(t.sin(), t.cos(), (2.0 * t).sin()));
    let flat = space(&|t| Point3::new(t.sin(), t.cos(), 0.0));
    let line = space(&|t| Point3::new(t - 2.0, 0.0, 0.1 * t));
    let mut nan = solid.clone();
    nan[3].image.x = f64::NAN;
    let still: Vec<Bearing> = solid.iter().map(|b| Bearing { image: solid[0].image, ..*b }).collect();
    let default = Iteration::default();
    assert_eq!(posit(&solid[..3], &default), Err(NoSolution::TooFew { usable: 3, needed: 4 }));
    assert_eq!(posit(&flat, &default), Err(NoSolution::Coplanar));
    assert_eq!(posit(&line, &default), Err(NoSolution::Collinear));
    assert_eq!(coplanar_posit(&line, &default), Err(NoSolution::Collinear));
    assert_eq!(posit(&nan, &default), Err(NoSolution::NotFinite));
    assert_eq!(posit(&still, &default), Err(NoSolution::OnePixel));
    assert_eq!(global(&line), Err(NoSolution::Collinear));
    assert_eq!(global(&nan), Err(NoSolution::NotFinite));
    assert_eq!(global(&still), Err(NoSolution::OnePixel));
    assert_eq!(p3p(&[line[0], line[1], line[2]]).count(), 0);
    let pixels = |b: &[Bearing]| -> Vec<Correspondence> {
        b.iter().map(|b| Correspondence::new(b.point.into(), (b.image * 1000.0).into())).collect()
    };
    assert_eq!(dlt(&pixels(&flat)), Err(NoSolution::Coplanar));
    assert_eq!(dlt(&pixels(&solid[..5])), Err(NoSolution::TooFew { usable: 5, needed: 6 }));
    assert_eq!(resection(&pixels(&nan)), Err(NoSolution::NotFinite));
    // A start with a point behind the camera is no start.
    let camera = Camera::ideal(100, 100, 1000.0);
    let behind = View { camera, pose: Pose::new(pose.rotation, Vector3::new(0.0, 0.0, 0.1)) };
    assert_eq!(refine(&pixels(&solid), &behind, &Refinement::default()), Err(NoSolution::BehindCamera));
}

#[test]
fn shapes() {
    let at = |thin: f64, wide: f64| -> Vec<Point3<f64>> {
        let turn = so3::exp(&Vector3::new(0.4, 1.0, -0.3));
        (0..20)
            .map(|i| {
                let t = f64::from(i) * 0.7;
                turn * Point3::new(t.cos(), wide * (1.3 * t).sin(), thin * (2.1 * t).sin())
                    + Vector3::new(7.0, 8.0, 9.0)
            })
            .collect()
    };
    assert_eq!(shape(&at(1.0, 1.0)), Some(Shape::Solid));
    assert_eq!(shape(&at(0.01, 1.0)), Some(Shape::NearlyCoplanar));
    assert_eq!(shape(&at(0.0, 1.0)), Some(Shape::Coplanar));
    assert_eq!(shape(&at(0.0, 0.0)), Some(Shape::Collinear));
    assert_eq!(shape(&[Point3::origin(); 5]), Some(Shape::Collinear));
    assert_eq!(shape(&[]), None);
    assert_eq!(shape(&[Point3::new(f64::INFINITY, 0.0, 0.0); 5]), None);
}
