//! The curvature of an objective: dense, or in the shape of an arrow.

use crate::bounded_step::bounded_step;
use crate::{Arrow, Region};
use nalgebra::{DMatrix, DVector};

/// A positive semidefinite stand-in for minus the Hessian.
#[derive(Clone, Debug, PartialEq)]
pub enum Curvature {
    /// Nothing is known of it.
    Unknown,
    /// One dense matrix.
    Dense(DMatrix<f64>),
    /// Independent blocks that share a few parameters.
    Arrow(Arrow),
}

impl Curvature {
    /// The solution of `(H + λ diag H) s = g`: `None` where that matrix is not positive definite, or not known.
    pub fn damped_step(&self, gradient: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
        let step = match self {
            Self::Unknown => return None,
            Self::Dense(matrix) => {
                let mut damped = matrix.clone();
                damp(&mut damped, damping, floor(matrix.diagonal().max()));
                damped.cholesky()?.solve(gradient)
            }
            Self::Arrow(arrow) => arrow.damped_step(gradient, damping)?,
        };
        Some(step).filter(|step| step.iter().all(|x| x.is_finite()))
    }

    /// The step of [`damped_step`](Self::damped_step) that is best within a region.
    pub(crate) fn damped_step_within(
        &self,
        gradient: &DVector<f64>,
        damping: f64,
        region: &Region,
    ) -> Option<DVector<f64>> {
        let step = self.damped_step(gradient, damping)?;
        if region.contains(&step) {
            return Some(step);
        }
        let mut damped = self.to_dense()?;
        let floor = floor(damped.diagonal().max());
        damp(&mut damped, damping, floor);
        bounded_step(region, gradient, &damped)
    }

    /// `sᵀHs`; zero where nothing is known.
    pub fn along(&self, step: &DVector<f64>) -> f64 {
        match self {
            Self::Unknown => 0.0,
            Self::Dense(matrix) => (matrix * step).dot(step),
            Self::Arrow(arrow) => arrow.along(step),
        }
    }

    /// The diagonal; `None` where nothing is known.
    pub fn diagonal(&self) -> Option<DVector<f64>> {
        match self {
            Self::Unknown => None,
            Self::Dense(matrix) => Some(matrix.diagonal()),
            Self::Arrow(arrow) => {
                let blocks = arrow.arms.iter().map(|arm| &arm.own).chain([&arrow.shared]);
                let entries = blocks.flat_map(|block| (0..block.nrows()).map(|i| block[(i, i)]));
                Some(DVector::from_iterator(arrow.dimension(), entries))
            }
        }
    }

    /// The matrix with all its zeros; `None` where nothing is known.
    pub fn to_dense(&self) -> Option<DMatrix<f64>> {
        match self {
            Self::Unknown => None,
            Self::Dense(matrix) => Some(matrix.clone()),
            Self::Arrow(arrow) => Some(arrow.to_dense()),
        }
    }
}

/// What is added to a diagonal whose largest entry is `most`, so that a parameter without influence does no harm.
pub(crate) fn floor(most: f64) -> f64 {
    f64::EPSILON * most
}

/// Multiplies the diagonal by 1 + damping and adds the floor.
pub(crate) fn damp(matrix: &mut DMatrix<f64>, damping: f64, floor: f64) {
    for i in 0..matrix.nrows() {
        matrix[(i, i)] += damping * matrix[(i, i)] + floor;
    }
}
