//! Metrics of the photo's moments: the correlation ratio, and two baselines that compare a predicted value with the photo's.
//!
//! They look at the samples inside the photo and weigh by their share, so that nothing is won by losing samples. A window of unit
//! mass leaves means as they are and adds the same variance to all rows (a third of a squared bin, for cubic B-splines).

use crate::{Joint, Metric};

/// The correlation ratio `η² = 1 − E[Var(V | U)] / Var(V)`, between 0 and 1, times the share of samples inside the photo: how
/// much of the photo's variance the model's bins explain.
///
/// Source: A. Roche, G. Malandain, X. Pennec, N. Ayache, *The correlation ratio as a new similarity measure for multimodal image
/// registration*, MICCAI 1998. For normal noise it is a monotone function of mutual information, `I = −½ ln(1 − η²)`.
#[derive(Clone, Copy, Debug, Default)]
pub struct CorrelationRatio;

/// The correlation coefficient of a predicted and the seen value, between −1 and 1, times the share of samples inside the photo.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Correlation {
    /// The predicted value of each model bin, in any unit; samples of a bin whose value is NaN do not count.
    pub model: Vec<f64>,
}

/// Minus the mean squared difference of a predicted and the seen value; a sample outside the photo counts as a difference of
/// one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SquaredDifference {
    /// The predicted value of each model bin, in the photo's unit; samples of a bin whose value is NaN do not count.
    pub model: Vec<f64>,
    /// The photo value of each column.
    pub photo: Vec<f64>,
}

/// The cells inside the photo as (row, column, p).
fn inside(joint: &Joint) -> impl Iterator<Item = (usize, f64, f64)> {
    let last = joint.photo_bins() - 1;
    joint
        .rows()
        .enumerate()
        .flat_map(move |(u, row)| row[..last].iter().enumerate().map(move |(v, &p)| (u, v as f64, p)))
}

/// A table from a function of (row, column), zero for empty cells and in the last column.
fn table(joint: &Joint, cell: impl Fn(usize, f64) -> f64) -> Vec<f64> {
    let last = joint.photo_bins() - 1;
    let row = |(u, row): (usize, &[f64])| -> Vec<f64> {
        let value = |(v, &p): (usize, &f64)| if p > 0.0 && v < last { cell(u, v as f64) } else { 0.0 };
        row.iter().enumerate().map(value).collect()
    };
    joint.rows().enumerate().flat_map(row).collect()
}

/// What the correlation ratio is made of.
struct Explained {
    share: f64,
    /// For each row `E[V | u]`.
    means: Vec<f64>,
    mean: f64,
    variance: f64,
    ratio: f64,
}

impl Explained {
    fn of(joint: &Joint) -> Self {
        let mut rows = vec![[0.0; 2]; joint.model_bins()];
        for (u, v, p) in inside(joint) {
            rows[u][0] += p;
            rows[u][1] += p * v;
        }
        let share: f64 = rows.iter().map(|row| row[0]).sum();
        let mean = if share > 0.0 { rows.iter().map(|row| row[1]).sum::<f64>() / share } else { 0.0 };
        let means: Vec<f64> = rows.iter().map(|row| if row[0] > 0.0 { row[1] / row[0] } else { mean }).collect();
        let per_sample = if share > 0.0 { 1.0 / share } else { 0.0 };
        let between = per_sample * rows.iter().zip(&means).map(|(row, m)| row[0] * (m - mean).powi(2)).sum::<f64>();
        let variance = per_sample * inside(joint).map(|(_, v, p)| p * (v - mean).powi(2)).sum::<f64>();
        Self { share, means, mean, variance, ratio: if variance > 0.0 { between / variance } else { 0.0 } }
    }
}

