//! Information-theoretic metrics between what a model predicts and what a photograph shows, with exact derivatives.
//!
//! Numbers in, numbers out: a sample is a pair (model bin, photo value). A [`Density`] turns samples into a
//! [`Joint`] table, a [`Metric`] turns the table into a value and the table of its derivatives by cell, and the
//! density pulls those derivatives back to one score per sample, `∂M/∂v_i`. A metric therefore never sees a sample and a
//! density never sees a metric; whoever owns the geometry multiplies the scores by `∂v_i/∂(parameters)`.
//!
//! Entropies are in nats. Results do not depend on the number of threads: sums run over chunks of fixed size in a
//! fixed order.
//!
//! ```
//! use texreg_mi::{Density, Metric, MutualInformation, Parzen, Samples};
//!
//! // The photo is dark where the model says 0 and bright where it says 1: one bit, ln 2 nats.
//! let model: Vec<u16> = (0..1000).map(|i| i % 2).collect();
//! let photo: Vec<f32> = model.iter().map(|&u| 0.2 + 0.6 * f32::from(u)).collect();
//! let samples = Samples { model: &model, photo: &photo };
//! let density = Parzen { model_bins: 2, photo_bins: 32 };
//! let joint = density.estimate(&samples);
//! assert!((MutualInformation.value(&joint) - 2f64.ln()).abs() < 1e-6);
//! let scores = density.scores(&samples, &MutualInformation.derivative(&joint));
//! assert_eq!(scores.len(), samples.len());
//! ```

mod density;
mod emma;
mod entropy;
mod hessian;
mod histogram;
mod joint;
mod metric;
mod moments;
mod mutual;
mod orientation;
mod partial_volume;
mod parzen;
mod ranks;
mod real;
mod samples;
mod soft;
mod spline;

pub use density::{Density, TwiceDifferentiable};
pub use emma::{Emma, Evaluation, Points};
pub use entropy::{
    ConditionalEntropy, Entropies, EntropyCorrelation, EntropyFunction, EntropyMetric, MillerMadow, MutualInformation,
    NormalizedMutualInformation,
};
pub use hessian::hessian;
pub use histogram::Histogram;
pub use joint::Joint;
pub use metric::{Measurement, Metric, Product, Sum};
pub use moments::{Correlation, CorrelationRatio, SquaredDifference};
pub use mutual::{Mutual, PhotoPair};
pub use orientation::{Agreement, EdgeAgreement};
pub use partial_volume::{BinnedPhoto, PartialVolume, Places, Sharing};
pub use parzen::Parzen;
pub use ranks::ranks;
pub use real::Real;
pub use samples::Samples;
pub use soft::{SoftParzen, SoftSamples};
pub use spline::cubic;

/// The README's example, compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
