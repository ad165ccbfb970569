//! The laws of every chart, on rotations and carried over to poses.

use nalgebra::{DMatrix, Matrix3, Point3, Rotation3, Vector3, Vector6};
use proptest::prelude::*;
use std::f64::consts::PI;
use texreg_lie::check::{differences, discrepancy};
use texreg_lie::{Around, AxisAngle, Chart, Euler, InMatrices, InQuaternions, Left, Pose, se3, so3};

type RotationChart = Box<dyn Chart<Rotation3<f64>>>;

fn rotation_charts() -> [(&'static str, RotationChart); 5] {
    [
        ("left", Box::new(Left)),
        ("axis-angle", Box::new(AxisAngle)),
        ("euler", Box::new(Euler)),
        ("quaternion", Box::new(InQuaternions)),
        ("matrix", Box::new(InMatrices)),
    ]
}

/// Zero leads nowhere, the derivative is that of the map, and the radius is respected.
fn obeys_the_laws<P: Copy>(
    name: &str,
    chart: &dyn Chart<P>,
    at: P,
    log: impl Fn(&P) -> Vec<f64>,
    relative: impl Fn(&P, &P) -> P,
    turning: usize,
) {
    let n = chart.dimension();
    let zero = vec![0.0; n];
    let still = chart.retract(&at, &zero).unwrap();
    let moved = log(&relative(&still, &at));
    assert!(moved.iter().all(|x| x.abs() < 1e-14 * 20.0), "{name}: zero step moves by {moved:?}");
    let numeric = differences(|step| log(&relative(&chart.retract(&at, step).unwrap(), &at)), &zero, 1e-3);
    let error = discrepancy(&chart.derivative(&at), &numeric);
    assert!(error < 1e-9, "{name}: derivative off by {error:e}");
    for part in 0..turning {
        let mut step = zero.clone();
        step[part] = 0.999 * chart.radius();
        assert!(chart.retract(&at, &step).is_some(), "{name}: a safe step is refused");
        step[part] = 1.001 * chart.radius();
        assert!(chart.retract(&at, &step).is_none(), "{name}: an unsafe step is taken");
        step[part] = f64::NAN;
        assert!(chart.retract(&at, &step).is_none(), "{name}: a NaN is stepped");
    }
    assert!(chart.retract(&at, &zero[1..]).is_none(), "{name}: a short vector is stepped");
}

fn vector(limit: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-1.0..1.0_f64).prop_map(move |a| Vector3::from(a) * limit)
}

