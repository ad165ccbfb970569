//! Levenberg–Marquardt on functions whose maxima are known.

use nalgebra::{DMatrix, DVector, dvector};
use texreg_optim::{
    Curvature, Derivatives, Euclidean, Iteration, LevenbergMarquardt, Manifold, Objective, Report, Solver, Stop,
};

/// Minus half the sum of squares of residuals, with Gauss–Newton's curvature.
struct LeastSquares<F: Fn(&DVector<f64>) -> (DVector<f64>, DMatrix<f64>)>(F);

impl<F: Fn(&DVector<f64>) -> (DVector<f64>, DMatrix<f64>)> Objective<DVector<f64>> for LeastSquares<F> {
    fn value(&mut self, at: &DVector<f64>) -> Option<f64> {
        Some(-0.5 * self.0(at).0.norm_squared()).filter(|value| value.is_finite())
    }

    fn derivatives(&mut self, at: &DVector<f64>) -> Derivatives {
        let (residual, jacobian) = self.0(at);
        let curvature = Curvature::Dense(jacobian.transpose() * &jacobian);
        Derivatives { gradient: -jacobian.transpose() * residual, curvature }
    }
}

fn maximize(
    f: impl Fn(&DVector<f64>) -> (DVector<f64>, DMatrix<f64>),
    start: DVector<f64>,
    iterations: usize,
) -> Report<DVector<f64>> {
    let solver = LevenbergMarquardt { iterations, ..Default::default() };
    solver.maximize(&Euclidean(start.len()), &mut LeastSquares(f), start, &mut |_| ()).unwrap()
}

fn rosenbrock(x: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let residual = dvector![10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]];
    (residual, nalgebra::dmatrix![-20.0 * x[0], 10.0; -1.0, 0.0])
}

/// Powell's singular function (J. Moré, B. Garbow, K. Hillstrom, *Testing unconstrained optimization software*, 1981):
/// the Jacobian is singular at the solution.
fn powell(x: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
    let (a, b) = (x[1] - 2.0 * x[2], x[0] - x[3]);
    let (s5, s10) = (5f64.sqrt(), 10f64.sqrt());
    let residual = dvector![x[0] + 10.0 * x[1], s5 * (x[2] - x[3]), a * a, s10 * b * b];
    let jacobian = nalgebra::dmatrix![
        1.0, 10.0, 0.0, 0.0;
        0.0, 0.0, s5, -s5;
        0.0, 2.0 * a, -4.0 * a, 0.0;
        2.0 * s10 * b, 0.0, 0.0, -2.0 * s10 * b
    ];
    (residual, jacobian)
}

#[test]
fn finds_the_end_of_rosenbrocks_valley() {
    let report = maximize(rosenbrock, dvector![-1.2, 1.0], 100);
    assert!((report.point - dvector![1.0, 1.0]).norm() < 1e-6);
    assert_eq!(report.stop, Stop::Converged);
    assert!((report.start + 12.1).abs() < 1e-12, "half the published 24.2 at the standard start");
}

#[test]
fn copes_with_a_singular_jacobian() {
    let report = maximize(powell, dvector![3.0, -1.0, 0.0, 1.0], 200);
    assert!(report.value > -1e-10, "{}", report.value);
}

#[test]
fn does_not_depend_on_units() {
    let scaled = |x: &DVector<f64>| {
        let (residual, mut jacobian) = rosenbrock(&dvector![x[0] / 1e4, x[1]]);
        jacobian.column_mut(0).scale_mut(1e-4);
        (residual, jacobian)
    };
    let plain = maximize(rosenbrock, dvector![-1.2, 1.0], 100);
    let other = maximize(scaled, dvector![-1.2e4, 1.0], 100);
    assert_eq!(plain.iterations.len(), other.iterations.len());
    assert!((other.point - dvector![1e4, 1.0]).norm() < 1e-2);
}

/// A curvature of another scale than the function's own.
struct Misjudged<O>(O, f64);

impl<O: Objective<DVector<f64>>> Objective<DVector<f64>> for Misjudged<O> {
    fn value(&mut self, at: &DVector<f64>) -> Option<f64> {
        self.0.value(at)
    }

    fn derivatives(&mut self, at: &DVector<f64>) -> Derivatives {
        let Derivatives { gradient, curvature } = self.0.derivatives(at);
        Derivatives { gradient, curvature: Curvature::Dense(self.1 * curvature.to_dense().unwrap()) }
    }
}

#[test]
fn a_curvature_of_the_wrong_scale_costs_few_steps() {
    let line = |x: &DVector<f64>| (dvector![x[0] - 3.0, 2.0 * (x[1] + 1.0)], nalgebra::dmatrix![1.0, 0.0; 0.0, 2.0]);
    for (scale, most) in [(1.0, 4), (0.01, 10), (20.0, 10)] {
        let mut objective = Misjudged(LeastSquares(line), scale);
        let solver = LevenbergMarquardt::default();
        let report = solver.maximize(&Euclidean(2), &mut objective, dvector![0.0, 0.0], &mut |_| ()).unwrap();
        assert!((&report.point - dvector![3.0, -1.0]).norm() < 1e-6, "{scale}: {}", report.point);
        assert!(report.iterations.len() <= most, "{scale}: {} steps", report.iterations.len());
    }
}

#[test]
fn values_only_rise_and_every_trial_is_reported() {
    let mut seen: Vec<Iteration> = Vec::new();
    let solver = LevenbergMarquardt { iterations: 15, ..Default::default() };
    let report = solver
        .maximize(&Euclidean(2), &mut LeastSquares(rosenbrock), dvector![-1.2, 1.0], &mut |i| seen.push(*i))
        .unwrap();
    assert_eq!(seen, report.iterations);
    assert_eq!(report.stop, Stop::Exhausted);
    let taken: Vec<f64> = seen.iter().filter(|i| i.accepted).map(|i| i.value.unwrap()).collect();
    assert!(taken.len() > 3 && taken.is_sorted());
    assert_eq!(*taken.last().unwrap(), report.value);
}

/// A manifold that refuses to leave the unit disc: the solver shortens its steps and stays inside.
struct Disc;

impl Manifold<DVector<f64>> for Disc {
    fn dimension(&self) -> usize {
        2
    }

    fn retract(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step).filter(|x| x.norm() < 1.0)
    }
}

#[test]
fn refused_steps_are_shortened() {
    let bowl = |x: &DVector<f64>| (x - dvector![3.0, 0.0], DMatrix::identity(2, 2));
    let start = dvector![0.0, 0.2];
    let report = LevenbergMarquardt::default().maximize(&Disc, &mut LeastSquares(bowl), start, &mut |_| ()).unwrap();
    assert!(report.point.norm() < 1.0 && report.point[0] > 0.9, "{}", report.point);
    assert!(report.iterations.iter().any(|i| i.value.is_none()));
}

#[test]
fn an_undefined_start_has_no_report() {
    let nowhere = |x: &DVector<f64>| (x * f64::NAN, DMatrix::identity(1, 1));
    let solver = LevenbergMarquardt::default();
    assert!(solver.maximize(&Euclidean(1), &mut LeastSquares(nowhere), dvector![1.0], &mut |_| ()).is_none());
}