impl Metric for CorrelationRatio {
    fn value(&self, joint: &Joint) -> f64 {
        let Explained { share, ratio, .. } = Explained::of(joint);
        share * ratio
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        let e = Explained::of(joint);
        // One more sample at (u, v) adds to the variance between rows and to the whole; both are means over the share.
        table(joint, |u, v| {
            let whole = (v - e.mean).powi(2);
            let between = whole - (v - e.means[u]).powi(2);
            if e.variance > 0.0 { e.ratio + (between - e.ratio * whole) / e.variance } else { 0.0 }
        })
    }

    fn unit(&self, joint: &Joint) -> f64 {
        2.0 * (1.0 - Explained::of(joint).ratio).max(1e-6)
    }
}

/// Weighted moments of pairs (predicted, seen).
struct Moments {
    share: f64,
    mean: [f64; 2],
    deviation: [f64; 2],
    correlation: f64,
}

impl Correlation {
    fn moments(&self, joint: &Joint) -> Moments {
        assert_eq!(self.model.len(), joint.model_bins(), "one predicted value for each model bin");
        let pairs = || inside(joint).map(|(u, v, p)| (self.model[u], v, p)).filter(|(x, ..)| !x.is_nan());
        let share: f64 = pairs().map(|(_, _, p)| p).sum();
        if share <= 0.0 {
            return Moments { share: 0.0, mean: [0.0; 2], deviation: [0.0; 2], correlation: 0.0 };
        }
        let mean = |value: fn((f64, f64)) -> f64| pairs().map(|(x, y, p)| p * value((x, y))).sum::<f64>() / share;
        let [mx, my] = [mean(|(x, _)| x), mean(|(_, y)| y)];
        let central = |f: &dyn Fn(f64, f64) -> f64| pairs().map(|(x, y, p)| p * f(x - mx, y - my)).sum::<f64>() / share;
        let [dx, dy] = [central(&|x, _| x * x).sqrt(), central(&|_, y| y * y).sqrt()];
        let scale = if dx * dy > 0.0 { 1.0 / (dx * dy) } else { 0.0 };
        Moments { share, mean: [mx, my], deviation: [dx, dy], correlation: scale * central(&|x, y| x * y) }
    }
}

impl Metric for Correlation {
    fn value(&self, joint: &Joint) -> f64 {
        let Moments { share, correlation, .. } = self.moments(joint);
        share * correlation
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        let Moments { mean, deviation, correlation, .. } = self.moments(joint);
        if deviation[0] * deviation[1] <= 0.0 {
            return vec![0.0; joint.cells().len()];
        }
        table(joint, |u, v| {
            let (x, y) = ((self.model[u] - mean[0]) / deviation[0], (v - mean[1]) / deviation[1]);
            if x.is_nan() { 0.0 } else { correlation + x * y - 0.5 * correlation * (x * x + y * y) }
        })
    }

    fn unit(&self, joint: &Joint) -> f64 {
        // A normal pair's mutual information is −½ ln(1 − ρ²).
        let correlation = self.moments(joint).correlation;
        (1.0 - correlation * correlation).max(1e-6) / correlation.abs().max(0.05)
    }
}

impl Metric for SquaredDifference {
    fn value(&self, joint: &Joint) -> f64 {
        assert_eq!(self.model.len(), joint.model_bins(), "one predicted value for each model bin");
        let outside: f64 = joint
            .rows()
            .zip(&self.model)
            .filter(|(_, x)| !x.is_nan())
            .map(|(row, _)| row[joint.photo_bins() - 1])
            .sum();
        let difference = |(u, v, p): (usize, f64, f64)| p * (self.model[u] - self.photo[v as usize]).powi(2);
        -outside - inside(joint).map(difference).filter(|d| !d.is_nan()).sum::<f64>()
    }

    fn derivative(&self, joint: &Joint) -> Vec<f64> {
        table(joint, |u, v| {
            let difference = (self.model[u] - self.photo[v as usize]).powi(2);
            if difference.is_nan() { 0.0 } else { -difference }
        })
    }

    fn unit(&self, joint: &Joint) -> f64 {
        // Normal noise of variance σ²: the log-likelihood is −difference² / 2σ².
        (-2.0 * self.value(joint)).max(1e-6)
    }
}
