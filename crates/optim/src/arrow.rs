//! Matrices in the shape of an arrow: many blocks of their own, and a few shared parameters.
//!
//! With C of the own parameters, block by block and sparse, A of the shared ones and B between them,
//!
//! ```text
//! | C   B | c   g        S = A − Bᵀ C⁻¹ B        (Schur's complement)
//! | Bᵀ  A | a = h        S a = h − Bᵀ C⁻¹ g
//!                        c = C⁻¹ (g − B a)
//! ```
//!
//! so that a step costs a small factorization a block, and one of the size of the shared part; S⁻¹ is the covariance of the
//! shared parameters with all others marginalized (B. Triggs et al., *Bundle adjustment: a modern synthesis*, 1999).
//! Blocks that are coupled with each other are eliminated in an order that keeps C sparse.

use crate::block_cholesky::{BlockCholesky, Blocks};
use crate::curvature::{damp, floor};
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// A symmetric matrix of independent blocks that share a few parameters. The own components come first, block by block, the
/// shared ones last.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Arrow {
    /// One a block.
    pub arms: Vec<Arm>,
    /// The blocks that are coupled with each other.
    pub pairs: Vec<Pair>,
    /// The block of the shared parameters, m × m.
    pub shared: DMatrix<f64>,
}

/// A block of an [`Arrow`].
#[derive(Clone, Debug, PartialEq)]
pub struct Arm {
    /// Of the block's own parameters, d × d.
    pub own: DMatrix<f64>,
    /// Between these and the shared ones, d × m.
    pub with_shared: DMatrix<f64>,
}

/// A coupling of two blocks of an [`Arrow`].
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// The index of one block.
    pub first: usize,
    /// The index of the other.
    pub second: usize,
    /// Between their parameters: those of the first by row, of the second by column. Several of the same pair add up.
    pub between: DMatrix<f64>,
}

/// The inverse of an [`Arrow`], as far as it is asked for: the covariances of estimates whose information it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ArrowInverse {
    /// Of the shared parameters.
    pub shared: DMatrix<f64>,
    /// Of each block's own parameters.
    pub own: Vec<DMatrix<f64>>,
    /// Between each block's own parameters and the shared ones.
    pub with_shared: Vec<DMatrix<f64>>,
}

impl Arrow {
    /// An arrow of zeros: the dimension of each block, and that of the shared part.
    pub fn zeros(own: &[usize], shared: usize) -> Self {
        let arm = |&d: &usize| Arm { own: DMatrix::zeros(d, d), with_shared: DMatrix::zeros(d, shared) };
        Self { arms: own.iter().map(arm).collect(), pairs: Vec::new(), shared: DMatrix::zeros(shared, shared) }
    }

    /// The first component of each block, and of the shared part.
    pub fn offsets(&self) -> Vec<usize> {
        let mut offsets = vec![0];
        offsets.extend(self.arms.iter().scan(0, |at, arm| {
            *at += arm.own.nrows();
            Some(*at)
        }));
        offsets
    }

    /// The number of rows.
    pub fn dimension(&self) -> usize {
        self.arms.iter().map(|arm| arm.own.nrows()).sum::<usize>() + self.shared.nrows()
    }

    /// The matrix with all its zeros.
    pub fn to_dense(&self) -> DMatrix<f64> {
        let offsets = self.offsets();
        let (last, m) = (offsets[self.arms.len()], self.shared.nrows());
        let mut dense = DMatrix::zeros(last + m, last + m);
        for (arm, &at) in self.arms.iter().zip(&offsets) {
            let d = arm.own.nrows();
            dense.view_mut((at, at), (d, d)).copy_from(&arm.own);
            dense.view_mut((at, last), (d, m)).copy_from(&arm.with_shared);
            dense.view_mut((last, at), (m, d)).copy_from(&arm.with_shared.transpose());
        }
        for pair in &self.pairs {
            let (i, j) = (offsets[pair.first], offsets[pair.second]);
            let mut upper = dense.view_mut((i, j), pair.between.shape());
            upper += &pair.between;
            let transposed = pair.between.transpose();
            let mut lower = dense.view_mut((j, i), transposed.shape());
            lower += &transposed;
        }
        dense.view_mut((last, last), (m, m)).copy_from(&self.shared);
        dense
    }

