//! Projection against its inverse, its derivatives against differences, and its domain.

use nalgebra::{Point2, Point3, Vector2, Vector6};
use proptest::prelude::*;
use texreg_camera::{Camera, Distortion, Intrinsics, View};
use texreg_lie::check::{differences, discrepancy};
use texreg_lie::se3;

prop_compose! {
    fn camera()(
        f in 300.0..3000.0_f64, aspect in 0.8..1.2_f64, c in prop::array::uniform2(-50.0..50.0_f64), skew in -20.0..20.0_f64,
        k in prop::array::uniform3(-0.3..0.3_f64), p in prop::array::uniform2(-0.005..0.005_f64),
    ) -> Camera {
        Camera {
            width: 1600,
            height: 1200,
            intrinsics: Intrinsics { fx: f, fy: f * aspect, cx: 800.0 + c[0], cy: 600.0 + c[1], skew },
            distortion: Distortion { k1: k[0], k2: k[1], p1: p[0], p2: p[1], k3: k[2] },
        }
    }
}

prop_compose! {
    fn point()(xy in prop::array::uniform2(-0.8..0.8_f64), z in 0.3..20.0_f64) -> Point3<f64> {
        Point3::new(xy[0] * z, xy[1] * z, z)
    }
}

proptest! {
    #[test]
    fn unproject_inverts_project(camera in camera(), point in point()) {
        if let Some(pixel) = camera.project(&point) {
            let determinant = camera.project_with_jacobian(&point).unwrap().1.fixed_view::<2, 2>(0, 0).determinant();
            let singular = determinant * point.z * point.z / (camera.intrinsics.fx * camera.intrinsics.fy);
            let ray = camera.unproject(&pixel).unwrap();
            let error = (ray.xy() - point.coords.xy() / point.z).norm();
            prop_assert!(error < 1e-13 / singular.min(1.0).powi(2), "{error:e} {singular}");
        }
    }

    #[test]
    fn project_inverts_unproject(camera in camera(), u in -0.5..1599.5_f64, v in -0.5..1199.5_f64) {
        if let Some(ray) = camera.unproject(&Point2::new(u, v)) {
            let pixel = camera.project(&Point3::from(ray * 2.5)).unwrap();
            prop_assert!((pixel - Point2::new(u, v)).norm() < 1e-8);
        }
    }

    #[test]
    fn jacobians(camera in camera(), point in point(), x in prop::array::uniform6(-0.5..0.5_f64)) {
        let pose = se3::exp(&Vector6::from(x));
        let world = pose.inverse().transform_point(&point);
        let view = View { camera, pose };
        let safe = camera.distortion.domain() > 1.05 * (point.x.powi(2) + point.y.powi(2)) / point.z.powi(2);
        if let (true, Some(p)) = (safe, camera.project_with_jacobians(&point)) {
            let flat = |p: Option<Point2<f64>>| p.map_or(vec![f64::NAN; 2], |p| p.coords.as_slice().to_vec());
            let h = 1e-4;
            let by_point = differences(|x| flat(camera.project(&Point3::from_slice(x))), point.coords.as_slice(), h * point.z);
            prop_assert!(discrepancy(&p.point, &by_point) < 1e-8);
            let by_intrinsics = differences(|x| {
                let camera = Camera { intrinsics: <[f64; 5]>::try_from(x).unwrap().into(), ..camera };
                flat(camera.project(&point))
            }, &camera.intrinsics.to_array(), 1e-2);
            prop_assert!(discrepancy(&p.intrinsics, &by_intrinsics) < 1e-8);
            let by_distortion = differences(|x| {
                let camera = Camera { distortion: <[f64; 5]>::try_from(x).unwrap().into(), ..camera };
                flat(camera.project(&point))
            }, &camera.distortion.to_array(), 1e-4);
            prop_assert!(discrepancy(&p.distortion, &by_distortion) < 1e-8);
            let by_pose = differences(|x| {
                flat(View { camera, pose: se3::exp(&Vector6::from_column_slice(x)) * pose }.project(&world))
            }, &[0.0; 6], h);
            prop_assert!(discrepancy(&view.project_with_jacobian(&world).unwrap().1, &by_pose) < 1e-7);
            prop_assert_eq!(camera.project(&point), Some(p.pixel));
        }
    }

    /// The domain ends where the radius stops growing, and no earlier.
    #[test]
    fn domain_is_where_the_radius_grows(k in prop::array::uniform3(-1.0..1.0_f64)) {
        let d = Distortion { k1: k[0], k2: k[1], k3: k[2], ..Default::default() };
        let limit = d.domain();
        let slope = |s: f64| 1.0 + 3.0 * k[0] * s + 5.0 * k[1] * s * s + 7.0 * k[2] * s * s * s;
        for i in 0..=1000 {
            let s = limit.min(20.0) * 0.9999 * f64::from(i) / 1000.0;
            prop_assert!(slope(s) > 0.0);
            prop_assert!(d.apply(&Vector2::new(s.sqrt(), 0.0)).is_some());
        }
        if limit.is_finite() {
            prop_assert!(slope(limit).abs() < 1e-9 * (1.0 + limit.powi(3)));
            prop_assert!(d.apply(&Vector2::new((limit * 1.0001).sqrt(), 0.0)).is_none());
            // Also far out, where the polynomial may rise again.
            prop_assert!(d.apply(&Vector2::new((limit * 30.0).sqrt(), 0.0)).is_none());
        }
    }
}

#[test]
fn points_that_are_not_seen() {
    let camera = Camera::ideal(640, 480, 500.0);
    for z in [0.0, -1.0, f64::NAN, f64::NEG_INFINITY] {
        assert!(camera.project(&Point3::new(0.1, 0.1, z)).is_none(), "{z}");
    }
    assert!(camera.project(&Point3::new(f64::NAN, 0.0, 1.0)).is_none());
    assert!(camera.project(&Point3::new(1e300, 0.0, 1e-300)).is_none());
    assert!(camera.unproject(&Point2::new(f64::NAN, 0.0)).is_none());
    // r_d = r − r³/2 peaks at r² = 2/3; nothing is seen beyond 0.544.
    let fold = Camera { distortion: Distortion { k1: -0.5, ..Default::default() }, ..camera };
    assert!(fold.project(&Point3::new(0.82, 0.0, 1.0)).is_none());
    assert!(fold.project(&Point3::new(0.81, 0.0, 1.0)).is_some());
    let center = fold.intrinsics.cx;
    assert!(fold.unproject(&Point2::new(center + 500.0 * 0.5440, 239.5)).is_some());
    assert!(fold.unproject(&Point2::new(center + 500.0 * 0.5444, 239.5)).is_none());
}

/// Halving an image puts the new pixel (0, 0) between the old (0, 0) and (1, 1).
#[test]
fn scaling_keeps_the_image_together() {
    let camera = Camera::ideal(640, 480, 500.0);
    let half = camera.scaled(0.5);
    assert_eq!((half.width, half.height), (320, 240));
    assert_eq!(half.intrinsics, Camera::ideal(320, 240, 250.0).intrinsics);
    let point = Point3::new(0.3, -0.2, 1.7);
    let (fine, coarse) = (camera.project(&point).unwrap(), half.project(&point).unwrap());
    assert!(((fine.coords.add_scalar(0.5)) * 0.5 - coarse.coords.add_scalar(0.5)).norm() < 1e-12);
    assert!(camera.contains(&Point2::new(-0.5, 479.4)) && !camera.contains(&Point2::new(639.5, 0.0)));
}
