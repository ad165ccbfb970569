//! The laws of the two groups: exp and log, the Jacobians against differences, adjoint, interpolation.

use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};
use proptest::prelude::*;
use texreg_lie::check::{differences, discrepancy};
use texreg_lie::{Pose, se3, so3};

fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1.0..1.0_f64).prop_map(move |a| Vector3::from(a) * limit)
}

/// Rotation vectors of every size below π, with the awkward ones common.
fn omega() -> impl Strategy<Value = Vector3<f64>> {
    let angle = prop_oneof![
        0.0..std::f64::consts::PI,
        Just(0.0),
        (-18.0..0.0_f64).prop_map(|e| 10f64.powf(e)),
        (-12.0..-1.0_f64).prop_map(|e| std::f64::consts::PI - 10f64.powf(e)),
    ];
    (vector(1.0), angle).prop_filter_map("axis", |(axis, angle)| axis.try_normalize(1e-3).map(|axis| axis * angle))
}

fn tangent() -> impl Strategy<Value = Vector6<f64>> {
    (omega(), vector(3.0)).prop_map(|(w, t)| Vector6::new(w.x, w.y, w.z, t.x, t.y, t.z))
}

fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    omega().prop_map(|w| so3::exp(&w))
}

fn pose() -> impl Strategy<Value = Pose> {
    tangent().prop_map(|t| se3::exp(&t))
}

fn distance(a: &Pose, b: &Pose) -> f64 {
    (a.matrix() - b.matrix()).norm()
}

