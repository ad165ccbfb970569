//! Nonlinear least squares: residual blocks and their Jacobians through one accumulator, with the Gauss–Newton curvature.
//!
//! With residual blocks r_i, Jacobians J_i and a loss ρ, the cost is `½ Σ ρ(‖r_i‖²)`, its gradient `Σ ρ' J_iᵀ r_i`, and the
//! curvature `Σ ρ' J_iᵀ J_i`: reweighted least squares, Triggs' correction without its second-order term, which is
//! dropped where it would make the curvature indefinite (B. Triggs et al., *Bundle adjustment*, 1999, section 4.3).

use crate::{Arrow, Curvature, Derivatives, Loss, Objective};
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// A sum of squares to be minimized.
pub trait LeastSquares<Point> {
    /// Hands every residual block at a point to the accumulator, always in the same order. `None` where a residual is not
    /// defined: a block must not be left out, or the cost would jump.
    fn residuals(&self, at: &Point, into: &mut Accumulator) -> Option<()>;
}

/// Sums up a cost and, where asked for, its derivatives.
///
/// The components of a step are blocks of their own, and then the shared ones: an [`Arrow`]. Without own blocks all is dense.
#[derive(Clone, Debug)]
pub struct Accumulator {
    loss: Loss,
    cost: f64,
    normal: Option<Normal>,
}

#[derive(Clone, Debug)]
struct Normal {
    offsets: Vec<usize>,
    gradient: DVector<f64>,
    curvature: Arrow,
}

impl Accumulator {
    fn cost(loss: Loss) -> Self {
        Self { loss, cost: 0.0, normal: None }
    }

    fn derivatives(loss: Loss, own: &[usize], shared: usize) -> Self {
        let curvature = Arrow::zeros(own, shared);
        let normal =
            Normal { offsets: curvature.offsets(), gradient: DVector::zeros(curvature.dimension()), curvature };
        Self { loss, cost: 0.0, normal: Some(normal) }
    }

    /// A residual block that depends on the shared parameters alone. The Jacobian, one column a parameter, is asked for only
    /// if it is needed.
    #[inline]
    pub fn add<const R: usize, const M: usize>(
        &mut self,
        residual: &SVector<f64, R>,
        jacobian: impl FnOnce() -> SMatrix<f64, R, M>,
    ) {
        self.add_to(None, residual, || (SMatrix::<f64, R, 0>::zeros(), jacobian()));
    }

    /// A residual block that depends on the own parameters of block `arm`, and on the shared ones: its Jacobians by each.
    #[inline]
    pub fn add_arm<const R: usize, const D: usize, const M: usize>(
        &mut self,
        arm: usize,
        residual: &SVector<f64, R>,
        jacobians: impl FnOnce() -> (SMatrix<f64, R, D>, SMatrix<f64, R, M>),
    ) {
        self.add_to(Some(arm), residual, jacobians);
    }

    #[inline]
    fn add_to<const R: usize, const D: usize, const M: usize>(
        &mut self,
        arm: Option<usize>,
        residual: &SVector<f64, R>,
        jacobians: impl FnOnce() -> (SMatrix<f64, R, D>, SMatrix<f64, R, M>),
    ) {
        let (cost, weight) = self.loss.evaluate(residual.norm_squared());
        self.cost += 0.5 * cost;
        let Some(normal) = &mut self.normal else { return };
        let (by_own, by_shared) = jacobians();
        if weight == 0.0 {
            return;
        }
        let last = normal.offsets[normal.offsets.len() - 1];
        if let Some(arm) = arm {
            let at = normal.offsets[arm];
            let block = &mut normal.curvature.arms[arm];
            for j in 0..D {
                let column = by_own.column(j) * weight;
                normal.gradient[at + j] -= column.dot(residual);
                for i in 0..D {
                    block.own[(i, j)] += by_own.column(i).dot(&column);
                }
                for i in 0..M {
                    block.with_shared[(j, i)] += by_shared.column(i).dot(&column);
                }
            }
        }
        for j in 0..M {
            let column = by_shared.column(j) * weight;
            normal.gradient[last + j] -= column.dot(residual);
            for i in 0..M {
                normal.curvature.shared[(i, j)] += by_shared.column(i).dot(&column);
            }
        }
    }
}

/// Minus the cost of a least-squares problem: an [`Objective`], for every solver.
#[derive(Clone, Debug)]
pub struct MinusCost<P> {
    /// The residuals.
    pub problem: P,
    /// What a block counts.
    pub loss: Loss,
    /// The dimension of each block of own parameters. None for a dense problem.
    pub own: Vec<usize>,
    /// The dimension of the shared ones.
    pub shared: usize,
}

impl<P> MinusCost<P> {
    /// A dense problem of so many parameters.
    pub fn dense(problem: P, dimension: usize) -> Self {
        Self { problem, loss: Loss::Squared, own: Vec::new(), shared: dimension }
    }
}

impl<Point, P: LeastSquares<Point>> Objective<Point> for MinusCost<P> {
    fn value(&mut self, at: &Point) -> Option<f64> {
        let mut sum = Accumulator::cost(self.loss);
        self.problem.residuals(at, &mut sum)?;
        Some(-sum.cost).filter(|value| value.is_finite())
    }

    fn derivatives(&mut self, at: &Point) -> Derivatives {
        let mut sum = Accumulator::derivatives(self.loss, &self.own, self.shared);
        let defined = self.problem.residuals(at, &mut sum);
        let Normal { mut gradient, curvature, .. } = sum.normal.expect("it was asked for");
        if defined.is_none() {
            gradient.fill(f64::NAN);
        }
        let curvature =
            if self.own.is_empty() { Curvature::Dense(curvature.shared) } else { Curvature::Arrow(curvature) };
        Derivatives { gradient, curvature }
    }
}

/// The covariance of an estimate whose residuals have unit variance: the inverse of the curvature at it. `None` where the
/// data do not determine it.
pub fn covariance(curvature: &Curvature) -> Option<DMatrix<f64>> {
    Some(curvature.to_dense()?.cholesky()?.inverse())
}
