//! Cholesky factorization of symmetric matrices of blocks, most of which are zero.
//!
//! Blocks are eliminated one after the other, that with the fewest neighbours next (minimum degree: W. Tinney & J. Walker,
//! *Direct solutions of sparse network equations by optimally ordered triangular factorization*, Proc. IEEE 55, 1967). To
//! eliminate block k with the diagonal D and the blocks `A_ki` beside it is to keep `G_i = D⁻¹ A_ki` and to take `A_kiᵀ G_j` from
//! what couples its neighbours i and j: Schur's complement, block by block. The diagonal blocks of the inverse follow in reverse
//! order: `Z_ki = −Σ G_j Z_ji`, `Z_kk = D⁻¹ − Σ Z_ki G_iᵀ` (K. Takahashi, J. Fagan, M.-S. Chin, *Formation of a sparse bus
//! impedance matrix*, PICA 1973).

use nalgebra::{Cholesky, DMatrix, Dyn};
use std::collections::BTreeMap;

/// A symmetric matrix of blocks: those on the diagonal, and of each pair i < j that is coupled, block (i, j).
pub(crate) struct Blocks {
    pub(crate) diagonal: Vec<DMatrix<f64>>,
    pub(crate) beside: Vec<BTreeMap<usize, DMatrix<f64>>>,
}

/// A factored matrix of blocks.
pub(crate) struct BlockCholesky {
    /// In the order of elimination.
    eliminated: Vec<Eliminated>,
}

struct Eliminated {
    block: usize,
    diagonal: Cholesky<f64, Dyn>,
    /// The neighbours that were left, and G.
    gains: Vec<(usize, DMatrix<f64>)>,
}

/// The blocks of an inverse on the diagonal, and at the pairs (k, i) where the factor has one.
pub(crate) struct SparseInverse {
    pub(crate) diagonal: Vec<DMatrix<f64>>,
    beside: BTreeMap<(usize, usize), DMatrix<f64>>,
}

impl SparseInverse {
    /// The block of a pair; `None` where the factor has none.
    pub(crate) fn beside(&self, row: usize, column: usize) -> Option<DMatrix<f64>> {
        let stored = |i, j| self.beside.get(&(i, j));
        stored(row, column).cloned().or_else(|| Some(stored(column, row)?.transpose()))
    }
}

impl BlockCholesky {
    /// Factors a matrix, its last block last; `None` where it is not positive definite.
    pub(crate) fn new(matrix: Blocks) -> Option<Self> {
        let Blocks { mut diagonal, mut beside } = matrix;
        let count = diagonal.len();
        let mut neighbours: Vec<Vec<usize>> = vec![Vec::new(); count];
        for (i, row) in beside.iter().enumerate() {
            for &j in row.keys() {
                neighbours[i].push(j);
                neighbours[j].push(i);
            }
        }
        let mut left: Vec<usize> = (0..count.saturating_sub(1)).collect();
        let mut eliminated = Vec::with_capacity(count);
        while eliminated.len() < count {
            let next =
                left.iter().enumerate().min_by_key(|(_, block)| neighbours[**block].len()).map(|(place, _)| place);
            let block = next.map_or(count - 1, |place| left.remove(place));
            let factor = std::mem::replace(&mut diagonal[block], DMatrix::zeros(0, 0)).cholesky()?;
            let around = std::mem::take(&mut neighbours[block]);
            let coupled: Vec<DMatrix<f64>> = around
                .iter()
                .map(|&i| {
                    let stored = beside[block.min(i)].remove(&block.max(i)).expect("neighbours are coupled");
                    if block < i { stored } else { stored.transpose() }
                })
                .collect();
            let gains: Vec<(usize, DMatrix<f64>)> =
                around.iter().zip(&coupled).map(|(&i, beside)| (i, factor.solve(beside))).collect();
            for (&i, coupling) in around.iter().zip(&coupled) {
                neighbours[i].retain(|&j| j != block);
                for (j, gain) in &gains {
                    if i == *j {
                        diagonal[i] -= coupling.tr_mul(gain);
                    } else if i < *j {
                        if !beside[i].contains_key(j) {
                            neighbours[i].push(*j);
                            neighbours[*j].push(i);
                        }
                        let zero = || DMatrix::zeros(coupling.ncols(), gain.ncols());
                        *beside[i].entry(*j).or_insert_with(zero) -= coupling.tr_mul(gain);
                    }
                }
            }
            eliminated.push(Eliminated { block, diagonal: factor, gains });
        }
        Some(Self { eliminated })
    }

    /// The inverse times a vector, given and returned block by block.
    pub(crate) fn solve(&self, right: &mut [DMatrix<f64>]) {
        for Eliminated { block, gains, .. } in &self.eliminated {
            for (i, gain) in gains {
                let taken = gain.tr_mul(&right[*block]);
                right[*i] -= taken;
            }
        }
        for Eliminated { block, diagonal, gains } in self.eliminated.iter().rev() {
            diagonal.solve_mut(&mut right[*block]);
            for (i, gain) in gains {
                let taken = gain * &right[*i];
                right[*block] -= taken;
            }
        }
    }

    /// The inverse where the factor has blocks.
    pub(crate) fn inverse(&self) -> SparseInverse {
        let nothing = vec![DMatrix::zeros(0, 0); self.eliminated.len()];
        let mut inverse = SparseInverse { diagonal: nothing, beside: BTreeMap::new() };
        for Eliminated { block, diagonal, gains } in self.eliminated.iter().rev() {
            let mut own = diagonal.inverse();
            for (i, gain) in gains {
                let mut cross = DMatrix::zeros(gain.nrows(), gain.ncols());
                for (j, other) in gains {
                    cross -= if i == j {
                        other * &inverse.diagonal[*i]
                    } else {
                        other * inverse.beside(*j, *i).expect("eliminating a block couples its neighbours")
                    };
                }
                own -= &cross * gain.transpose();
                inverse.beside.insert((*block, *i), cross);
            }
            inverse.diagonal[*block] = own;
        }
        inverse
    }
}
