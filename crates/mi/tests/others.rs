//! Densities over other samples than pairs, and the agreement of directions.

mod common;

use common::slope;
use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_mi::{
    BinnedPhoto, ConditionalEntropy, Density, EdgeAgreement, Emma, EntropyMetric, Metric, MutualInformation,
    PartialVolume, Places, Points, Sharing, SoftParzen, SoftSamples,
};

fn photo() -> BinnedPhoto {
    let (width, height) = (40, 30);
    let at = |x: usize, y: usize| (4.0 + 2.0 * (0.3 * x as f64).sin() + 2.0 * (0.25 * y as f64).cos()) as u16;
    BinnedPhoto { width, height, bins: (0..width * height).map(|i| at(i % width, i / width)).collect() }
}

#[test]
fn partial_volume_shares_sum_to_one_and_slide() {
    let photo = photo();
    let mut random = StdRng::seed_from_u64(1);
    let places: Vec<[f64; 2]> =
        (0..2000).map(|_| [random.random_range(-2.0..42.0), random.random_range(-2.0..32.0)]).collect();
    let model: Vec<u16> = places.iter().map(|[x, _]| u16::from(*x > 20.0)).collect();
    let direction: Vec<[f64; 2]> = places.iter().map(|_| [random.random_range(-1.0..1.0), 0.4]).collect();
    for sharing in [Sharing::Linear, Sharing::Cubic] {
        let density = PartialVolume { model_bins: 2, photo_bins: 9, sharing };
        let samples = Places { model: &model, places: &places, photo: &photo };
        let joint = density.estimate(&samples);
        assert!((joint.mass() - 2000.0).abs() < 1e-9);
        let inside = |[x, y]: &&[f64; 2]| (-0.5..=39.5).contains(x) && (-0.5..=29.5).contains(y);
        let outside = 1.0 - places.iter().filter(inside).count() as f64 / 2000.0;
        assert!((joint.photo_marginal()[9] - outside).abs() < 1e-12);
        let scores = density.scores(&samples, &MutualInformation.derivative(&joint));
        let exact = scores.iter().zip(&direction).map(|(s, d)| s[0] * d[0] + s[1] * d[1]).sum::<f64>() / 2000.0;
        // Steps are so small that no sample crosses the photo's border or a pixel's centre, where the linear kernel has a kink.
        let difference = slope(1e-6, |h| {
            let moved: Vec<[f64; 2]> =
                places.iter().zip(&direction).map(|(p, d)| [p[0] + h * d[0], p[1] + h * d[1]]).collect();
            MutualInformation.value(&density.estimate(&Places { places: &moved, ..samples }))
        });
        assert!((exact - difference).abs() < 1e-6 * exact.abs(), "{sharing:?}: {exact} against {difference}");
    }
}

/// At whole pixels the linear shares are the hard histogram.
#[test]
fn partial_volume_at_whole_pixels_counts_pixels() {
    let photo = photo();
    let places: Vec<[f64; 2]> = (0..1200).map(|i| [f64::from(i % 40), f64::from(i / 40)]).collect();
    let density = PartialVolume { model_bins: 1, photo_bins: 9, sharing: Sharing::Linear };
    let joint = density.estimate(&Places { model: &vec![0; 1200], places: &places, photo: &photo });
    for (bin, p) in joint.cells().iter().enumerate() {
        let share = photo.bins.iter().filter(|&&b| usize::from(b) == bin).count() as f64 / 1200.0;
        assert!((p - share).abs() < 1e-12);
    }
}

#[test]
fn soft_attributes_move_the_density() {
    let mut random = StdRng::seed_from_u64(2);
    let mut draw = |low: f64, high: f64| -> Vec<f64> { (0..3000).map(|_| random.random_range(low..high)).collect() };
    let (x, y, noise, dx, dv) = (draw(0.0, 1.0), draw(0.1, 0.8), draw(0.0, 0.2), draw(-0.5, 0.5), draw(-0.4, 0.6));
    let class: Vec<u16> = (0..3000).map(|i| i % 3).collect();
    let value = |i: usize| if i.is_multiple_of(70) { f64::NAN } else { 0.3 * x[i] + 0.4 * y[i] + noise[i] };
    let density = SoftParzen { classes: 2, steps: 7, others: 1, photo_bins: 16 };
    let at = |h: f64, use_scores: &mut dyn FnMut(&SoftSamples<f64>)| {
        let attribute: Vec<[f64; 2]> =
            (0..3000).map(|i| [x[i] + h * dx[i] * (1.0 - x[i]) * x[i], y[i] + 0.5 * h]).collect();
        let photo: Vec<f64> = (0..3000).map(|i| value(i) + h * dv[i]).collect();
        use_scores(&SoftSamples { class: &class, attribute: &attribute, photo: &photo });
    };
    let mut exact = 0.0;
    at(0.0, &mut |samples| {
        let joint = density.estimate(samples);
        assert!((joint.mass() - 3000.0).abs() < 1e-9);
        assert!((joint.model_marginal()[98] - 1.0 / 3.0).abs() < 1e-12);
        let scores = density.scores(samples, &MutualInformation.derivative(&joint));
        let rate = |i: usize| [dx[i] * (1.0 - x[i]) * x[i], 0.5, dv[i]];
        let term = |(i, s): (usize, &[f64; 3])| s.iter().zip(rate(i)).map(|(s, r)| s * r).sum::<f64>();
        exact = scores.iter().enumerate().map(term).sum::<f64>() / 3000.0;
    });
    let difference = slope(1e-4, |h| {
        let mut result = 0.0;
        at(h, &mut |samples| result = MutualInformation.value(&density.estimate(samples)));
        result
    });
    assert!((exact - difference).abs() < 1e-6 * exact.abs(), "{exact} against {difference}");
}

