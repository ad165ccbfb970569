//! The projection matrix, undistortion and two views.

use nalgebra::{Matrix3x4, Point2, Point3, Vector3, Vector6};
use proptest::prelude::*;
use texreg_camera::*;
use texreg_lie::check::{differences, discrepancy};
use texreg_lie::{Pose, se3};

prop_compose! {
    fn view()(
        f in 300.0..3000.0_f64, aspect in 0.8..1.2_f64, c in prop::array::uniform2(0.0..1000.0_f64), skew in -20.0..20.0_f64,
        x in prop::array::uniform6(-1.0..1.0_f64), k in prop::array::uniform2(-0.1..0.1_f64),
    ) -> View {
        let pose = Pose::new(se3::exp(&(Vector6::from(x) * 1.5)).rotation, Vector3::new(x[3], x[4], 6.0 + x[5]));
        let intrinsics = Intrinsics { fx: f, fy: f * aspect, cx: c[0], cy: c[1], skew };
        let distortion = Distortion { k1: k[0], k2: k[1], p1: 1e-3, p2: -1e-3, k3: 0.0 };
        View { camera: Camera { width: 1000, height: 1000, intrinsics, distortion }, pose }
    }
}

fn point() -> impl Strategy<Value = Point3<f64>> {
    prop::array::uniform3(-1.5..1.5_f64).prop_map(Point3::from)
}

proptest! {
    #[test]
    fn matrix_is_the_undistorted_view(view in view(), point in point(), scale in prop_oneof![-9.0..-0.1_f64, 0.1..9.0_f64]) {
        let view = View { camera: view.camera.without_distortion(), ..view };
        let p = ProjectionMatrix(ProjectionMatrix::new(&view.camera.intrinsics, &view.pose).0 * scale);
        prop_assert!((p.project(&point).unwrap() - view.project(&point).unwrap()).norm() < 1e-9);
        prop_assert!((p.center().unwrap() - view.pose.center()).norm() < 1e-11);
        let (intrinsics, pose) = p.decompose().unwrap();
        for (a, b) in intrinsics.to_array().iter().zip(view.camera.intrinsics.to_array()) {
            prop_assert!((a - b).abs() < 1e-10 * 3000.0);
        }
        prop_assert!((pose.matrix() - view.pose.matrix()).norm() < 1e-11);
        // Behind the camera there is nothing, whatever the sign of P.
        let behind = view.pose.center() + (view.pose.center() - point);
        prop_assert!(p.project(&behind).is_none());
        let numeric = differences(|m| {
            ProjectionMatrix(Matrix3x4::from_column_slice(m)).project(&point).map_or(vec![f64::NAN; 2], |p| p.coords.as_slice().to_vec())
        }, p.0.as_slice(), 1e-4);
        prop_assert!(discrepancy(&p.project_with_jacobian(&point).unwrap().1, &numeric) < 1e-8);
    }

    #[test]
    fn formulations(view in view(), point in point()) {
        for formulation in [Formulation::Pose, Formulation::PoseAndIntrinsics, Formulation::All] {
            let n = formulation.dimension();
            let Some((pixel, jacobian)) = formulation.project_with_jacobian(&view, &point) else { continue };
            prop_assert_eq!(view.project(&point), Some(pixel));
            let numeric = differences(|step| {
                let moved = formulation.step(&view, step).unwrap();
                moved.project(&point).map_or(vec![f64::NAN; 2], |p| p.coords.as_slice().to_vec())
            }, &vec![0.0; n], 1e-4);
            prop_assert!(discrepancy(&jacobian, &numeric) < 1e-7);
            prop_assert!(formulation.step(&view, &vec![0.0; n + 1]).is_none());
        }
    }

    #[test]
    fn undistortion_of_points(view in view(), u in 0.0..1000.0_f64, v in 0.0..1000.0_f64) {
        let pixel = Point2::new(u, v);
        if let Some(straight) = view.camera.undistort(&pixel) {
            prop_assert!((view.camera.distort(&straight).unwrap() - pixel).norm() < 1e-8);
        }
    }

    #[test]
    fn pairs_lie_on_epipolar_lines(a in view(), b in view(), point in point(), shift in -20.0..20.0_f64) {
        let (a, b) = (View { camera: a.camera.without_distortion(), ..a }, View { camera: b.camera.without_distortion(), ..b });
        prop_assume!((a.pose.center() - b.pose.center()).norm() > 0.5);
        let f = fundamental(&a, &b).unwrap();
        let (p, q) = (a.project(&point).unwrap(), b.project(&point).unwrap());
        let line = epipolar_line(&f, &p);
        prop_assume!(line.is_some() && p.coords.norm() < 1e4 && q.coords.norm() < 1e4);
        prop_assert!(epipolar_distance(&f, &p, &q).unwrap().abs() < 1e-6);
        prop_assert!(sampson_distance(&f, &p, &q).unwrap().abs() < 1e-6);
        // Moved off the line, the distance is how far.
        let normal = line.unwrap().xy();
        let off = epipolar_distance(&f, &p, &(q + normal * shift)).unwrap();
        prop_assert!((off - shift).abs() < 1e-6);
        // Pixels of one and the same world point agree with E as well.
        let e = essential(&(b.pose * a.pose.inverse()));
        let (x, y) = (a.camera.unproject(&p).unwrap(), b.camera.unproject(&q).unwrap());
        prop_assert!(y.dot(&(e * x)).abs() < 1e-9);
    }

    #[test]
    fn normalization(points in prop::collection::vec(prop::array::uniform3(-1e4..1e4_f64), 3..20)) {
        let space: Vec<_> = points.iter().map(|p| Point3::from(*p)).collect();
        let plane: Vec<_> = points.iter().map(|p| Point2::new(p[0], p[1])).collect();
        let (a, b) = (normalize_space(&space), normalize_plane(&plane));
        let moved: Vec<_> = space.iter().map(|p| a.transform_point(p)).collect();
        let mean = moved.iter().fold(Vector3::zeros(), |s, p| s + p.coords) / moved.len() as f64;
        let spread = moved.iter().map(|p| p.coords.norm_squared()).sum::<f64>() / moved.len() as f64;
        prop_assert!(mean.norm() < 1e-9 && (spread - 3.0).abs() < 1e-9);
        let flat = plane.iter().map(|p| b.transform_point(p).coords.norm_squared()).sum::<f64>() / plane.len() as f64;
        prop_assert!((flat - 2.0).abs() < 1e-9);
    }
}

