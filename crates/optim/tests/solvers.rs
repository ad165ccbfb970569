//! Every solver on problems whose solutions are known: a vector space, the sphere, and poses.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix3x6, Point3, Rotation3, SMatrix, Vector3, dvector};
use texreg_lie::{Left, Pose, so3};
use texreg_optim::{
    Accumulator, Ascent, Bobyqa, Charted, Curvature, Derivatives, Direction, Euclidean, Iteration, LeastSquares,
    LevenbergMarquardt, LineSearch, Loss, Manifold, MinusCost, NelderMead, Objective, Power, Region, Report, Solver,
    StochasticGradient, Stop, covariance, gradient_discrepancy,
};

fn ascent(direction: Direction, search: LineSearch) -> Box<Ascent> {
    Box::new(Ascent { direction, search, iterations: 20_000, ..Ascent::default() })
}

/// Every solver that needs no curvature, with its name.
fn solvers<Point: Clone + 'static>() -> Vec<(&'static str, Box<dyn Solver<Point>>)> {
    use LineSearch::{Backtracking, StrongWolfe};
    vec![
        ("gradient, backtracking", ascent(Direction::Gradient, Backtracking)),
        ("gradient, strong Wolfe", ascent(Direction::Gradient, StrongWolfe)),
        ("conjugate gradient", ascent(Direction::ConjugateGradient, StrongWolfe)),
        ("BFGS", ascent(Direction::Bfgs, StrongWolfe)),
        ("BFGS, backtracking", ascent(Direction::Bfgs, Backtracking)),
        ("L-BFGS", ascent(Direction::LimitedBfgs { memory: 5 }, StrongWolfe)),
        ("BOBYQA", Box::new(Bobyqa { iterations: 3000, ..Bobyqa::default() })),
        ("Nelder–Mead", Box::new(NelderMead { iterations: 5000, ..NelderMead::default() })),
    ]
}

/// Rosenbrock's valley as least squares, curvature and all.
struct Rosenbrock;

impl LeastSquares<DVector<f64>> for Rosenbrock {
    fn residuals(&self, x: &DVector<f64>, into: &mut Accumulator) -> Option<()> {
        into.add(&nalgebra::vector![10.0 * (x[1] - x[0] * x[0])], || nalgebra::matrix![-20.0 * x[0], 10.0]);
        into.add(&nalgebra::vector![1.0 - x[0]], || nalgebra::matrix![-1.0, 0.0]);
        Some(())
    }
}

/// The same without a curvature: solvers must not depend on one.
struct Plain<O>(O);

impl<Point, O: Objective<Point>> Objective<Point> for Plain<O> {
    fn value(&mut self, at: &Point) -> Option<f64> {
        self.0.value(at)
    }

    fn derivatives(&mut self, at: &Point) -> Derivatives {
        Derivatives { curvature: Curvature::Unknown, ..self.0.derivatives(at) }
    }
}

#[test]
fn all_find_the_end_of_rosenbrocks_valley() {
    for (name, solver) in solvers() {
        let mut objective = Plain(MinusCost::dense(Rosenbrock, 2));
        let report = solver.maximize(&Euclidean(2), &mut objective, dvector![-1.2, 1.0], &mut |_| ()).unwrap();
        assert!((&report.point - dvector![1.0, 1.0]).norm() < 2e-3, "{name}: {} {:?}", report.point, report.stop);
        assert!(report.value > report.start && report.iterations.iter().any(|i| i.accepted), "{name}");
    }
}

/// The unit sphere in Rⁿ: a step is added, and the sum brought back.
struct Sphere(usize);

impl Manifold<DVector<f64>> for Sphere {
    fn dimension(&self) -> usize {
        self.0
    }

    fn retract(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        (at + step).try_normalize(1e-9)
    }
}

/// xᵀ A x, largest at the eigenvector of the largest eigenvalue.
struct Rayleigh(DMatrix<f64>);

impl Objective<DVector<f64>> for Rayleigh {
    fn value(&mut self, at: &DVector<f64>) -> Option<f64> {
        Some((&self.0 * at).dot(at))
    }

