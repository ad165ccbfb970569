//! What every estimator of a joint density does.

use crate::Joint;

/// An estimator of the joint density of model bins and photo bins from samples of a kind `S`, and its derivatives.
///
/// A sample moves by some coordinates: its photo value, its place in the photo, the model's attribute. A [`Score`](Self::Score)
/// holds one number for each.
pub trait Density<S>: Sync {
    /// Derivatives by the coordinates of one sample.
    type Score;

    /// The joint density of the samples.
    fn estimate(&self, samples: &S) -> Joint;

    /// Pulls a table of derivatives `∂M/∂p(u, v)` (the shape of [`estimate`](Self::estimate)'s table) back to the samples:
    /// `N` times the derivatives of `M` by the coordinates of each of the `N` samples, zero for one outside the photo.
    fn scores(&self, samples: &S, derivative: &[f64]) -> Vec<Self::Score>;
}

/// A density that can be differentiated twice by the samples' photo values.
pub trait TwiceDifferentiable<S>: Density<S> {
    /// The derivative of the density along a motion of the samples in which sample `i` changes its photo value at `rates[i]`:
    /// a table of the shape of [`estimate`](Density::estimate)'s.
    fn along(&self, samples: &S, rates: &[f64]) -> Vec<f64>;

    /// `N ∂²(Σ D p)/∂v_i²` for a table `D` of derivatives by cell: what the bending of the windows adds to a Hessian.
    fn second_scores(&self, samples: &S, derivative: &[f64]) -> Vec<Self::Score>;
}
