//! Bundle adjustment on scenes made up here: against dense normal equations, and for what it promises.

use nalgebra::{DMatrix, DVector, Point3, Vector2, Vector3};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use texreg_bundle::{
    BalError, Bundle, BundleAdjustment, Columns, INTRINSICS, Observation, ReprojectionError, Snavely, SnavelyCamera,
    fixed_gauge, read_bal, write_bal,
};
use texreg_lie::so3;
use texreg_optim::{Loss, Stop};

/// Cameras in a ring around a cloud of points, each seen by most of them; perfect pixels but for the noise.
fn scene(cameras: usize, points: usize, noise: f64) -> Bundle<SnavelyCamera> {
    let mut rng = StdRng::seed_from_u64(11);
    let mut uniform = |half: f64| rng.random_range(-half..half);
    let points: Vec<Point3<f64>> = (0..points).map(|_| Point3::new(uniform(1.0), uniform(1.0), uniform(1.0))).collect();
    let cameras: Vec<SnavelyCamera> = (0..cameras)
        .map(|i| {
            let turn = so3::log(&so3::exp(&Vector3::new(0.0, 0.7 * i as f64, 0.0)));
            let tilt = Vector3::new(uniform(0.05), uniform(0.05), uniform(0.05));
            let [a, b, c] = (turn + tilt).into();
            let z = -5.0 + uniform(0.3);
            SnavelyCamera::from_array([a, b, c, uniform(0.1), uniform(0.1), z, 900.0, -0.05, 0.01])
        })
        .collect();
    let mut observations = Vec::new();
    for (p, point) in points.iter().enumerate() {
        for (c, camera) in cameras.iter().enumerate().filter(|(c, _)| (p + c) % 3 > 0) {
            let pixel = camera.project(point).unwrap() + Vector2::new(uniform(1.0), uniform(1.0)) * noise;
            observations.push(Observation { camera: c as u32, point: p as u32, pixel });
        }
    }
    Bundle { cameras, points, observations }
}

/// The scene with everything a little off.
fn disturbed(mut bundle: Bundle<SnavelyCamera>) -> Bundle<SnavelyCamera> {
    let mut rng = StdRng::seed_from_u64(12);
    let mut uniform = |half: f64| rng.random_range(-half..half);
    for camera in &mut bundle.cameras {
        let mut step = nalgebra::SVector::<f64, 9>::zeros();
        (0..3).for_each(|k| step[k] = uniform(0.02));
        (3..6).for_each(|k| step[k] = uniform(0.05));
        *camera = Snavely.retract(camera, &step);
    }
    bundle.points.iter_mut().for_each(|point| *point += Vector3::new(uniform(0.05), uniform(0.05), uniform(0.05)));
    bundle
}

/// The Jacobian of all residuals by the columns, then by the points, and the residuals.
fn dense(bundle: &Bundle<SnavelyCamera>, columns: &Columns<9>) -> (DMatrix<f64>, DVector<f64>) {
    let n = columns.count();
    let rows = 2 * bundle.observations.len();
    let mut jacobian = DMatrix::zeros(rows, n + 3 * bundle.points.len());
    let mut residuals = DVector::zeros(rows);
    for (row, o) in bundle.observations.iter().enumerate() {
        let (c, p) = (o.camera as usize, o.point as usize);
        let (residual, a, b) = Snavely.linearize(&bundle.cameras[c], &bundle.points[p], &o.pixel).unwrap();
        for r in 0..2 {
            residuals[2 * row + r] = residual[r];
            for k in 0..9 {
                if let Some(column) = columns.column(c, k) {
                    jacobian[(2 * row + r, column)] += a[(r, k)];
                }
            }
            (0..3).for_each(|k| jacobian[(2 * row + r, n + 3 * p + k)] = b[(r, k)]);
        }
    }
    (jacobian, residuals)
}

#[test]
fn jacobians_agree_with_differences() {
    let bundle = scene(3, 20, 0.5);
    for o in &bundle.observations {
        let (camera, point) = (bundle.cameras[o.camera as usize], bundle.points[o.point as usize]);
        let (_, a, b) = Snavely.linearize(&camera, &point, &o.pixel).unwrap();
        let at = |x: &[f64]| {
            let moved = Snavely.retract(&camera, &nalgebra::SVector::<f64, 9>::from_column_slice(&x[..9]));
            let residual = Snavely.residual(&moved, &(point + Vector3::from_column_slice(&x[9..])), &o.pixel).unwrap();
            vec![residual.x, residual.y]
        };
        let numeric = texreg_lie::check::differences(at, &[0.0; 12], 1e-3);
        let scale = numeric.amax();
        assert!((numeric.columns(0, 9) - a).amax() < 1e-8 * scale && (numeric.columns(9, 3) - b).amax() < 1e-8 * scale);
    }
}