    fn derivatives(&mut self, at: &DVector<f64>) -> Derivatives {
        let gradient = 2.0 * &self.0 * at;
        let tangent = &gradient - at * at.dot(&gradient);
        Derivatives { gradient: tangent, curvature: Curvature::Unknown }
    }
}

#[test]
fn all_find_the_largest_eigenvalue_on_the_sphere() {
    let factor = DMatrix::from_fn(5, 5, |i, j| ((3 * i + 7 * j * j + 1) as f64).sin());
    let matrix = &factor * factor.transpose();
    let largest = matrix.symmetric_eigenvalues().max();
    let start = DVector::from_element(5, 1.0).normalize();
    assert!(gradient_discrepancy(&Sphere(5), &mut Rayleigh(matrix.clone()), &start, 1e-3) < 1e-9);
    for (name, solver) in solvers() {
        let report = solver.maximize(&Sphere(5), &mut Rayleigh(matrix.clone()), start.clone(), &mut |_| ()).unwrap();
        assert!((report.value - largest).abs() < 1e-6 * largest, "{name}: {} against {largest}", report.value);
    }
}

/// Pairs of points in two frames: the pose between them, `½ Σ ‖y − (R x + t)‖²`. Its tangent is that of the left chart.
#[derive(Clone)]
struct Alignment(Vec<(Point3<f64>, Point3<f64>)>);

fn truth() -> Pose {
    Pose::new(so3::exp(&Vector3::new(0.9, -0.4, 0.6)), Vector3::new(0.3, -1.0, 2.0))
}

impl Alignment {
    fn new(count: usize) -> Self {
        let point = |i: usize| Point3::new((1.7 * i as f64).sin(), (2.9 * i as f64).cos(), (0.8 * i as f64).sin());
        Self((0..count).map(point).map(|x| (x, truth().transform_point(&x))).collect())
    }
}

fn by_tangent(moved: &Point3<f64>) -> Matrix3x6<f64> {
    let mut jacobian = Matrix3x6::zeros();
    jacobian.fixed_columns_mut::<3>(0).copy_from(&-so3::hat(&moved.coords));
    jacobian.fixed_columns_mut::<3>(3).copy_from(&Matrix3::identity());
    jacobian
}

impl LeastSquares<Pose> for Alignment {
    fn residuals(&self, at: &Pose, into: &mut Accumulator) -> Option<()> {
        for (x, y) in &self.0 {
            let moved = at.transform_point(x);
            into.add(&(moved - y), || by_tangent(&moved));
        }
        Some(())
    }
}

#[test]
fn all_align_poses() {
    let start = Pose::new(Rotation3::identity(), Vector3::new(0.0, 0.0, 1.0));
    let problem = MinusCost::dense(Alignment::new(9), 6);
    assert!(gradient_discrepancy(&Charted(Left), &mut problem.clone(), &start, 1e-3) < 1e-9);
    let mut all = solvers();
    all.push(("LM", Box::new(LevenbergMarquardt::default())));
    for (name, solver) in all {
        let report = solver.maximize(&Charted(Left), &mut problem.clone(), start, &mut |_| ()).unwrap();
        let off = so3::log(&(report.point.rotation * truth().rotation.inverse())).norm();
        assert!(off < 1e-3 && (report.point.translation - truth().translation).norm() < 1e-3, "{name}: {off}");
    }
}

/// A batch of an alignment's pairs.
struct Batches(Alignment, MinusCost<Alignment>);

impl Objective<Pose> for Batches {
    fn value(&mut self, at: &Pose) -> Option<f64> {
        self.1.value(at)
    }

    fn derivatives(&mut self, at: &Pose) -> Derivatives {
        self.1.derivatives(at)
    }

    fn redraw(&mut self, round: usize) -> bool {
        let pairs = &self.0.0;
        self.1.problem = Alignment((0..20).map(|i| pairs[(round * 7919 + i * 104_729) % pairs.len()]).collect());
        true
    }
}

