//! Normal equations of a small least-squares problem, gathered row by row.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// JᵀJ (lower triangle), Jᵀr and rᵀr over the rows added.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Normal<const N: usize> {
    hessian: SMatrix<f64, N, N>,
    gradient: SVector<f64, N>,
}

impl<const N: usize> Normal<N> {
    pub(crate) fn new() -> Self {
        Self { hessian: SMatrix::zeros(), gradient: SVector::zeros() }
    }

    /// Two residuals and their derivatives.
    pub(crate) fn add(&mut self, jacobian: [&[f64; N]; 2], residual: [f64; 2]) {
        let [a, b] = jacobian;
        for j in 0..N {
            for i in j..N {
                self.hessian[(i, j)] += a[i] * a[j] + b[i] * b[j];
            }
            self.gradient[j] += a[j] * residual[0] + b[j] * residual[1];
        }
    }

    /// The factor of JᵀJ + damping diag(JᵀJ); `None` if it is not positive definite.
    pub(crate) fn factor(&self, damping: f64) -> Option<Cholesky<f64, Const<N>>> {
        let mut h = self.hessian;
        for i in 0..N {
            h[(i, i)] *= 1.0 + damping;
        }
        h.fill_upper_triangle_with_lower_triangle();
        Cholesky::new(h)
    }

    /// The damped Gauss–Newton step.
    pub(crate) fn step(&self, damping: f64) -> Option<SVector<f64, N>> {
        let step = -self.factor(damping)?.solve(&self.gradient);
        step.iter().all(|x| x.is_finite()).then_some(step)
    }
}
