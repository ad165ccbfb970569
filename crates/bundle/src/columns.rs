//! Which parameters of which camera are free, and which cameras share them.

use nalgebra::{DVector, SVector};
use std::ops::Range;

/// The column of the normal equations of each camera's C parameters. Parameters with the same column are one; those without
/// are fixed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Columns<const C: usize> {
    of: Vec<[Option<u32>; C]>,
    count: usize,
}

impl<const C: usize> Columns<C> {
    /// Every camera has parameters of its own, all free.
    pub fn own(cameras: usize) -> Self {
        Self::shared(cameras, 0..0)
    }

    /// All cameras share the parameters of a range (their intrinsics, say), and have the others to themselves. Start them
    /// from the same values.
    pub fn shared(cameras: usize, parameters: Range<usize>) -> Self {
        let first_shared = cameras * C;
        let label = |i: usize, k: usize| if parameters.contains(&k) { first_shared + k } else { i * C + k };
        let of = (0..cameras).map(|i| std::array::from_fn(|k| Some(label(i, k) as u32))).collect();
        Self { of, count: 0 }.numbered()
    }

    /// Fixes a parameter of a camera, and of those that share it: to fix the gauge, or what is known.
    pub fn fix(mut self, camera: usize, parameter: usize) -> Self {
        if let Some(column) = self.of[camera][parameter] {
            for entry in self.of.iter_mut().flatten().filter(|entry| **entry == Some(column)) {
                *entry = None;
            }
        }
        self.numbered()
    }

    /// The number of columns.
    pub fn count(&self) -> usize {
        self.count
    }

    /// The column of a camera's parameter; `None` where it is fixed.
    pub fn column(&self, camera: usize, parameter: usize) -> Option<usize> {
        self.of[camera][parameter].map(|column| column as usize)
    }

    /// The number of cameras.
    pub(crate) fn cameras(&self) -> usize {
        self.of.len()
    }

    /// The columns of one camera.
    pub(crate) fn of(&self, camera: usize) -> &[Option<u32>; C] {
        &self.of[camera]
    }

    /// A camera's part of a solution: zero where it is fixed.
    pub(crate) fn gather(&self, camera: usize, solution: &DVector<f64>) -> SVector<f64, C> {
        SVector::from_fn(|k, _| self.column(camera, k).map_or(0.0, |column| solution[column]))
    }

    /// Without gaps between the columns.
    fn numbered(mut self) -> Self {
        let mut used: Vec<u32> = self.of.iter().flatten().flatten().copied().collect();
        used.sort_unstable();
        used.dedup();
        for column in self.of.iter_mut().flatten().flatten() {
            *column = used.binary_search(column).expect("every column was collected") as u32;
        }
        self.count = used.len();
        self
    }
}