#[test]
fn stochastic_gradients_align_poses_from_batches() {
    let full = Alignment::new(2000);
    let mut objective = Batches(full.clone(), MinusCost::dense(full, 6));
    let start = Pose::new(Rotation3::identity(), Vector3::new(0.0, 0.0, 1.0));
    let solver = StochasticGradient { iterations: 400, ..StochasticGradient::default() };
    let report = solver.maximize(&Charted(Left), &mut objective, start, &mut |_| ()).unwrap();
    let off = so3::log(&(report.point.rotation * truth().rotation.inverse())).norm();
    assert!(off < 1e-2 && report.value > report.start, "{off}");
    assert_eq!(report.iterations.len(), 400);
}

#[test]
fn strong_wolfe_steps_hold_their_conditions() {
    // Along each accepted step of a gradient method the value grows enough, and the slope that is left is small.
    let mut objective = Plain(MinusCost::dense(Rosenbrock, 2));
    let mut at = dvector![-1.2, 1.0];
    for _ in 0..30 {
        let value = objective.value(&at).unwrap();
        let gradient = objective.derivatives(&at).gradient;
        let solver = Ascent { direction: Direction::Gradient, gain_tolerance: f64::INFINITY, ..Ascent::default() };
        let report = solver.maximize(&Euclidean(2), &mut objective, at.clone(), &mut |_| ()).unwrap();
        let step = &report.point - &at;
        let along = gradient.normalize();
        assert!((step.normalize() - &along).norm() < 1e-6, "one step of steepest ascent");
        let length = step.norm();
        assert!(report.value >= value + 1e-4 * length * gradient.norm() * (1.0 - 1e-9));
        let left = objective.derivatives(&report.point).gradient.dot(&along).abs();
        assert!(left <= 0.9 * gradient.norm() * (1.0 + 1e-9), "{left} of {}", gradient.norm());
        at = report.point;
    }
}

#[test]
fn bfgs_is_superlinear() {
    // −log cosh: smooth, concave, no quadratic. Each of the last gradients is a small fraction of the one before.
    struct Bowl;
    impl Objective<DVector<f64>> for Bowl {
        fn value(&mut self, x: &DVector<f64>) -> Option<f64> {
            Some(-x.iter().enumerate().map(|(i, x)| (1.0 + i as f64) * (x - 0.3).cosh().ln()).sum::<f64>())
        }
        fn derivatives(&mut self, x: &DVector<f64>) -> Derivatives {
            let gradient = DVector::from_fn(x.len(), |i, _| -(1.0 + i as f64) * (x[i] - 0.3).tanh());
            Derivatives { gradient, curvature: Curvature::Unknown }
        }
    }
    let solver = Ascent { direction: Direction::Bfgs, gain_tolerance: 1e-16, ..Ascent::default() };
    let start = dvector![1.0, -0.7, 0.9];
    let report = solver.maximize(&Euclidean(3), &mut Bowl, start, &mut |_| ()).unwrap();
    let values: Vec<f64> = report.iterations.iter().filter(|i| i.accepted).filter_map(|i| i.value).collect();
    let errors: Vec<f64> = values.iter().map(|v| -v).filter(|e| *e > 1e-14).collect();
    let ratios: Vec<f64> = errors.windows(2).map(|w| w[1] / w[0]).collect();
    assert!(ratios.len() >= 3 && ratios[ratios.len() - 1] < 0.02 && ratios[ratios.len() - 1] < ratios[0], "{ratios:?}");
    assert!(report.iterations.len() < 40, "{}", report.iterations.len());
}

/// Many poses that share one scale: a step through the arrow is that of the dense matrix.
struct Shared(Alignment);

impl LeastSquares<(Vec<Pose>, DVector<f64>)> for Shared {
    fn residuals(&self, (poses, scale): &(Vec<Pose>, DVector<f64>), into: &mut Accumulator) -> Option<()> {
        let factor = scale[0].exp();
        for (i, pose) in poses.iter().enumerate() {
            for (x, y) in self.0.0.iter().skip(i) {
                let moved = pose.transform_point(&Point3::from(x.coords * factor));
                let target = y + Vector3::new(0.01 * i as f64, 0.0, 0.0);
                let turned: Vector3<f64> = pose.rotation * x.coords * factor;
                into.add_arm(i, &(moved - target), || (by_tangent(&moved), SMatrix::<f64, 3, 1>::from(turned)));
            }
        }
        Some(())
    }
}