/// Of normal variables the estimate is near −½ ln(1 − ρ²), and each derivative is that of the value.
#[test]
fn two_random_samples() {
    let mut random = StdRng::seed_from_u64(3);
    let mut normal = || -> f64 {
        let (u, v): (f64, f64) = (1.0 - random.random::<f64>(), random.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    };
    let correlation: f64 = 0.8;
    let mut draw = |count: usize| -> (Vec<[f64; 1]>, Vec<f64>) {
        (0..count)
            .map(|_| {
                let (u, e) = (normal(), normal());
                ([u], correlation * u + (1.0 - correlation * correlation).sqrt() * e)
            })
            .unzip()
    };
    let ((au, av), (bu, bv)) = (draw(600), draw(500));
    let emma = Emma { model_deviation: 0.2, photo_deviation: 0.2 };
    let expected = -0.5 * (1.0 - correlation * correlation).ln();
    let metrics: [&dyn EntropyMetric; 2] = [&MutualInformation, &ConditionalEntropy];
    for metric in metrics {
        let at = |av: &[f64], bv: &[f64]| {
            emma.evaluate(metric, Points { model: &au, photo: av }, Points { model: &bu, photo: bv })
        };
        let evaluation = at(&av, &bv);
        let rates: Vec<f64> = av.iter().map(|v| (3.0 * v).sin()).collect();
        let moved = |values: &[f64], h: f64| -> Vec<f64> { values.iter().map(|v| v + h * (3.0 * v).sin()).collect() };
        let terms = evaluation.windows.iter().zip(&rates).map(|(s, r)| s * r).sum::<f64>();
        let exact = terms + evaluation.points.iter().zip(&bv).map(|(s, v)| s * (3.0 * v).sin()).sum::<f64>();
        let difference = slope(1e-4, |h| at(&moved(&av, h), &moved(&bv, h)).value);
        assert!((exact - difference).abs() < 1e-6 * exact.abs(), "{exact} against {difference}");
    }
    let information =
        emma.evaluate(&MutualInformation, Points { model: &au, photo: &av }, Points { model: &bu, photo: &bv }).value;
    assert!((information - expected).abs() < 0.2 * expected, "{information} against {expected}");
}

#[test]
fn edges_agree_with_gradients_across_them() {
    let agreement = EdgeAgreement { noise: 1e-9 };
    let along = [[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]];
    let across = [[0.0, 3.0], [-1.0, 0.0], [2.0, -2.0]];
    assert!((agreement.evaluate(&along, &[1.0, 2.0, 3.0], &across).value - 1.0).abs() < 1e-9);
    assert!(agreement.evaluate(&along, &[1.0, 2.0, 3.0], &along).value < 1e-9);
    let weak = EdgeAgreement { noise: 3.0 };
    assert!((weak.evaluate(&along[..1], &[1.0], &across[..1]).value - 0.5).abs() < 1e-9);
    assert_eq!(weak.evaluate(&[[f64::NAN, 1.0]], &[1.0], &[[1.0, 0.0]]).value, 0.0);
    let mut random = StdRng::seed_from_u64(4);
    let mut draw = || -> Vec<[f64; 2]> {
        (0..50).map(|_| [random.random_range(-1.0..1.0), random.random_range(-1.0..1.0)]).collect()
    };
    let (m, g, dm, dg) = (draw(), draw(), draw(), draw());
    let weights: Vec<f32> = (0..50).map(|i| 0.5 + 0.1 * i as f32).collect();
    let agreement = EdgeAgreement { noise: 0.3 };
    let shifted = |x: &[[f64; 2]], d: &[[f64; 2]], h: f64| -> Vec<[f64; 2]> {
        x.iter().zip(d).map(|(x, d)| [x[0] + h * d[0], x[1] + h * d[1]]).collect()
    };
    let scores = agreement.evaluate(&m, &weights, &g).scores;
    let dot = |a: &[f64; 2], b: &[f64; 2]| a[0] * b[0] + a[1] * b[1];
    let exact =
        scores.iter().zip(dm.iter().zip(&dg)).map(|((sm, sg), (m, g))| dot(sm, m) + dot(sg, g)).sum::<f64>() / 50.0;
    let difference = slope(1e-4, |h| agreement.evaluate(&shifted(&m, &dm, h), &weights, &shifted(&g, &dg, h)).value);
    assert!((exact - difference).abs() < 1e-6 * exact.abs(), "{exact} against {difference}");
}
