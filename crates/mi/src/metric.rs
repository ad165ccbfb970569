//! What every metric does: a value as a function of the joint density, and the table of its derivatives by cell; and sums and
//! products of metrics.

use crate::Joint;

/// A measure of how well the model's bins predict the photo; larger is better.
///
/// Derivatives are along changes that keep the total mass: they are told up to a constant common to all cells. An empty cell
/// has derivative zero: no sample's window touches it.
pub trait Metric: Send + Sync {
    /// The value, larger for a better agreement.
    fn value(&self, joint: &Joint) -> f64;

    /// `∂value/∂p(u, v)` for each cell, row by row.
    fn derivative(&self, joint: &Joint) -> Vec<f64>;

    /// How much the value changes with the samples' mean log-likelihood: 1 for a metric in nats.
    ///
    /// The scores of a log-likelihood have the curvature `Σ s² g gᵀ` (the empirical Fisher matrix); those of a metric that is
    /// `a` times one, `Σ s² g gᵀ / a`.
    fn unit(&self, joint: &Joint) -> f64;

    /// All three at once: what they have in common is computed once.
    fn measure(&self, joint: &Joint) -> Measurement {
        Measurement { value: self.value(joint), derivative: self.derivative(joint), unit: self.unit(joint) }
    }

    /// The second derivatives `Σ Σ ∂²value/∂p∂p' dp_k dp'_l` along `K` tables of changes of the density, as `K × K` numbers;
    /// `None` for a metric that does not tell them.
    fn bend(&self, joint: &Joint, changes: &[Vec<f64>]) -> Option<Vec<f64>> {
        let _ = (joint, changes);
        None
    }
}

/// What a metric says of a density.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurement {
    /// [`Metric::value`].
    pub value: f64,
    /// [`Metric::derivative`].
    pub derivative: Vec<f64>,
    /// [`Metric::unit`].
    pub unit: f64,
}

/// The sum of two metrics.
#[derive(Clone, Copy, Debug, Default)]
pub struct Sum<A, B>(
    /// The first.
    pub A,
    /// The second.
    pub B,
);

/// The product of two metrics, for ones that are never negative.
#[derive(Clone, Copy, Debug, Default)]
pub struct Product<A, B>(
    /// The first.
    pub A,
    /// The second.
    pub B,
);

impl<A: Metric, B: Metric> Metric for Sum<A, B> {
    fn value(&self, joint: &Joint) -> f64 {
        self.0.value(joint) + self.1.value(joint)
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        blend(1.0, self.0.derivative(joint), 1.0, &self.1.derivative(joint))
    }

    fn unit(&self, joint: &Joint) -> f64 {
        self.0.unit(joint) + self.1.unit(joint)
    }

    fn bend(&self, joint: &Joint, changes: &[Vec<f64>]) -> Option<Vec<f64>> {
        Some(blend(1.0, self.0.bend(joint, changes)?, 1.0, &self.1.bend(joint, changes)?))
    }
}

impl<A: Metric, B: Metric> Metric for Product<A, B> {
    fn value(&self, joint: &Joint) -> f64 {
        self.0.value(joint) * self.1.value(joint)
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        blend(self.1.value(joint), self.0.derivative(joint), self.0.value(joint), &self.1.derivative(joint))
    }

    fn unit(&self, joint: &Joint) -> f64 {
        self.1.value(joint) * self.0.unit(joint) + self.0.value(joint) * self.1.unit(joint)
    }

    fn bend(&self, joint: &Joint, changes: &[Vec<f64>]) -> Option<Vec<f64>> {
        let (a, b) = (self.1.value(joint), self.0.value(joint));
        let mut bend = blend(a, self.0.bend(joint, changes)?, b, &self.1.bend(joint, changes)?);
        let (first, second) = (self.0.derivative(joint), self.1.derivative(joint));
        let along = |table: &[f64]| -> Vec<f64> { changes.iter().map(|change| dot(table, change)).collect() };
        let (first, second) = (along(&first), along(&second));
        for (k, row) in bend.chunks_exact_mut(changes.len()).enumerate() {
            for (l, cell) in row.iter_mut().enumerate() {
                *cell += first[k] * second[l] + second[k] * first[l];
            }
        }
        Some(bend)
    }
}

fn blend(a: f64, mut first: Vec<f64>, b: f64, second: &[f64]) -> Vec<f64> {
    first.iter_mut().zip(second).for_each(|(x, y)| *x = a * *x + b * y);
    first
}

pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