    /// `sᵀHs`.
    pub(crate) fn along(&self, step: &DVector<f64>) -> f64 {
        let offsets = self.offsets();
        let shared = step.rows(offsets[self.arms.len()], self.shared.nrows());
        let part = |i: usize| step.rows(offsets[i], self.arms[i].own.nrows());
        let arms = self.arms.iter().enumerate().map(|(i, arm)| {
            let own = part(i);
            (&arm.own * own + 2.0 * &arm.with_shared * shared).dot(&own)
        });
        let pairs = self.pairs.iter().map(|pair| 2.0 * (&pair.between * part(pair.second)).dot(&part(pair.first)));
        arms.chain(pairs).sum::<f64>() + (&self.shared * shared).dot(&shared)
    }

    /// The solution of `(H + λ diag H) s = g`.
    pub(crate) fn damped_step(&self, gradient: &DVector<f64>, damping: f64) -> Option<DVector<f64>> {
        let factor = BlockCholesky::new(self.blocks(damping))?;
        let diagonals = self.arms.iter().map(|arm| &arm.own).chain([&self.shared]);
        let mut at = 0;
        let mut parts: Vec<DMatrix<f64>> = diagonals
            .map(|block| {
                let part = gradient.rows(at, block.nrows());
                at += block.nrows();
                DMatrix::from_column_slice(block.nrows(), 1, part.into_owned().as_slice())
            })
            .collect();
        factor.solve(&mut parts);
        Some(DVector::from_iterator(gradient.len(), parts.iter().flat_map(|part| part.iter().copied())))
    }

    /// The blocks of the inverse on the diagonal and beside the shared part; `None` where the matrix is not positive
    /// definite.
    pub fn inverse(&self) -> Option<ArrowInverse> {
        let mut inverse = BlockCholesky::new(self.blocks(0.0))?.inverse();
        let last = self.arms.len();
        let cross = |(i, arm): (usize, &Arm)| {
            inverse.beside(i, last).unwrap_or_else(|| DMatrix::zeros(arm.own.nrows(), self.shared.nrows()))
        };
        let with_shared = self.arms.iter().enumerate().map(cross).collect();
        let shared = inverse.diagonal.pop()?;
        Some(ArrowInverse { shared, own: inverse.diagonal, with_shared })
    }

    /// The matrix with its diagonal multiplied by 1 + damping, the shared part as the last block.
    fn blocks(&self, damping: f64) -> Blocks {
        let diagonals = || self.arms.iter().map(|arm| &arm.own).chain([&self.shared]);
        let largest = diagonals().filter(|block| !block.is_empty()).map(|block| block.diagonal().max());
        let floor = floor(largest.fold(0.0, f64::max));
        let diagonal = diagonals().map(|block| {
            let mut block = block.clone();
            damp(&mut block, damping, floor);
            block
        });
        let mut beside = vec![BTreeMap::new(); self.arms.len() + 1];
        if self.shared.nrows() > 0 {
            for (i, arm) in self.arms.iter().enumerate() {
                beside[i].insert(self.arms.len(), arm.with_shared.clone());
            }
        }
        for pair in &self.pairs {
            let (i, j) = (pair.first.min(pair.second), pair.first.max(pair.second));
            let block = if i == pair.first { pair.between.clone() } else { pair.between.transpose() };
            beside[i].entry(j).and_modify(|sum: &mut DMatrix<f64>| *sum += &block).or_insert(block);
        }
        Blocks { diagonal: diagonal.collect(), beside }
    }
}
