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
use crate::curvature::{damp, floor, isolate};
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

    /// `Hs`.
    pub(crate) fn times(&self, step: &DVector<f64>) -> DVector<f64> {
        let offsets = self.offsets();
        let last = offsets[self.arms.len()];
        let part = |i: usize| step.rows(offsets[i], self.arms[i].own.nrows());
        let common = step.rows(last, self.shared.nrows());
        let mut product = DVector::zeros(step.len());
        let mut add = |at: usize, part: DVector<f64>| {
            let mut rows = product.rows_mut(at, part.len());
            rows += part;
        };
        for (i, arm) in self.arms.iter().enumerate() {
            add(offsets[i], &arm.own * part(i) + &arm.with_shared * common);
            add(last, arm.with_shared.tr_mul(&part(i)));
        }
        for pair in &self.pairs {
            add(offsets[pair.first], &pair.between * part(pair.second));
            add(offsets[pair.second], pair.between.tr_mul(&part(pair.first)));
        }
        add(last, &self.shared * common);
        product
    }

    /// This matrix with its diagonal multiplied by 1 + damping, and a little added.
    pub(crate) fn damped(&self, damping: f64) -> Self {
        let mut damped = self.clone();
        let diagonals = || self.arms.iter().map(|arm| &arm.own).chain([&self.shared]);
        let largest = diagonals().filter(|block| !block.is_empty()).map(|block| block.diagonal().max());
        let floor = floor(largest.fold(0.0, f64::max));
        damped.arms.iter_mut().for_each(|arm| damp(&mut arm.own, damping, floor));
        damp(&mut damped.shared, damping, floor);
        damped
    }

    /// Makes row and column of a component those of the identity.
    pub(crate) fn isolate(&mut self, component: usize) {
        let offsets = self.offsets();
        let block = offsets.iter().rposition(|&offset| offset <= component).unwrap_or(0);
        let i = component - offsets[block];
        if block == self.arms.len() {
            isolate(&mut self.shared, i);
            self.arms.iter_mut().for_each(|arm| arm.with_shared.column_mut(i).fill(0.0));
            return;
        }
        isolate(&mut self.arms[block].own, i);
        self.arms[block].with_shared.row_mut(i).fill(0.0);
        for pair in &mut self.pairs {
            if pair.first == block {
                pair.between.row_mut(i).fill(0.0);
            }
            if pair.second == block {
                pair.between.column_mut(i).fill(0.0);
            }
        }
    }

    /// The solution of `H s = g`; `None` where the matrix is not positive definite.
    pub(crate) fn solve(self, gradient: &DVector<f64>) -> Option<DVector<f64>> {
        let mut ends = self.offsets();
        ends.push(gradient.len());
        let part = |ends: &[usize]| gradient.rows(ends[0], ends[1] - ends[0]);
        let mut parts: Vec<DMatrix<f64>> = ends
            .windows(2)
            .map(|ends| DMatrix::from_column_slice(ends[1] - ends[0], 1, part(ends).into_owned().as_slice()))
            .collect();
        let factor = BlockCholesky::new(self.into_blocks())?;
        factor.solve(&mut parts);
        Some(DVector::from_iterator(gradient.len(), parts.iter().flat_map(|part| part.iter().copied())))
    }

    /// The blocks of the inverse on the diagonal and beside the shared part; `None` where the matrix is not positive
    /// definite.
    pub fn inverse(&self) -> Option<ArrowInverse> {
        let mut inverse = BlockCholesky::new(self.damped(0.0).into_blocks())?.inverse();
        let last = self.arms.len();
        let cross = |(i, arm): (usize, &Arm)| {
            inverse.beside(i, last).unwrap_or_else(|| DMatrix::zeros(arm.own.nrows(), self.shared.nrows()))
        };
        let with_shared = self.arms.iter().enumerate().map(cross).collect();
        let shared = inverse.diagonal.pop()?;
        Some(ArrowInverse { shared, own: inverse.diagonal, with_shared })
    }

    /// The blocks, the shared part last.
    fn into_blocks(self) -> Blocks {
        let last = self.arms.len();
        let mut beside = vec![BTreeMap::new(); last + 1];
        for pair in &self.pairs {
            let (i, j) = (pair.first.min(pair.second), pair.first.max(pair.second));
            let block = if i == pair.first { pair.between.clone() } else { pair.between.transpose() };
            beside[i].entry(j).and_modify(|sum: &mut DMatrix<f64>| *sum += &block).or_insert(block);
        }
        let mut diagonal = Vec::with_capacity(last + 1);
        for (i, arm) in self.arms.into_iter().enumerate() {
            diagonal.push(arm.own);
            if !self.shared.is_empty() {
                beside[i].insert(last, arm.with_shared);
            }
        }
        diagonal.push(self.shared);
        Blocks { diagonal, beside }
    }
}
