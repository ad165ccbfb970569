//! The step within a region that maximizes `gᵀs − ½ sᵀHs`, for a positive definite H.
//!
//! Bounds of single components are an end each: the primal–dual active set method (M. Hintermüller, K. Ito, K. Kunisch, *The
//! primal-dual active set strategy as a semismooth Newton method*, SIAM J. Optim. 13(3), 2002) holds the components that would go
//! beyond, solves for the others, lets go those that pull back, and is exact once nothing changes: two or three small solves.
//!
//! Balls as well make a second-order cone program, solved by the interior point method of clarabel (P. Goulart & Y. Chen,
//! *Clarabel: an interior-point solver for conic programs with quadratic objectives*, 2024).

use crate::region::INSIDE;
use crate::{Curvature, Region};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// The best step in a region; `None` where it was not found.
pub(crate) fn bounded_step(region: &Region, gradient: &DVector<f64>, curvature: &Curvature) -> Option<DVector<f64>> {
    let by_ends = by_ends(region, gradient, curvature).filter(|step| region.contains(step));
    by_ends.or_else(|| by_cones(region, gradient, &curvature.to_dense()?))
}

/// The most changes of the components that are held.
const CHANGES: usize = 20;

/// The best step within the bounds, whatever the balls; `None` where the held components keep changing.
fn by_ends(region: &Region, gradient: &DVector<f64>, curvature: &Curvature) -> Option<DVector<f64>> {
    let (low, high) = region.intervals(gradient.len());
    let mut held: BTreeMap<usize, f64> = BTreeMap::new();
    for _ in 0..CHANGES {
        let (mut others, mut right) = (curvature.clone(), gradient.clone());
        held.iter().for_each(|(&i, &end)| others.pin(i, end, &mut right));
        let step = others.solve(&right)?;
        let slope = gradient - curvature.times(&step);
        let end = |i: usize| match held.get(&i) {
            Some(&end) if end == high[i] => (slope[i] > 0.0).then_some(end),
            Some(&end) => (slope[i] < 0.0).then_some(end),
            None if step[i] > high[i] => Some(high[i]),
            None if step[i] < low[i] => Some(low[i]),
            None => None,
        };
        let next = (0..gradient.len()).filter_map(|i| Some((i, end(i)?))).collect();
        if next == held {
            return Some(step);
        }
        held = next;
    }
    None
}

