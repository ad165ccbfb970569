//! The step within a region: a convex quadratic model, bounds and balls make a second-order cone program, solved by the interior
//! point method of clarabel (P. Goulart & Y. Chen, *Clarabel: an interior-point solver for conic programs with quadratic
//! objectives*, 2024).

use crate::Region;
use crate::region::INSIDE;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};

/// The step in a region that maximizes `gᵀs − ½ sᵀHs` for a positive definite H; `None` where the program was not solved.
pub(crate) fn bounded_step(region: &Region, gradient: &DVector<f64>, curvature: &DMatrix<f64>) -> Option<DVector<f64>> {
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
    for &(i, least, most) in &region.bounds {
        push(&mut right, Some((i, 1.0)), most);
        push(&mut right, Some((i, -1.0)), -least);
    }
    if !region.bounds.is_empty() {
        cones.push(SupportedConeT::NonnegativeConeT(2 * region.bounds.len()));
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
    let mut step = DVector::from_column_slice(&solver.solution.x).component_mul(&units);
    // The interior point ends a rounding error off the bounds.
    for &(i, least, most) in &region.bounds {
        step[i] = step[i].clamp(least, most);
    }
    step *= region.longest(&step).min(1.0);
    Some(step).filter(|step| solved && step.iter().all(|x| x.is_finite()))
}
