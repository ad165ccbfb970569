//! Metrics that are functions of the three entropies H(U), H(V) and H(U, V), in nats.

use crate::joint::{column_sums, row_sums};
use crate::metric::dot;
use crate::{Joint, Measurement, Metric};

/// The entropies of a joint density and its marginals, in nats.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Entropies {
    /// `H(U)`, of the model's bins.
    pub model: f64,
    /// `H(V)`, of the photo's bins.
    pub photo: f64,
    /// `H(U, V)`.
    pub both: f64,
}

/// A function of the entropies at a point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct EntropyFunction {
    /// The value.
    pub value: f64,
    /// The derivatives by `H(U)`, `H(V)` and `H(U, V)`.
    pub first: [f64; 3],
    /// The second derivatives, in the same order.
    pub second: [[f64; 3]; 3],
}

/// A metric that is a function of the entropies alone.
pub trait EntropyMetric: Send + Sync {
    /// The function at some entropies.
    fn at(&self, entropies: &Entropies) -> EntropyFunction;
}

/// Mutual information `I(U; V) = H(U) + H(V) − H(U, V)`, in nats (the thesis' equation 3.1).
///
/// Source: P. Viola and W. Wells, *Alignment by maximization of mutual information*, IJCV 24(2), 1997.
/// `∂I/∂p(u, v) = ln(p(u, v) / (p(u) p(v)))`.
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

/// A metric of entropies less the bias that a finite number of samples gives them.
///
/// An entropy estimated from counts in `m` occupied cells of `N` samples is too small by `(m − 1) / 2N` on average: G. Miller,
/// *Note on the bias of information estimates*, in Information Theory in Psychology, 1955. Meant for hard histograms; the
/// correction is constant between jumps, so the derivatives are those at the corrected entropies.
#[derive(Clone, Copy, Debug, Default)]
pub struct MillerMadow<M>(
    /// The metric.
    pub M,
);

impl EntropyMetric for MutualInformation {
    fn at(&self, h: &Entropies) -> EntropyFunction {
        EntropyFunction { value: h.model + h.photo - h.both, first: [1.0, 1.0, -1.0], ..Default::default() }
    }
}

impl EntropyMetric for NormalizedMutualInformation {
    fn at(&self, h: &Entropies) -> EntropyFunction {
        if h.both <= 0.0 {
            return EntropyFunction { value: 1.0, ..Default::default() };
        }
        let (sum, r) = (h.model + h.photo, 1.0 / h.both);
        EntropyFunction {
            value: sum * r,
            first: [r, r, -sum * r * r],
            second: [[0.0, 0.0, -r * r], [0.0, 0.0, -r * r], [-r * r, -r * r, 2.0 * sum * r * r * r]],
        }
    }
}

impl EntropyMetric for EntropyCorrelation {
    fn at(&self, h: &Entropies) -> EntropyFunction {
        if h.model + h.photo <= 0.0 {
            return EntropyFunction::default();
        }
        let r = 1.0 / (h.model + h.photo);
        let (by_sum, cross) = (2.0 * h.both * r * r, 2.0 * r * r);
        let twice = -2.0 * by_sum * r;
        EntropyFunction {
            value: 2.0 - 2.0 * h.both * r,
            first: [by_sum, by_sum, -2.0 * r],
            second: [[twice, twice, cross], [twice, twice, cross], [cross, cross, 0.0]],
        }
    }
}

impl EntropyMetric for ConditionalEntropy {
    fn at(&self, h: &Entropies) -> EntropyFunction {
        EntropyFunction { value: h.model - h.both, first: [1.0, 0.0, -1.0], ..Default::default() }
    }
}

impl<M: EntropyMetric> Metric for M {
    fn value(&self, joint: &Joint) -> f64 {
        self.at(&Marginals::of(joint).entropies).value
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        let marginals = Marginals::of(joint);
        marginals.derivative(joint, &self.at(&marginals.entropies))
    }

    fn unit(&self, joint: &Joint) -> f64 {
        -self.at(&Marginals::of(joint).entropies).first[2]
    }

    fn measure(&self, joint: &Joint) -> Measurement {
        let marginals = Marginals::of(joint);
        let function = self.at(&marginals.entropies);
        let derivative = marginals.derivative(joint, &function);
        Measurement { value: function.value, derivative, unit: -function.first[2] }
    }

    fn bend(&self, joint: &Joint, changes: &[Vec<f64>]) -> Option<Vec<f64>> {
        let marginals = Marginals::of(joint);
        Some(marginals.bend(joint, &self.at(&marginals.entropies), changes))
    }
}

