//! The reduced camera system: dense, or sparse where few cameras see common points. Factored by faer, with the order of
//! elimination found once.

use crate::Columns;
use faer::linalg::solvers::{Llt, Solve};
use faer::sparse::linalg::solvers::{Llt as SparseLlt, SymbolicLlt};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use faer::{Mat, Side};
use nalgebra::{DMatrix, DVector};

/// The lower triangle of S and the right side.
pub(crate) struct Reduced {
    lower: Lower,
    right: DVector<f64>,
}

enum Lower {
    Dense(Mat<f64>),
    Sparse {
        pattern: SymbolicSparseColMat<usize>,
        order: Argsort<usize>,
        values: Vec<f64>,
        symbolic: SymbolicLlt<usize>,
    },
}

/// Below this share of blocks a factorization is sparse, and only from so many columns on.
const SPARSE: f64 = 0.5;
const FEW: usize = 300;

/// Calls `visit` with the place (row ≥ column) and the factor of every entry of a camera's blocks that has one, in the order
/// of the entries.
fn places<const C: usize>(
    columns: &Columns<C>,
    camera: usize,
    others: &[u32],
    mut visit: impl FnMut(usize, usize, usize, usize, usize, f64),
) {
    let mine = columns.of(camera);
    for (slot, &other) in others.iter().enumerate() {
        let same = other as usize == camera;
        for (a, row) in mine.iter().enumerate() {
            for (b, column) in columns.of(other as usize).iter().enumerate() {
                let (Some(row), Some(column)) = (*row, *column) else { continue };
                if same && b > a {
                    continue;
                }
                // What two cameras share is met in both orders of the pair.
                let factor = if row == column && !same { 2.0 } else { 1.0 };
                visit(slot, a, b, row.max(column) as usize, row.min(column) as usize, factor);
            }
        }
    }
}

impl Reduced {
    /// For cameras that see common points with the `others` from each on.
    pub(crate) fn new<'a, const C: usize>(
        columns: &Columns<C>,
        others: impl Iterator<Item = &'a [u32]> + Clone,
    ) -> Option<Self> {
        let n = columns.count();
        let cameras = columns.cameras() as f64;
        let share = others.clone().map(<[u32]>::len).sum::<usize>() as f64 / (0.5 * cameras * (cameras + 1.0));
        let lower = if n < FEW || share > SPARSE {
            Lower::Dense(Mat::zeros(n, n))
        } else {
            let mut entries = Vec::new();
            for (camera, others) in others.enumerate() {
                places(columns, camera, others, |_, _, _, row, col, _| entries.push(Pair { row, col }));
            }
            let (pattern, order) = SymbolicSparseColMat::try_new_from_indices(n, n, &entries).ok()?;
            let symbolic = SymbolicLlt::try_new(pattern.as_ref(), Side::Lower).ok()?;
            Lower::Sparse { pattern, order, values: vec![0.0; entries.len()], symbolic }
        };
        Some(Self { lower, right: DVector::zeros(n) })
    }

    /// Puts S and the right side together from each camera's blocks.
    pub(crate) fn assemble<'a, const C: usize>(
        &mut self,
        columns: &Columns<C>,
        rows: impl Iterator<Item = (&'a [u32], &'a [[[f64; C]; C]], &'a [f64; C])>,
    ) {
        self.right.fill(0.0);
        if let Lower::Dense(matrix) = &mut self.lower {
            matrix.fill(0.0);
        }
        let mut next = 0;
        for (camera, (others, blocks, right)) in rows.enumerate() {
            for (column, x) in columns.of(camera).iter().zip(right) {
                if let Some(column) = column {
                    self.right[*column as usize] += x;
                }
            }
            match &mut self.lower {
                Lower::Dense(matrix) => places(columns, camera, others, |slot, a, b, row, column, factor| {
                    matrix[(row, column)] += factor * blocks[slot][a][b];
                }),
                Lower::Sparse { values, .. } => places(columns, camera, others, |slot, a, b, _, _, factor| {
                    values[next] = factor * blocks[slot][a][b];
                    next += 1;
                }),
            }
        }
    }

    /// The solution; `None` where S is not positive definite.
    pub(crate) fn solve(&self) -> Option<DVector<f64>> {
        let n = self.right.len();
        if n == 0 {
            return Some(self.right.clone());
        }
        let right = faer::MatRef::from_column_major_slice(self.right.as_slice(), n, 1);
        let solution = match &self.lower {
            Lower::Dense(matrix) => Llt::new(matrix.as_ref(), Side::Lower).ok()?.solve(right),
            Lower::Sparse { symbolic, .. } => {
                let matrix = self.sparse()?;
                SparseLlt::try_new_with_symbolic(symbolic.clone(), matrix.as_ref(), Side::Lower).ok()?.solve(right)
            }
        };
        Some(DVector::from_fn(n, |i, _| solution[(i, 0)])).filter(|x| x.iter().all(|x| x.is_finite()))
    }

    /// S⁻¹; `None` where S is not positive definite.
    pub(crate) fn inverse(&self) -> Option<DMatrix<f64>> {
        let n = self.right.len();
        let identity = Mat::<f64>::identity(n, n);
        let inverse = match &self.lower {
            Lower::Dense(matrix) => Llt::new(matrix.as_ref(), Side::Lower).ok()?.solve(&identity),
            Lower::Sparse { symbolic, .. } => {
                let matrix = self.sparse()?;
                SparseLlt::try_new_with_symbolic(symbolic.clone(), matrix.as_ref(), Side::Lower).ok()?.solve(&identity)
            }
        };
        Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)])).filter(|x| x.iter().all(|x| x.is_finite()))
    }

    /// The sparse matrix, or nothing where it is dense.
    fn sparse(&self) -> Option<SparseColMat<usize, f64>> {
        let Lower::Sparse { pattern, order, values, .. } = &self.lower else { return None };
        SparseColMat::new_from_argsort(pattern.clone(), order, values).ok()
    }
}