proptest! {
    #[test]
    fn rotations_are_orthogonal(w in omega()) {
        let r = so3::exp(&w).into_inner();
        prop_assert!((r * r.transpose() - Matrix3::identity()).norm() < 1e-14);
        prop_assert!((r.determinant() - 1.0).abs() < 1e-14);
    }

    #[test]
    fn logarithm_inverts_exponential(w in omega()) {
        let back = so3::log(&so3::exp(&w));
        // Near π the two ends of the axis are the same rotation.
        let error = (back - w).norm().min((back + w * (2.0 * std::f64::consts::PI / w.norm().max(1e-9) - 1.0)).norm());
        prop_assert!(error < 1e-14, "{error:e}");
        // Small vectors keep their relative precision.
        prop_assert!(w.norm() > 1.0 || (back - w).norm() <= 1e-14 * w.norm().max(1e-2), "{w:?} {back:?}");
    }

    #[test]
    fn exponential_inverts_logarithm(r in rotation()) {
        prop_assert!((so3::exp(&so3::log(&r)).matrix() - r.matrix()).norm() < 1e-14);
    }

    #[test]
    fn so3_jacobians(w in omega()) {
        let r = so3::exp(&w);
        let left = differences(|x| {
            so3::log(&(so3::exp(&Vector3::from_column_slice(x)) * r.inverse())).as_slice().to_vec()
        }, w.as_slice(), 1e-3);
        prop_assert!(discrepancy(&so3::left_jacobian(&w), &left) < 1e-10);
        let right = differences(|x| {
            so3::log(&(r.inverse() * so3::exp(&Vector3::from_column_slice(x)))).as_slice().to_vec()
        }, w.as_slice(), 1e-3);
        prop_assert!(discrepancy(&so3::right_jacobian(&w), &right) < 1e-10);
        prop_assert!((so3::left_jacobian(&w) * so3::left_jacobian_inverse(&w) - Matrix3::identity()).norm() < 1e-13);
        prop_assert!((so3::right_jacobian(&w) * so3::right_jacobian_inverse(&w) - Matrix3::identity()).norm() < 1e-13);
        prop_assert!((r.matrix() * so3::right_jacobian(&w) - so3::left_jacobian(&w)).norm() < 1e-14);
    }

    #[test]
    fn se3_exponential_and_logarithm(x in tangent()) {
        let pose = se3::exp(&x);
        prop_assert!(distance(&se3::exp(&se3::log(&pose)), &pose) < 3e-14);
    }

    #[test]
    fn se3_jacobians(x in tangent()) {
        let inverse = se3::exp(&x).inverse();
        let f = |y: &[f64]| se3::exp(&Vector6::from_column_slice(y));
        let left = differences(|y| se3::log(&(f(y) * inverse)).as_slice().to_vec(), x.as_slice(), 1e-3);
        prop_assert!(discrepancy(&se3::left_jacobian(&x), &left) < 1e-9);
        let right = differences(|y| se3::log(&(inverse * f(y))).as_slice().to_vec(), x.as_slice(), 1e-3);
        prop_assert!(discrepancy(&se3::right_jacobian(&x), &right) < 1e-9);
        prop_assert!((se3::left_jacobian(&x) * se3::left_jacobian_inverse(&x) - Matrix6::identity()).norm() < 1e-12);
        prop_assert!((se3::right_jacobian(&x) * se3::right_jacobian_inverse(&x) - Matrix6::identity()).norm() < 1e-12);
    }

    #[test]
    fn adjoints_carry_tangents(a in pose(), x in tangent()) {
        let small = x * 0.3;
        let carried = se3::exp(&(se3::adjoint(&a) * small));
        prop_assert!(distance(&(a * se3::exp(&small) * a.inverse()), &carried) < 1e-12);
    }

    #[test]
    fn group_axioms(a in pose(), b in pose(), c in pose(), p in vector(5.0)) {
        prop_assert!(distance(&((a * b) * c), &(a * (b * c))) < 1e-13);
        prop_assert!(distance(&(a * a.inverse()), &Pose::identity()) < 1e-13);
        prop_assert_eq!(a * Pose::identity(), a);
        let p = p.into();
        prop_assert!(((a * b).transform_point(&p) - a.transform_point(&b.transform_point(&p))).norm() < 1e-13);
        prop_assert!(a.transform_point(&a.center()).coords.norm() < 1e-13);
    }

    #[test]
    fn interpolation_is_even(a in pose(), b in pose(), s in 0.0..1.0_f64) {
        prop_assert!(distance(&se3::interpolate(&a, &b, 0.0), &a) < 1e-12);
        prop_assert!(distance(&se3::interpolate(&a, &b, 1.0), &b) < 1e-12);
        let (whole, part) = (b.rotation * a.rotation.inverse(), so3::interpolate(&a.rotation, &b.rotation, s) * a.rotation.inverse());
        prop_assert!((so3::log(&part).norm() - s * so3::log(&whole).norm()).abs() < 1e-12);
    }

    #[test]
    fn nearest_is_nearest(r in rotation(), noise in prop::array::uniform9(-0.2..0.2_f64), other in omega()) {
        let m = r.matrix() + Matrix3::from_column_slice(&noise);
        let best = so3::nearest(&m).unwrap();
        prop_assert!((best.matrix() * best.matrix().transpose() - Matrix3::identity()).norm() < 1e-13);
        let rival = so3::exp(&(other * 0.1)) * best;
        prop_assert!((m - best.matrix()).norm() <= (m - rival.matrix()).norm() + 1e-14);
    }
}

#[test]
fn logarithm_at_a_half_turn() {
    for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(2.0, -1.0, 2.0) / 3.0] {
        let half = 2.0 * axis * axis.transpose() - Matrix3::identity();
        let w = so3::log(&Rotation3::from_matrix_unchecked(half));
        assert!((w.norm() - std::f64::consts::PI).abs() < 1e-15);
        assert!(w.cross(&axis).norm() < 1e-14);
    }
}

#[test]
fn nearest_refuses_the_arbitrary() {
    assert!(so3::nearest(&Matrix3::zeros()).is_none());
    assert!(so3::nearest(&(Vector3::x() * Vector3::y().transpose())).is_none());
    assert!(so3::nearest(&Matrix3::repeat(f64::NAN)).is_none());
    // A reflection's nearest rotations are many.
    assert!(so3::nearest(&-Matrix3::identity()).is_none());
}