impl<M: EntropyMetric> MillerMadow<M> {
    fn corrected(joint: &Joint) -> Marginals {
        let mut marginals = Marginals::of(joint);
        let bias = |density: &[f64]| {
            let occupied = density.iter().filter(|&&p| p > 0.0).count();
            if joint.mass() > 0.0 { (occupied as f64 - 1.0) / (2.0 * joint.mass()) } else { 0.0 }
        };
        marginals.entropies.model += bias(&marginals.model);
        marginals.entropies.photo += bias(&marginals.photo);
        marginals.entropies.both += bias(joint.cells());
        marginals
    }
}

impl<M: EntropyMetric> Metric for MillerMadow<M> {
    fn value(&self, joint: &Joint) -> f64 {
        self.0.at(&Self::corrected(joint).entropies).value
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        let marginals = Self::corrected(joint);
        marginals.derivative(joint, &self.0.at(&marginals.entropies))
    }

    fn unit(&self, joint: &Joint) -> f64 {
        -self.0.at(&Self::corrected(joint).entropies).first[2]
    }

    fn bend(&self, joint: &Joint, changes: &[Vec<f64>]) -> Option<Vec<f64>> {
        let marginals = Self::corrected(joint);
        Some(marginals.bend(joint, &self.0.at(&marginals.entropies), changes))
    }
}

/// The marginal densities of a table, and all entropies.
struct Marginals {
    model: Vec<f64>,
    photo: Vec<f64>,
    entropies: Entropies,
}

impl Marginals {
    fn of(joint: &Joint) -> Self {
        let (model, photo) = (joint.model_marginal(), joint.photo_marginal());
        let entropies = Entropies { model: entropy(&model), photo: entropy(&photo), both: entropy(joint.cells()) };
        Self { model, photo, entropies }
    }

    /// `Σ_a ∂f/∂H_a · ∂H_a/∂p(u, v)`, where `∂H/∂p = −ln p` up to a constant.
    fn derivative(&self, joint: &Joint, function: &EntropyFunction) -> Vec<f64> {
        let [by_model, by_photo, by_both] = function.first;
        let photo: Vec<f64> = self.photo.iter().map(|p| by_photo * p.ln()).collect();
        let mut table = Vec::with_capacity(joint.cells().len());
        for (row, u) in joint.rows().zip(&self.model) {
            let model = by_model * u.ln();
            let cell = |(&p, v): (&f64, &f64)| if p > 0.0 { -by_both * p.ln() - model - v } else { 0.0 };
            table.extend(row.iter().zip(&photo).map(cell));
        }
        table
    }

    /// `Σ_ab ∂²f/∂H_a∂H_b dH_a dH_b + Σ_a ∂f/∂H_a d²H_a`, where `d²H = −Σ dp dp' / p`.
    fn bend(&self, joint: &Joint, function: &EntropyFunction, changes: &[Vec<f64>]) -> Vec<f64> {
        let columns = joint.photo_bins();
        let parts: Vec<[Vec<f64>; 3]> = changes
            .iter()
            .map(|change| [row_sums(change, columns), column_sums(change, columns), change.clone()])
            .collect();
        let densities = [&self.model[..], &self.photo, joint.cells()];
        let slopes: Vec<[f64; 3]> = parts
            .iter()
            .map(|part| {
                std::array::from_fn(|a| -dot(&densities[a].iter().map(|&p| log(p)).collect::<Vec<_>>(), &part[a]))
            })
            .collect();
        let mut bend = Vec::with_capacity(changes.len() * changes.len());
        for (first, slope) in parts.iter().zip(&slopes) {
            for (second, other) in parts.iter().zip(&slopes) {
                let mut sum = 0.0;
                for a in 0..3 {
                    let cells = densities[a].iter().zip(&first[a]).zip(&second[a]);
                    let quadratic: f64 = cells.filter(|((p, _), _)| **p > 0.0).map(|((p, x), y)| x * y / p).sum();
                    sum -= function.first[a] * quadratic;
                    sum += slope[a] * dot(&function.second[a], other);
                }
                bend.push(sum);
            }
        }
        bend
    }
}

/// `ln p`, and 0 for an empty cell.
fn log(p: f64) -> f64 {
    if p > 0.0 { p.ln() } else { 0.0 }
}

/// `−Σ p ln p`, with `0 ln 0 = 0`.
pub(crate) fn entropy(density: &[f64]) -> f64 {
    -density.iter().map(|&p| p * log(p)).sum::<f64>()
}
