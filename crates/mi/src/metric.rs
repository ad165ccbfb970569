//! Metrics as functions of the joint density: a value, and the table of its derivatives by cell.
//!
//! The derivatives are those along changes that keep the density of the model's bins and the total mass, which is all
//! that moving samples with fixed attributes can do: terms constant along a row of the table are left out. An empty cell
//! has derivative zero: no sample's window touches it.

use crate::Joint;

/// A measure of how well the model's bins predict the photo; larger is better.
pub trait Metric: Sync {
    /// The value, larger for a better agreement.
    fn value(&self, joint: &Joint) -> f64;

    /// `∂value/∂p(u, v)` for each cell, row by row, up to terms constant along a row.
    fn derivative(&self, joint: &Joint) -> Vec<f64>;
}

/// Mutual information `I(U; V) = H(U) + H(V) − H(U, V)`, in nats (the thesis' equation 3.1).
///
/// Source: P. Viola and W. Wells, *Alignment by maximization of mutual information*, IJCV 24(2), 1997.
/// `∂I/∂p(u, v) = ln(p(u, v) / p(v))` up to row constants.
#[derive(Clone, Copy, Debug, Default)]
pub struct MutualInformation;

/// Normalized mutual information `(H(U) + H(V)) / H(U, V)`, between 1 and 2.
///
/// Source: C. Studholme, D. Hill, D. Hawkes, *An overlap invariant entropy measure of 3D medical image alignment*,
/// Pattern Recognition 32(1), 1999. The normalized information distance is `2 − NMI`: the same objective.
#[derive(Clone, Copy, Debug, Default)]
pub struct NormalizedMutualInformation;

/// The entropy correlation coefficient `2 I(U; V) / (H(U) + H(V))`, between 0 and 1.
///
/// Source: F. Maes et al., *Multimodality image registration by maximization of mutual information*, IEEE TMI 16(2), 1997.
#[derive(Clone, Copy, Debug, Default)]
pub struct EntropyCorrelation;

/// Minus the conditional entropy `H(V | U) = H(U, V) − H(U)`, in nats: how certainly the model predicts the photo.
#[derive(Clone, Copy, Debug, Default)]
pub struct ConditionalEntropy;

impl Metric for MutualInformation {
    fn value(&self, joint: &Joint) -> f64 {
        let Entropies { model, photo, both } = entropies(joint);
        model + photo - both
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        combine(joint, -1.0, 1.0)
    }
}

impl Metric for NormalizedMutualInformation {
    fn value(&self, joint: &Joint) -> f64 {
        let Entropies { model, photo, both } = entropies(joint);
        if both > 0.0 { (model + photo) / both } else { 1.0 }
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        let Entropies { model, photo, both } = entropies(joint);
        if both > 0.0 {
            combine(joint, -(model + photo) / (both * both), 1.0 / both)
        } else {
            vec![0.0; joint.cells().len()]
        }
    }
}

impl Metric for EntropyCorrelation {
    fn value(&self, joint: &Joint) -> f64 {
        let Entropies { model, photo, both } = entropies(joint);
        if model + photo > 0.0 { 2.0 - 2.0 * both / (model + photo) } else { 0.0 }
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        let Entropies { model, photo, both } = entropies(joint);
        let sum = model + photo;
        if sum > 0.0 { combine(joint, -2.0 / sum, 2.0 * both / (sum * sum)) } else { vec![0.0; joint.cells().len()] }
    }
}

impl Metric for ConditionalEntropy {
    fn value(&self, joint: &Joint) -> f64 {
        let Entropies { model, both, .. } = entropies(joint);
        model - both
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        combine(joint, -1.0, 0.0)
    }
}

struct Entropies {
    model: f64,
    photo: f64,
    both: f64,
}

fn entropies(joint: &Joint) -> Entropies {
    Entropies {
        model: entropy(&joint.model_marginal()),
        photo: entropy(&joint.photo_marginal()),
        both: entropy(joint.cells()),
    }
}

/// `−Σ p ln p`, with `0 ln 0 = 0`.
fn entropy(density: &[f64]) -> f64 {
    -density.iter().filter(|&&p| p > 0.0).map(|p| p * p.ln()).sum::<f64>()
}

/// The table `by_joint · ∂H(U,V)/∂p + by_photo · ∂H(V)/∂p = −by_joint · ln p(u,v) − by_photo · ln p(v)` up to constants.
fn combine(joint: &Joint, by_joint: f64, by_photo: f64) -> Vec<f64> {
    let log_photo: Vec<f64> = joint.photo_marginal().iter().map(|p| by_photo * p.ln()).collect();
    let row = |row: &[f64]| -> Vec<f64> {
        row.iter().zip(&log_photo).map(|(&p, log_v)| if p > 0.0 { -by_joint * p.ln() - log_v } else { 0.0 }).collect()
    };
    joint.rows().flat_map(row).collect()
}
