//! What every density estimator does.

use crate::{Joint, Samples};

/// An estimator of the joint density of model bins and photo values, and its derivative.
pub trait Density: Sync {
    /// The joint density of the samples.
    fn estimate(&self, samples: &Samples) -> Joint;

    /// Pulls a table of derivatives `∂M/∂p(u, v)` (the shape of [`estimate`](Self::estimate)'s table) back to the photo
    /// values: `N · ∂M/∂v_i` for each of the `N` samples, zero for one outside the photo.
    ///
    /// Model bins are fixed attributes of the samples, so the density of the model's bins does not move, and terms
    /// of the table that are constant along a row cancel.
    fn scores(&self, samples: &Samples, derivative: &[f64]) -> Vec<f32>;
}