/// One damped step, against that of the dense normal equations.
fn check_step(start: &Bundle<SnavelyCamera>, columns: &Columns<9>) {
    let damping = 1e-2;
    let adjustment = BundleAdjustment { iterations: 1, damping, ..BundleAdjustment::default() };
    let report = adjustment.adjust(&Snavely, start.clone(), columns, &mut |_| ()).unwrap();
    assert!(report.value > report.start);
    let (jacobian, residuals) = dense(start, columns);
    assert!((report.start + 0.5 * residuals.norm_squared()).abs() < 1e-9 * residuals.norm_squared());
    let mut normal = jacobian.transpose() * &jacobian;
    (0..normal.nrows()).for_each(|i| normal[(i, i)] += damping * normal[(i, i)].max(1e-6));
    let step = normal.cholesky().unwrap().solve(&-(jacobian.transpose() * residuals));
    let n = columns.count();
    for (p, (from, to)) in start.points.iter().zip(&report.point.points).enumerate() {
        assert!((to - from - step.rows(n + 3 * p, 3)).norm() < 1e-9 * step.norm(), "point {p}");
    }
    for (c, (from, to)) in start.cameras.iter().zip(&report.point.cameras).enumerate() {
        for (k, moved) in [(6, to.focal - from.focal), (7, to.k1 - from.k1), (8, to.k2 - from.k2)] {
            let expected = columns.column(c, k).map_or(0.0, |column| step[column]);
            assert!((moved - expected).abs() < 1e-9 * step.norm(), "camera {c}, parameter {k}");
        }
    }
}

#[test]
fn one_step_is_the_dense_step() {
    let start = disturbed(scene(5, 40, 0.5));
    check_step(&start, &fixed_gauge(&start.cameras, Columns::own(5)).unwrap());
    check_step(&start, &fixed_gauge(&start.cameras, Columns::shared(5, INTRINSICS)).unwrap());
    check_step(&start, &Columns::shared(5, 6..7).fix(2, 8).fix(1, 7));
}

#[test]
fn one_step_of_a_sparse_system_is_the_dense_step() {
    // Each point is seen by a few neighbours of a long chain.
    let mut bundle = scene(40, 160, 0.3);
    bundle.observations.retain(|o| (o.camera as usize).abs_diff(o.point as usize / 4) < 3);
    let start = disturbed(bundle);
    check_step(&start, &Columns::own(40));
    check_step(&start, &Columns::shared(40, 6..7));
}

#[test]
fn perfect_pixels_bring_the_scene_back() {
    let truth = scene(8, 60, 0.0);
    let start = disturbed(truth.clone());
    for columns in [Columns::own(8), fixed_gauge(&start.cameras, Columns::shared(8, INTRINSICS)).unwrap()] {
        let report = BundleAdjustment::default().adjust(&Snavely, start.clone(), &columns, &mut |_| ()).unwrap();
        assert!(report.value > -1e-6, "{:?} {}", report.stop, report.value);
        assert!(report.iterations.iter().filter(|i| i.accepted).count() >= 3);
        let focals: Vec<f64> = report.point.cameras.iter().map(|camera| camera.focal).collect();
        assert!(focals.iter().all(|f| (f - 900.0).abs() < 1.0), "{focals:?}");
    }
    let shared = Columns::shared(8, INTRINSICS);
    let report = BundleAdjustment::default().adjust(&Snavely, start, &shared, &mut |_| ()).unwrap();
    assert!(report.point.cameras.windows(2).all(|w| w[0].focal == w[1].focal && w[0].k1 == w[1].k1));
}

#[test]
fn what_is_fixed_does_not_move() {
    let start = disturbed(scene(6, 50, 0.5));
    let columns = fixed_gauge(&start.cameras, Columns::own(6)).unwrap();
    assert_eq!(columns.count(), 6 * 9 - 7);
    let report = BundleAdjustment::default().adjust(&Snavely, start.clone(), &columns, &mut |_| ()).unwrap();
    assert!(report.value > report.start);
    assert_eq!(report.point.cameras[0].pose, start.cameras[0].pose);
}

