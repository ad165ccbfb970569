//! The joint density of model bins and photo bins, as a table.

/// A joint density: `model_bins` rows of `photo_bins` probabilities that sum to one (to zero where there was no sample).
///
/// The last column is the mass that fell outside the photo.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    model_bins: usize,
    photo_bins: usize,
    cells: Vec<f64>,
}

impl Joint {
    /// A table from unnormalized, non-negative masses, row by row.
    ///
    /// # Panics
    /// If the number of masses is not a multiple of `model_bins`, or `model_bins` is zero.
    #[must_use]
    pub fn from_masses(model_bins: usize, mut masses: Vec<f64>) -> Self {
        assert!(model_bins > 0 && masses.len().is_multiple_of(model_bins), "a joint table is a full rectangle");
        let total: f64 = masses.iter().sum();
        if total > 0.0 {
            masses.iter_mut().for_each(|mass| *mass /= total);
        }
        Self { model_bins, photo_bins: masses.len() / model_bins, cells: masses }
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
        self.rows().map(|row| row.iter().sum()).collect()
    }

    /// `p(v)`, the density of the photo's bins.
    #[must_use]
    pub fn photo_marginal(&self) -> Vec<f64> {
        let mut marginal = vec![0.0; self.photo_bins];
        for row in self.rows() {
            marginal.iter_mut().zip(row).for_each(|(sum, p)| *sum += p);
        }
        marginal
    }
}