#[test]
fn shared_parameters_are_found_through_the_arrow() {
    let manifold = (Power { of: Charted(Left), count: 4 }, Euclidean(1));
    let near = Pose::new(so3::exp(&Vector3::new(0.7, -0.3, 0.5)), Vector3::new(0.2, -0.8, 2.2));
    let start = (vec![near; 4], dvector![0.2]);
    let problem = Shared(Alignment::new(12));
    let mut objective = MinusCost { problem, loss: Loss::Squared, own: vec![6; 4], shared: 1 };
    assert!(gradient_discrepancy(&manifold, &mut objective, &start, 1e-3) < 1e-8);
    let arrow = objective.derivatives(&start);
    let dense = Curvature::Dense(arrow.curvature.to_dense().unwrap());
    let (a, b) = (arrow.curvature.damped_step(&arrow.gradient, 1e-4), dense.damped_step(&arrow.gradient, 1e-4));
    assert!((a.unwrap() - b.unwrap()).norm() < 1e-9);
    let report = LevenbergMarquardt::default().maximize(&manifold, &mut objective, start, &mut |_| ()).unwrap();
    assert!(report.point.1[0].abs() < 1e-6, "{}", report.point.1[0]);
    let off = report.point.0[3].translation - truth().translation;
    assert!((off - Vector3::new(0.03, 0.0, 0.0)).norm() < 1e-6, "{off}");
}

#[test]
fn the_covariance_is_the_inverse_of_the_normal_matrix() {
    let mut problem = MinusCost::dense(Alignment::new(9), 6);
    let jacobians = problem.problem.0.iter().map(|(_, y)| by_tangent(y));
    let normal = jacobians.fold(SMatrix::<f64, 6, 6>::zeros(), |sum, j| sum + j.transpose() * j);
    let found = covariance(&problem.derivatives(&truth()).curvature).unwrap();
    let product = found * DMatrix::from_column_slice(6, 6, normal.as_slice());
    assert!((product - DMatrix::identity(6, 6)).amax() < 1e-9);
}

#[test]
fn losses_have_their_slopes_and_limits() {
    for loss in [Loss::Squared, Loss::Huber(0.7), Loss::Cauchy(0.7), Loss::Tukey(0.7), Loss::GemanMcClure(0.7)] {
        for s in [1e-6, 0.1, 0.4, 0.6, 2.0, 50.0] {
            let h = 1e-5 * s;
            let slope = (loss.evaluate(s + h).0 - loss.evaluate(s - h).0) / (2.0 * h);
            let (value, weight) = loss.evaluate(s);
            assert!((weight - slope).abs() < 1e-6 * weight.max(1e-3), "{loss:?} at {s}: {weight} against {slope}");
            assert!(value <= s * (1.0 + 1e-12) && weight <= 1.0);
        }
        assert!((loss.evaluate(1e-9).0 - 1e-9).abs() < 1e-15, "{loss:?} is the square of small residuals");
    }
    assert!(Loss::Tukey(0.7).evaluate(1e9).0 < 0.17 && Loss::GemanMcClure(0.7).evaluate(1e9).0 < 0.4901);
}

#[test]
fn robust_losses_ignore_wrong_pairs() {
    let mut problem = Alignment::new(30);
    for (_, y) in problem.0.iter_mut().take(6) {
        y.x += 5.0;
    }
    let start = Pose::new(so3::exp(&Vector3::new(0.7, -0.3, 0.5)), Vector3::new(0.2, -0.8, 2.2));
    for loss in [Loss::Cauchy(0.1), Loss::Tukey(2.0), Loss::GemanMcClure(0.5), Loss::Huber(0.01), Loss::Squared] {
        let mut objective = MinusCost { problem: problem.clone(), loss, own: Vec::new(), shared: 6 };
        let solver = LevenbergMarquardt { iterations: 300, ..LevenbergMarquardt::default() };
        let report = solver.maximize(&Charted(Left), &mut objective, start, &mut |_| ()).unwrap();
        let off = (report.point.translation - truth().translation).norm();
        assert_eq!(off < 0.05, loss != Loss::Squared, "{loss:?}: {off}");
    }
}