#[test]
fn the_covariance_is_that_of_the_dense_inverse() {
    let bundle = scene(5, 40, 0.5);
    let columns = fixed_gauge(&bundle.cameras, Columns::shared(5, INTRINSICS)).unwrap();
    let found = BundleAdjustment::default().covariance(&Snavely, &bundle, &columns).unwrap();
    let (jacobian, _) = dense(&bundle, &columns);
    let inverse = (jacobian.transpose() * jacobian).cholesky().unwrap().inverse();
    let n = columns.count();
    for i in 0..n {
        for j in 0..n {
            let scale = (inverse[(i, i)] * inverse[(j, j)]).sqrt();
            assert!((found[(i, j)] - inverse[(i, j)]).abs() < 1e-6 * scale, "{i}, {j}");
        }
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let start = disturbed(scene(8, 1500, 0.5));
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            BundleAdjustment::default().adjust(&Snavely, start.clone(), &Columns::own(8), &mut |_| ()).unwrap().point
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn robust_losses_outvote_wrong_pixels() {
    let truth = scene(8, 60, 0.1);
    let mut start = disturbed(truth);
    for o in start.observations.iter_mut().step_by(17) {
        o.pixel += Vector2::new(80.0, -60.0);
    }
    let columns = fixed_gauge(&start.cameras, Columns::shared(8, INTRINSICS)).unwrap();
    let focal = |loss: Loss| {
        let adjustment = BundleAdjustment { loss, ..BundleAdjustment::default() };
        adjustment.adjust(&Snavely, start.clone(), &columns, &mut |_| ()).unwrap().point.cameras[0].focal
    };
    let (plain, robust) = (focal(Loss::Squared), focal(Loss::Cauchy(1.0)));
    assert!((robust - 900.0).abs() < 1.0 && (plain - 900.0).abs() > 2.0, "{plain} {robust}");
}

#[test]
fn bal_files_come_back() {
    let bundle = scene(4, 10, 0.5);
    let back = read_bal(&write_bal(&bundle)).unwrap();
    assert_eq!(back.observations, bundle.observations);
    assert_eq!(back.points, bundle.points);
    for (a, b) in back.cameras.iter().zip(&bundle.cameras) {
        assert!(a.to_array().iter().zip(b.to_array()).all(|(a, b)| (a - b).abs() < 1e-12 * b.abs().max(1.0)));
    }
}

#[test]
fn broken_bal_files_are_named() {
    let good = write_bal(&scene(2, 3, 0.5));
    let error = |text: &str| read_bal(text).unwrap_err();
    assert_eq!(error("").to_string(), "ends where number of cameras should be");
    assert_eq!(error("2 x 5").to_string(), "line 1: 'x' is no number of points");
    assert_eq!(error("1 1 1\n0 3 1 1").to_string(), "line 2: point 3 of 1");
    assert_eq!(error("1 1 1\n0 0 1 nan"), BalError::NoNumber { line: 2, text: "nan".into(), what: "pixel" });
    assert!(matches!(error("4000000000 4000000000 4000000000"), BalError::Ends("camera")));
    assert!(matches!(error(&good[..good.len() - 30]), BalError::Ends(_) | BalError::NoNumber { .. }));
    assert!(matches!(error(&format!("{good} 7")), BalError::Follows { .. }));
    // Cut anywhere, it is an error or (within the last number) still a problem: never a panic.
    for end in (0..good.len()).step_by(7) {
        let _ = read_bal(&good[..end]);
    }
}

#[test]
fn what_cannot_be_adjusted_has_no_report() {
    let mut bundle = scene(2, 3, 0.0);
    let adjustment = BundleAdjustment::default();
    assert!(adjustment.adjust(&Snavely, bundle.clone(), &Columns::own(3), &mut |_| ()).is_none());
    let done = adjustment.adjust(&Snavely, bundle.clone(), &Columns::own(2), &mut |_| ()).unwrap();
    assert_eq!(done.stop, Stop::Converged);
    bundle.observations[0].point = 9;
    assert!(adjustment.adjust(&Snavely, bundle, &Columns::own(2), &mut |_| ()).is_none());
}