#[test]
fn degenerate_matrices_have_no_camera() {
    assert!(ProjectionMatrix(Matrix3x4::zeros()).decompose().is_none());
    let affine = Matrix3x4::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    assert!(ProjectionMatrix(affine).decompose().is_none());
    assert!(ProjectionMatrix(affine).center().is_none());
    assert!(ProjectionMatrix(Matrix3x4::repeat(f64::NAN)).decompose().is_none());
    let view = View { camera: Camera::ideal(10, 10, 10.0), pose: Pose::identity() };
    assert!(fundamental(&view, &view).is_none());
}

/// A ramp, which bilinear interpolation reproduces, seen through a lens and straightened again.
#[test]
fn undistortion_of_images() {
    let camera = Camera { distortion: Distortion { k1: -0.2, ..Distortion::default() }, ..Camera::ideal(80, 60, 60.0) };
    let straight = camera.without_distortion();
    // The lens shows at each pixel the undistorted coordinates of what it sees there.
    let mut values = Vec::new();
    for v in 0..60 {
        for u in 0..80 {
            let p = camera.undistort(&Point2::new(f64::from(u), f64::from(v))).unwrap();
            values.extend([p.x as f32, p.y as f32]);
        }
    }
    let image = Samples { width: 80, height: 60, channels: 2, values: &values };
    let out = rectify(&image, &camera, &straight).unwrap();
    for (i, pair) in out.chunks(2).enumerate() {
        let (u, v) = ((i % 80) as f32, (i / 80) as f32);
        let seen = camera.distort(&Point2::new(f64::from(u), f64::from(v))).is_some_and(|p| camera.contains(&p));
        assert_eq!(seen, !pair[0].is_nan(), "{u} {v}");
        let inside = (1.0..79.0).contains(&u) && (1.0..59.0).contains(&v);
        assert!(
            !inside || pair[0].is_nan() || ((pair[0] - u).abs() < 0.02 && (pair[1] - v).abs() < 0.02),
            "{u} {v} {pair:?}"
        );
    }
    assert!(rectify(&Samples { width: 79, ..image }, &camera, &straight).is_none());
}
