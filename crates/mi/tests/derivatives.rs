//! Every derivative agrees with differences.

mod common;

use common::{metrics, related, slope};
use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_mi::{Density, Joint, Metric, MutualInformation, Parzen, Samples, hessian};

const DENSITY: Parzen = Parzen { model_bins: 7, photo_bins: 20 };

/// Motions of the samples: each draws every sample towards its own place, some more than others.
fn motions(photo: &[f64], count: usize) -> Vec<Vec<f64>> {
    let mut random = StdRng::seed_from_u64(3);
    (0..count)
        .map(|k| {
            let towards = 0.3 + 0.2 * k as f64;
            let rate = |v: &f64| if v.is_nan() { 0.0 } else { (towards - v) * random.random_range(0.0..2.0) };
            photo.iter().map(rate).collect()
        })
        .collect()
}

fn moved(photo: &[f64], step: f64, rates: &[f64]) -> Vec<f64> {
    photo.iter().zip(rates).map(|(v, d)| v + step * d).collect()
}

/// Tables of any kind, the model's marginal changing too.
#[test]
fn tables_agree_with_differences() {
    let mut random = StdRng::seed_from_u64(2);
    let masses: Vec<f64> = (0..7 * 21).map(|i| if i % 5 == 0 { 0.0 } else { random.random_range(0.1..1.0) }).collect();
    let mut change: Vec<f64> =
        masses.iter().map(|&m| if m > 0.0 { random.random_range(-0.1..0.1) } else { 0.0 }).collect();
    // No motion takes a sample in or out.
    (0..7).for_each(|row| change[row * 21 + 20] = 0.0);
    let mean = change.iter().sum::<f64>() / change.iter().filter(|&&x| x != 0.0).count() as f64;
    change.iter_mut().filter(|x| **x != 0.0).for_each(|x| *x -= mean);
    let at = |step: f64| Joint::from_masses(7, masses.iter().zip(&change).map(|(m, d)| m + step * d).collect());
    for (name, metric) in metrics(7, 21) {
        let joint = at(0.0);
        let table = metric.derivative(&joint);
        let exact = table.iter().zip(&change).map(|(d, c)| d * c / joint.mass()).sum::<f64>();
        let difference = slope(1e-3, |h| metric.value(&at(h)));
        assert!((exact - difference).abs() < 1e-8 * exact.abs().max(1e-3), "{name}: {exact} against {difference}");
        assert!(metric.unit(&joint) > 0.0, "{name}");
    }
}

#[test]
fn scores_agree_with_differences() {
    let (model, photo) = related(5_000, 2);
    for rates in motions(&photo, 3) {
        for (name, metric) in metrics(7, 21) {
            let value =
                |h: f64| metric.value(&DENSITY.estimate(&Samples { model: &model, photo: &moved(&photo, h, &rates) }));
            let samples = Samples { model: &model, photo: &photo };
            let scores = DENSITY.scores(&samples, &metric.derivative(&DENSITY.estimate(&samples)));
            let exact = scores.iter().zip(&rates).map(|(s, d)| s * d).sum::<f64>() / model.len() as f64;
            let difference = slope(1e-4, value);
            assert!((exact - difference).abs() < 1e-6 * exact.abs(), "{name}: {exact} against {difference}");
        }
    }
}

#[test]
fn single_precision_agrees_with_double() {
    let (model, photo) = related(20_000, 7);
    let single: Vec<f32> = photo.iter().map(|&v| v as f32).collect();
    let photo: Vec<f64> = single.iter().map(|&v| f64::from(v)).collect();
    let (a, b) = (Samples { model: &model, photo: &single }, Samples { model: &model, photo: &photo });
    let (p, q) = (DENSITY.estimate(&a), DENSITY.estimate(&b));
    p.cells().iter().zip(q.cells()).for_each(|(p, q)| assert!((p - q).abs() < 1e-7, "{p} against {q}"));
    assert!((MutualInformation.value(&p) - MutualInformation.value(&q)).abs() < 1e-6);
    let table = MutualInformation.derivative(&q);
    let (s, t) = (DENSITY.scores(&a, &table), DENSITY.scores(&b, &table));
    s.iter().zip(&t).for_each(|(&s, t)| assert!((f64::from(s) - t).abs() < 1e-3, "{s} against {t}"));
}

#[test]
fn hessians_agree_with_differences() {
    let (model, photo) = related(5_000, 5);
    let rates = motions(&photo, 2);
    let samples = Samples { model: &model, photo: &photo };
    let mut told = 0;
    for (name, metric) in metrics(7, 21) {
        let Some(exact) = hessian(&DENSITY, &*metric, &samples, &rates) else { continue };
        told += 1;
        assert!((exact[1] - exact[2]).abs() < 1e-9 * exact[0].abs(), "{name} is not symmetric");
        for (k, l) in [(0, 0), (0, 1), (1, 1)] {
            let gradient = |h: f64| {
                let photo = moved(&photo, h, &rates[k]);
                let samples = Samples { model: &model, photo: &photo };
                let scores = DENSITY.scores(&samples, &metric.derivative(&DENSITY.estimate(&samples)));
                scores.iter().zip(&rates[l]).map(|(s, d)| s * d).sum::<f64>() / model.len() as f64
            };
            let difference = slope(1e-4, gradient);
            let exact = exact[2 * k + l];
            assert!((exact - difference).abs() < 1e-5 * exact.abs(), "{name}: {exact} against {difference}");
        }
    }
    assert!(told >= 6);
}
