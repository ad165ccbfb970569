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
        self.damped(damping).solve(gradient)
    }

    /// The step of [`damped_step`](Self::damped_step) that is best within a region.
    pub(crate) fn damped_step_within(
        &self,
        gradient: &DVector<f64>,
        damping: f64,
        region: &Region,
    ) -> Option<DVector<f64>> {
        let damped = self.damped(damping);
        let step = damped.clone().solve(gradient)?;
        if region.contains(&step) { Some(step) } else { bounded_step(region, gradient, &damped) }
    }

    /// The matrix with its diagonal multiplied by 1 + damping, and a little added.
    fn damped(&self, damping: f64) -> Self {
        match self {
            Self::Unknown => Self::Unknown,
            Self::Dense(matrix) => {
                let mut damped = matrix.clone();
                damp(&mut damped, damping, floor(matrix.diagonal().max()));
                Self::Dense(damped)
            }
            Self::Arrow(arrow) => Self::Arrow(arrow.damped(damping)),
        }
    }

    /// The solution of `H s = g`; `None` where the matrix is not positive definite, or not known.
    pub(crate) fn solve(self, gradient: &DVector<f64>) -> Option<DVector<f64>> {
        let step = match self {
            Self::Unknown => return None,
            Self::Dense(matrix) => matrix.cholesky()?.solve(gradient),
            Self::Arrow(arrow) => arrow.solve(gradient)?,
        };
        Some(step).filter(|step| step.iter().all(|x| x.is_finite()))
    }

    /// `Hs`; zero where nothing is known.
    pub(crate) fn times(&self, step: &DVector<f64>) -> DVector<f64> {
        match self {
            Self::Unknown => DVector::zeros(step.len()),
            Self::Dense(matrix) => matrix * step,
            Self::Arrow(arrow) => arrow.times(step),
        }
    }

    /// `sᵀHs`; zero where nothing is known.
    pub fn along(&self, step: &DVector<f64>) -> f64 {
        self.times(step).dot(step)
    }

    /// Changes `H s = g` to the equations of the other components where one is given: its row and column become those of
    /// the identity.
    pub(crate) fn pin(&mut self, component: usize, value: f64, gradient: &mut DVector<f64>) {
        let mut given = DVector::zeros(gradient.len());
        given[component] = value;
        *gradient -= self.times(&given);
        gradient[component] = value;
        match self {
            Self::Unknown => {}
            Self::Dense(matrix) => isolate(matrix, component),
            Self::Arrow(arrow) => arrow.isolate(component),
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

/// Makes row and column of a component those of the identity.
pub(crate) fn isolate(matrix: &mut DMatrix<f64>, component: usize) {
    matrix.row_mut(component).fill(0.0);
    matrix.column_mut(component).fill(0.0);
    matrix[(component, component)] = 1.0;
}