/// A plane with a bound on one component and a ball on both, of this radius.
struct Bounded(f64);

impl Manifold<DVector<f64>> for Bounded {
    fn dimension(&self) -> usize {
        2
    }

    fn retract(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step)
    }

    fn region(&self, at: &DVector<f64>) -> Region {
        Region::default().bound(0, -1.0 - at[0], 0.5 - at[0]).ball(0..2, self.0)
    }
}

/// −‖x − (2, 1)‖²/2 with correlated components.
struct Slope;

impl LeastSquares<DVector<f64>> for Slope {
    fn residuals(&self, x: &DVector<f64>, into: &mut Accumulator) -> Option<()> {
        let (a, b) = (x[0] - 2.0, x[1] - 1.0);
        into.add(&nalgebra::vector![a + 0.5 * b, b], || nalgebra::matrix![1.0, 0.5; 0.0, 1.0]);
        Some(())
    }
}

#[test]
fn bounds_hold_and_the_rest_goes_on() {
    // With x = ½ the best y has 0.5 (a + 0.5 b) + b = 0 for a = −1.5: b = 0.6.
    let best = dvector![0.5, 1.6];
    let check = |name: &str, report: Report<DVector<f64>>| {
        assert!((&report.point - &best).norm() < 1e-3, "{name}: {}", report.point);
        assert!(report.point[0] <= 0.5 + 1e-12, "{name}: {}", report.point);
    };
    let mut all = solvers();
    all.push(("LM", Box::new(LevenbergMarquardt::default())));
    // From inside, at the bound, and a rounding error off it.
    for start in [0.0, 0.5, 0.5 - 1e-16, -1.0] {
        for (name, solver) in &all {
            // Methods that work in one chart need room for the whole way.
            let radius = if ["BOBYQA", "Nelder–Mead"].contains(name) { 10.0 } else { 0.4 };
            let mut objective = MinusCost::dense(Slope, 2);
            let report = solver.maximize(&Bounded(radius), &mut objective, dvector![start, 0.0], &mut |_| ()).unwrap();
            check(&format!("{name} from {start}"), report);
        }
    }
}

#[test]
fn stochastic_gradients_keep_to_bounds_and_go_on_beside_them() {
    struct Whole(MinusCost<Slope>);
    impl Objective<DVector<f64>> for Whole {
        fn value(&mut self, at: &DVector<f64>) -> Option<f64> {
            self.0.value(at)
        }
        fn derivatives(&mut self, at: &DVector<f64>) -> Derivatives {
            self.0.derivatives(at)
        }
        fn redraw(&mut self, _: usize) -> bool {
            true
        }
    }
    let mut objective = Whole(MinusCost::dense(Slope, 2));
    let solver = StochasticGradient::default();
    let report = solver.maximize(&Bounded(0.4), &mut objective, dvector![0.3, 0.0], &mut |_| ()).unwrap();
    assert!((report.point - dvector![0.5, 1.6]).norm() < 1e-2);
}

#[test]
fn every_trial_is_observed_and_the_budget_kept() {
    for (name, solver) in solvers::<DVector<f64>>().into_iter().take(6) {
        let mut seen: Vec<Iteration> = Vec::new();
        let mut objective = Plain(MinusCost::dense(Rosenbrock, 2));
        let report =
            solver.maximize(&Euclidean(2), &mut objective, dvector![-1.2, 1.0], &mut |i| seen.push(*i)).unwrap();
        assert_eq!(seen, report.iterations, "{name}");
        assert!(seen.windows(2).all(|w| w[0].seconds <= w[1].seconds), "{name}");
    }
    let few = Ascent { iterations: 5, ..Ascent::default() };
    let mut objective = Plain(MinusCost::dense(Rosenbrock, 2));
    let report = few.maximize(&Euclidean(2), &mut objective, dvector![-1.2, 1.0], &mut |_| ()).unwrap();
    assert_eq!((report.iterations.len(), report.stop), (5, Stop::Exhausted));
}