proptest! {
    #[test]
    fn rotations(omega in vector(1.7)) {
        let at = so3::exp(&omega);
        for (name, chart) in rotation_charts() {
            // Differences that pass the gimbal lock change triples.
            if name == "euler" && Euler::lock(&at) < 0.01 {
                continue;
            }
            obeys_the_laws(name, &*chart, at, |r| so3::log(r).as_slice().to_vec(), |a, b| a * b.inverse(), chart.dimension());
        }
    }

    #[test]
    fn poses(omega in vector(1.7), t in vector(5.0), pivot in vector(5.0)) {
        let at = Pose::new(so3::exp(&omega), t);
        let log = |p: &Pose| se3::log(p).as_slice().to_vec();
        let relative = |a: &Pose, b: &Pose| *a * b.inverse();
        obeys_the_laws("left", &Left as &dyn Chart<Pose>, at, log, relative, 3);
        for (name, rotation) in rotation_charts() {
            if name == "euler" && Euler::lock(&at.rotation) < 0.01 {
                continue;
            }
            let turning = rotation.dimension();
            let chart = Around { rotation, pivot: Point3::from(pivot) };
            obeys_the_laws(name, &chart as &dyn Chart<Pose>, at, log, relative, turning);
            // A turn leaves the pivot where it is.
            let mut step = vec![0.0; chart.dimension()];
            step[0] = 0.3;
            let turned = chart.retract(&at, &step).unwrap();
            let pivot = Point3::from(pivot);
            prop_assert!((turned.transform_point(&pivot) - at.transform_point(&pivot)).norm() < 1e-13);
        }
    }

    /// The left chart's step is the one and only way between two rotations less than half a turn apart.
    #[test]
    fn left_steps_compose(a in vector(1.7), b in vector(1.7)) {
        let (a, b) = (so3::exp(&a), so3::exp(&b));
        let step = so3::log(&(b * a.inverse()));
        prop_assume!(step.norm() < PI - 1e-9);
        prop_assert!((Left.retract(&a, step.as_slice()).unwrap().matrix() - b.matrix()).norm() < 1e-14);
    }

    #[test]
    fn rescaling_is_the_same_rotation(axis in vector(1.0), theta in 0.0..2.0 * PI) {
        prop_assume!(axis.norm() > 1e-3);
        let omega = axis.normalize() * theta;
        let rescaled = AxisAngle::rescaled(&omega);
        prop_assert!(rescaled.norm() <= PI + 1e-15);
        prop_assert!((so3::exp(&rescaled).matrix() - so3::exp(&omega).matrix()).norm() < 1e-14);
    }

    #[test]
    fn matrix_derivatives_of_the_rotation_vector(omega in vector(3.0)) {
        let numeric = differences(|w| so3::exp(&Vector3::from_column_slice(w)).matrix().as_slice().to_vec(), omega.as_slice(), 1e-3);
        let analytic = so3::exp_derivatives(&omega);
        let columns = DMatrix::from_fn(9, 3, |row, column| analytic[column][row]);
        prop_assert!(discrepancy(&columns, &numeric) < 1e-11);
    }

    #[test]
    fn euler_angles_and_back(omega in vector(3.0), angles in vector(PI)) {
        let r = so3::exp(&omega);
        let found = Euler::angles(&r);
        prop_assert!(found.y.abs() <= PI / 2.0);
        prop_assert!((Euler::rotation(&found).matrix() - r.matrix()).norm() < 1e-13 / Euler::lock(&r).max(1e-3));
        // The two triples of one rotation.
        let other = Vector3::new(angles.x + PI, PI - angles.y, angles.z + PI);
        prop_assert!((Euler::rotation(&angles).matrix() - Euler::rotation(&other).matrix()).norm() < 1e-14);
        let determinant = Euler.derivative(&r).determinant();
        prop_assert!((determinant.abs() - Euler::lock(&r)).abs() < 1e-14);
    }
}

/// In the gimbal lock the derivative loses a rank, the other charts' keep theirs.
#[test]
fn gimbal_lock_is_detected() {
    let locked = Euler::rotation(&Vector3::new(0.3, PI / 2.0, -0.8));
    assert!(Euler::lock(&locked) < 1e-15);
    assert!((Euler::rotation(&Euler::angles(&locked)).matrix() - locked.matrix()).norm() < 1e-14);
    for (name, chart) in rotation_charts() {
        let smallest = chart.derivative(&locked).singular_values().min();
        assert_eq!(smallest < 1e-12, name == "euler", "{name}: {smallest}");
    }
    // A step goes through it: from 80° by 20° to 100°, which is 80° with the others turned half round.
    let before = Euler::rotation(&Vector3::new(0.3, 80f64.to_radians(), -0.8));
    let after = Euler::angles(&Euler.retract(&before, &[0.0, 20f64.to_radians(), 0.0]).unwrap());
    let expected = Vector3::new(0.3 - PI, 80f64.to_radians(), -0.8 + PI);
    assert!((after - expected).norm() < 1e-14, "{after}");
}

/// A quarter turn about each axis, by hand.
#[test]
fn conventions() {
    let quarter = so3::exp(&(Vector3::z() * PI / 2.0));
    assert!((quarter * Vector3::x() - Vector3::y()).norm() < 1e-15);
    assert!((Euler::angles(&quarter) - Vector3::z() * PI / 2.0).norm() < 1e-15);
    let expected = Matrix3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    assert!((quarter.matrix() - expected).norm() < 1e-15);
    // A half screw about z: half a turn, and the way of a half circle's chord.
    let screw = se3::exp(&Vector6::new(0.0, 0.0, PI, 1.0, 0.0, 0.0));
    assert!((screw.translation - Vector3::new(0.0, 2.0 / PI, 0.0)).norm() < 1e-15);
}
