//! Samples and metrics for the tests.
#![allow(dead_code)]

use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_mi::{
    ConditionalEntropy, Correlation, CorrelationRatio, EntropyCorrelation, Metric, MillerMadow, MutualInformation,
    NormalizedMutualInformation, Parzen, Product, SquaredDifference, Sum,
};

/// Every metric for tables of so many model bins and columns.
pub(crate) fn metrics(rows: usize, columns: usize) -> Vec<(&'static str, Box<dyn Metric>)> {
    let model: Vec<f64> = (0..rows).map(|u| if u == 0 { f64::NAN } else { (0.3 * u as f64).sin() }).collect();
    let photo = Parzen { model_bins: rows, photo_bins: columns.max(5) - 1 }.photo_values();
    vec![
        ("mutual information", Box::new(MutualInformation)),
        ("normalized mutual information", Box::new(NormalizedMutualInformation)),
        ("entropy correlation", Box::new(EntropyCorrelation)),
        ("conditional entropy", Box::new(ConditionalEntropy)),
        ("corrected", Box::new(MillerMadow(NormalizedMutualInformation))),
        ("correlation ratio", Box::new(CorrelationRatio)),
        ("correlation", Box::new(Correlation { model: model.clone() })),
        ("squared difference", Box::new(SquaredDifference { model, photo })),
        ("sum", Box::new(Sum(MutualInformation, CorrelationRatio))),
        ("product", Box::new(Product(NormalizedMutualInformation, EntropyCorrelation))),
    ]
}

/// Seven model bins and photo values that depend on them, with noise; every fiftieth outside the photo.
pub(crate) fn related(count: usize, seed: u64) -> (Vec<u16>, Vec<f64>) {
    let mut random = StdRng::seed_from_u64(seed);
    let model: Vec<u16> = (0..count).map(|_| random.random_range(0..7)).collect();
    let photo = model
        .iter()
        .enumerate()
        .map(|(i, &u)| {
            let value = 0.1 + 0.1 * f64::from(u) + random.random_range(0.0..0.2);
            if i % 50 == 0 { f64::NAN } else { value }
        })
        .collect();
    (model, photo)
}

/// Richardson's extrapolation of central differences at zero.
pub(crate) fn slope(step: f64, value: impl Fn(f64) -> f64) -> f64 {
    let central = |h: f64| (value(h) - value(-h)) / (2.0 * h);
    (4.0 * central(step) - central(2.0 * step)) / 3.0
}
