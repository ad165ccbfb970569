//! Arrow-shaped curvatures against the same matrices with all their zeros.

use nalgebra::{DMatrix, DVector};
use rand::rngs::StdRng;
use rand::{Rng, SeedableRng};
use texreg_optim::{Arm, Arrow, Curvature, Pair};

fn random(rng: &mut StdRng, rows: usize, columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| rng.random_range(-1.0..1.0))
}

/// A positive definite arrow with blocks of these sizes: the normal equations of random residuals.
fn arrow(rng: &mut StdRng, sizes: &[usize], shared: usize, pairs: &[(usize, usize)]) -> Arrow {
    let mut arrow = Arrow::zeros(sizes, shared);
    arrow.shared.fill_with_identity();
    let mut add = |arm: &mut Arm, shared_block: &mut DMatrix<f64>| {
        let d = arm.own.nrows();
        let jacobian = random(rng, d + 3, d + shared);
        let (own, by_shared) = (jacobian.columns(0, d), jacobian.columns(d, shared));
        arm.own += own.transpose() * own;
        arm.with_shared += own.transpose() * by_shared;
        *shared_block += by_shared.transpose() * by_shared;
    };
    for arm in &mut arrow.arms {
        add(arm, &mut arrow.shared);
    }
    for &(first, second) in pairs {
        let (a, b) = (random(rng, 4, sizes[first]), random(rng, 4, sizes[second]));
        arrow.arms[first].own += a.transpose() * &a;
        arrow.arms[second].own += b.transpose() * &b;
        arrow.pairs.push(Pair { first, second, between: a.transpose() * b });
    }
    arrow
}

fn arrows() -> Vec<Arrow> {
    let mut rng = StdRng::seed_from_u64(3);
    vec![
        arrow(&mut rng, &[6, 6, 7, 6, 9], 4, &[]),
        arrow(&mut rng, &[6, 6, 6], 0, &[]),
        arrow(&mut rng, &[], 5, &[]),
        arrow(&mut rng, &[6, 7, 6, 9, 6], 3, &[(0, 1), (3, 1), (2, 4), (1, 0)]),
        arrow(&mut rng, &[2; 30], 1, &(1..30).map(|i| (i - 1, i)).collect::<Vec<_>>()),
    ]
}

#[test]
fn the_step_through_schurs_complement_is_the_dense_step() {
    for arrow in arrows() {
        let dense = Curvature::Dense(arrow.to_dense());
        let gradient = DVector::from_fn(arrow.dimension(), |i, _| (i as f64).sin());
        let arrow = Curvature::Arrow(arrow);
        for damping in [0.0, 1e-3, 10.0] {
            let (a, b) =
                (arrow.damped_step(&gradient, damping).unwrap(), dense.damped_step(&gradient, damping).unwrap());
            assert!((&a - &b).norm() < 1e-9 * b.norm(), "{damping}");
            assert!((arrow.along(&a) - dense.along(&a)).abs() < 1e-9 * dense.along(&a));
        }
    }
}

#[test]
fn the_covariances_are_blocks_of_the_dense_inverse() {
    for arrow in arrows() {
        let dense = arrow.to_dense().try_inverse().unwrap();
        let inverse = arrow.inverse().unwrap();
        let offsets = arrow.offsets();
        let (last, m) = (offsets[arrow.arms.len()], arrow.shared.nrows());
        let close = |a: &DMatrix<f64>, at: (usize, usize)| (a - dense.view(at, a.shape())).amax() < 1e-9 * dense.amax();
        assert!(close(&inverse.shared, (last, last)) || m == 0);
        for (i, &at) in offsets[..arrow.arms.len()].iter().enumerate() {
            assert!(close(&inverse.own[i], (at, at)), "block {i}");
            assert!(close(&inverse.with_shared[i], (at, last)) || m == 0, "block {i}");
        }
    }
}

#[test]
fn an_indefinite_arrow_has_no_step() {
    let mut arrow = arrow(&mut StdRng::seed_from_u64(5), &[3, 3], 2, &[]);
    arrow.shared[(0, 0)] = -1.0;
    let gradient = DVector::zeros(arrow.dimension());
    assert!(arrow.inverse().is_none());
    assert!(Curvature::Arrow(arrow).damped_step(&gradient, 0.0).is_none());
}
