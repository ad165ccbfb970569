//! The joint density of model bins and photo bins, as a table.

/// A joint density: `model_bins` rows of `photo_bins` probabilities that sum to one (to zero where there was no sample).
///
/// The last column is the mass that fell outside the photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    model_bins: usize,
    photo_bins: usize,
    mass: f64,
    cells: Vec<f64>,
}

impl Joint {
    /// A table from unnormalized, non-negative masses, row by row. Where masses are counts, their sum is the number of samples.
    ///
    /// # Panics
    /// If the number of masses is not a multiple of `model_bins`, or `model_bins` is zero.
    #[must_use]
    pub fn from_masses(model_bins: usize, mut masses: Vec<f64>) -> Self {
        assert!(model_bins > 0 && masses.len().is_multiple_of(model_bins), "a joint table is a full rectangle");
        let mass: f64 = masses.iter().sum();
        if mass > 0.0 {
            masses.iter_mut().for_each(|cell| *cell /= mass);
        }
        Self { model_bins, photo_bins: masses.len() / model_bins, mass, cells: masses }
    }

    /// The number of model bins (rows).
    #[must_use]
    pub fn model_bins(&self) -> usize {
        self.model_bins
    }

    /// The number of photo bins (columns), the one for samples outside the photo included.
    #[must_use]
    pub fn photo_bins(&self) -> usize {
        self.photo_bins
    }

    /// The sum of the masses it was made of: the number of samples.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// `p(u, v)`, row by row.
    #[must_use]
    pub fn cells(&self) -> &[f64] {
        &self.cells
    }

    /// The rows of the table, one for each model bin.
    pub fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.cells.chunks_exact(self.photo_bins)
    }

    /// `p(u)`, the density of the model's bins.
    #[must_use]
    pub fn model_marginal(&self) -> Vec<f64> {
        row_sums(&self.cells, self.photo_bins)
    }

    /// `p(v)`, the density of the photo's bins.
    #[must_use]
    pub fn photo_marginal(&self) -> Vec<f64> {
        column_sums(&self.cells, self.photo_bins)
    }

    /// The density with the same marginals in which the model tells nothing of the photo: `p(u) p(v)`.
    #[must_use]
    pub fn independent(&self) -> Self {
        let photo = self.photo_marginal();
        let cells = self.model_marginal().iter().flat_map(|u| photo.iter().map(move |v| u * v)).collect();
        Self { cells, ..*self }
    }
}

/// The sums over the rows of a table of so many columns.
pub(crate) fn row_sums(cells: &[f64], columns: usize) -> Vec<f64> {
    cells.chunks_exact(columns).map(|row| row.iter().sum()).collect()
}

/// The sums over its columns.
pub(crate) fn column_sums(cells: &[f64], columns: usize) -> Vec<f64> {
    let mut sums = vec![0.0; columns];
    for row in cells.chunks_exact(columns) {
        sums.iter_mut().zip(row).for_each(|(sum, p)| *sum += p);
    }
    sums
}