/// The best step within bounds and balls; `None` where the program was not solved.
fn by_cones(region: &Region, gradient: &DVector<f64>, curvature: &DMatrix<f64>) -> Option<DVector<f64>> {
    let n = gradient.len();
    // In units of the curvature, as components may be orders of magnitude apart.
    let units = curvature.diagonal().map(|x| 1.0 / x.max(f64::MIN_POSITIVE).sqrt());
    let mut upper = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..n {
        for i in (0..=j).filter(|&i| curvature[(i, j)] != 0.0) {
            upper.0.push(i);
            upper.1.push(j);
            upper.2.push(curvature[(i, j)] * units[i] * units[j]);
        }
    }
    let quadratic = CscMatrix::new_from_triplets(n, n, upper.0, upper.1, upper.2);
    let linear: Vec<f64> = (0..n).map(|i| -gradient[i] * units[i]).collect();
    let mut rows = (Vec::new(), Vec::new(), Vec::new());
    let mut right = Vec::new();
    let mut cones = Vec::new();
    let mut push = |right: &mut Vec<f64>, entry: Option<(usize, f64)>, limit: f64| {
        if let Some((column, x)) = entry {
            rows.0.push(right.len());
            rows.1.push(column);
            rows.2.push(x * units[column]);
        }
        right.push(limit);
    };
    let ends = region.bounds.iter().flat_map(|&(i, least, most)| [(i, 1.0, most), (i, -1.0, -least)]);
    let ends: Vec<(usize, f64, f64)> = ends.filter(|(_, _, end)| end.is_finite()).collect();
    for &(i, sign, end) in &ends {
        push(&mut right, Some((i, sign)), end);
    }
    if !ends.is_empty() {
        cones.push(SupportedConeT::NonnegativeConeT(ends.len()));
    }
    for (part, radius) in &region.balls {
        push(&mut right, None, INSIDE * radius);
        part.clone().for_each(|i| push(&mut right, Some((i, -1.0)), 0.0));
        cones.push(SupportedConeT::SecondOrderConeT(part.len() + 1));
    }
    let constraints = CscMatrix::new_from_triplets(right.len(), n, rows.0, rows.1, rows.2);
    let settings = DefaultSettings { verbose: false, ..DefaultSettings::default() };
    let mut solver = DefaultSolver::new(&quadratic, &linear, &constraints, &right, &cones, settings).ok()?;
    solver.solve();
    let solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
    // The interior point ends a rounding error off the bounds.
    let step = region.held(DVector::from_column_slice(&solver.solution.x).component_mul(&units));
    Some(step).filter(|step| solved && step.iter().all(|x| x.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Arm, Arrow, Pair};

    /// Numbers without a pattern, from −1 to 1.
    fn number(i: usize, j: usize, k: usize) -> f64 {
        (12.9898 * i as f64 + 78.233 * j as f64 + 37.719 * k as f64).sin()
    }

    /// Three blocks of three components, two of them coupled, that share two.
    fn arrow(k: usize) -> Arrow {
        let root = |rows: usize, seed: usize| DMatrix::from_fn(rows, rows, |i, j| number(i, j, 10 * k + seed));
        let own = |seed: usize| root(3, seed) * root(3, seed).transpose() + DMatrix::identity(3, 3) * 2.0;
        let arm =
            |seed: usize| Arm { own: own(seed), with_shared: DMatrix::from_fn(3, 2, |i, j| 0.4 * number(i, j, seed)) };
        let between = root(3, 7) * 0.3;
        let shared = root(2, 8) * root(2, 8).transpose() + DMatrix::identity(2, 2) * 4.0;
        Arrow { arms: (0..3).map(arm).collect(), pairs: vec![Pair { first: 2, second: 0, between }], shared }
    }

    #[test]
    fn ends_are_exact_and_agree_with_cones() {
        for k in 0..40 {
            let arrow = arrow(k);
            let n = arrow.dimension();
            let dense = arrow.to_dense();
            let gradient = DVector::from_fn(n, |i, _| 5.0 * number(i, 3, k));
            let bounds = [(0, 0.1, 0.2), (2, 0.0, 0.3), (4, 0.4, 0.0), (8, f64::INFINITY, 0.1), (10, 0.2, 0.05)];
            let region =
                bounds.iter().fold(Region::default(), |region, &(i, least, most)| region.bound(i, -least, most));
            let step = by_ends(&region, &gradient, &Curvature::Arrow(arrow)).unwrap();
            assert!((by_ends(&region, &gradient, &Curvature::Dense(dense.clone())).unwrap() - &step).amax() < 1e-10);
            assert!(region.contains(&step));
            let slope = &gradient - &dense * &step;
            let (low, high) = region.intervals(n);
            for i in 0..n {
                // No slope is left but across an end.
                let across = (step[i] == high[i] && slope[i] >= 0.0) || (step[i] == low[i] && slope[i] <= 0.0);
                assert!(across || slope[i].abs() < 1e-9, "{k}, component {i}: {} with slope {}", step[i], slope[i]);
            }
            let off = (by_cones(&region, &gradient, &dense).unwrap() - &step).amax();
            assert!(off < 1e-3, "an interior point method ends near: {off}");
        }
    }

    #[test]
    fn a_ball_makes_a_cone() {
        let dense = arrow(1).to_dense();
        let gradient = DVector::from_fn(dense.nrows(), |i, _| 5.0 * number(i, 3, 1));
        let region = Region::default().ball(0..3, 0.2).bound(4, -0.1, 0.1);
        let step = bounded_step(&region, &gradient, &Curvature::Dense(dense.clone())).unwrap();
        assert!(region.contains(&step) && (step.rows(0, 3).norm() - INSIDE * 0.2).abs() < 1e-6);
        // The slope that is left on the ball points outward along its radius.
        let slope = (gradient - dense * &step).rows(0, 3).into_owned();
        assert!((slope.normalize() - step.rows(0, 3).normalize()).norm() < 1e-3, "{slope}");
    }
}
