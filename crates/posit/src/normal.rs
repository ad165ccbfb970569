//! Normal equations of a small least-squares problem, gathered row by row.

use nalgebra::{Cholesky, Const, SMatrix, SVector};

/// JᵀJ and Jᵀr over the rows added. Plain arrays, all of the square: the compiler makes vectors of its rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Normal<const N: usize> {
    hessian: [[f64; N]; N],
    gradient: [f64; N],
}

impl<const N: usize> Normal<N> {
    pub(crate) fn new() -> Self {
        Self { hessian: [[0.0; N]; N], gradient: [0.0; N] }
    }

    /// Two residuals and their derivatives.
    #[inline]
    pub(crate) fn add(&mut self, [a, b]: [&[f64; N]; 2], residual: [f64; 2]) {
        for i in 0..N {
            for j in 0..N {
                self.hessian[i][j] += a[i] * a[j] + b[i] * b[j];
            }
            self.gradient[i] += a[i] * residual[0] + b[i] * residual[1];
        }
    }

    /// The factor of JᵀJ + damping diag(JᵀJ); `None` if it is not positive definite.
    pub(crate) fn factor(&self, damping: f64) -> Option<Cholesky<f64, Const<N>>> {
        let mut h = SMatrix::<f64, N, N>::from(self.hessian);
        for i in 0..N {
            h[(i, i)] *= 1.0 + damping;
        }
        Cholesky::new(h)
    }

    /// The damped Gauss–Newton step.
    pub(crate) fn step(&self, damping: f64) -> Option<SVector<f64, N>> {
        let step = -self.factor(damping)?.solve(&SVector::from(self.gradient));
        step.iter().all(|x| x.is_finite()).then_some(step)
    }
}
