//! What must hold of every density and metric.

mod common;

use common::{metrics, related};
use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_mi::{
    ConditionalEntropy, CorrelationRatio, Density, EntropyCorrelation, Histogram, Joint, Metric, MillerMadow,
    MutualInformation, NormalizedMutualInformation, Parzen, Samples, ranks,
};

const DENSITY: Parzen = Parzen { model_bins: 7, photo_bins: 20 };

fn entropy(density: &[f64]) -> f64 {
    -density.iter().filter(|&&p| p > 0.0).map(|p| p * p.ln()).sum::<f64>()
}

/// A table of random masses, a third of them empty.
fn random_joint(rows: usize, columns: usize, seed: u64) -> Joint {
    let mut random = StdRng::seed_from_u64(seed);
    let cell = |_| if random.random_range(0..3) == 0 { 0.0 } else { random.random_range(0.0..1.0) };
    Joint::from_masses(rows, (0..rows * columns).map(cell).collect())
}

#[test]
fn densities_keep_their_mass() {
    let (model, photo) = related(20_000, 1);
    let photo: Vec<f32> = photo.iter().map(|&v| v as f32).collect();
    let samples = Samples { model: &model, photo: &photo };
    let histogram = Histogram { model_bins: 7, photo_bins: 20 };
    for (joint, accuracy) in [(DENSITY.estimate(&samples), 1e-6), (histogram.estimate(&samples), 1e-12)] {
        assert_eq!((joint.model_bins(), joint.photo_bins()), (7, 21));
        assert!((joint.mass() - 20_000.0).abs() < accuracy * 20_000.0);
        assert!((joint.cells().iter().sum::<f64>() - 1.0).abs() < 1e-12);
        let outside = photo.iter().filter(|v| v.is_nan()).count() as f64 / photo.len() as f64;
        assert!((joint.photo_marginal()[20] - outside).abs() < accuracy);
        for (bin, p) in joint.model_marginal().into_iter().enumerate() {
            let share = model.iter().filter(|&&u| usize::from(u) == bin).count() as f64 / model.len() as f64;
            assert!((p - share).abs() < accuracy);
        }
    }
}

#[test]
fn nothing_is_learned_from_an_independent_model() {
    let model_marginal = [0.2, 0.3, 0.5];
    let photo_marginal = [0.1, 0.0, 0.6, 0.3];
    let product = model_marginal.iter().flat_map(|u| photo_marginal.iter().map(move |v| u * v)).collect();
    let joint = Joint::from_masses(3, product);
    assert!(MutualInformation.value(&joint).abs() < 1e-12);
    assert!((NormalizedMutualInformation.value(&joint) - 1.0).abs() < 1e-12);
    assert!(EntropyCorrelation.value(&joint).abs() < 1e-12);
    assert!(CorrelationRatio.value(&joint).abs() < 1e-12);
    assert!((ConditionalEntropy.value(&joint) + entropy(&photo_marginal)).abs() < 1e-12);
    for (name, metric) in metrics(3, 4) {
        let independent = random_joint(3, 4, 5).independent();
        let (a, b) = (metric.value(&independent), metric.value(&independent.independent()));
        assert!((a - b).abs() < 1e-12, "{name}: {a} is not {b}");
    }
}

#[test]
fn a_faithful_model_tells_everything() {
    let joint = Joint::from_masses(3, vec![2.0, 0.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 0.0, 5.0, 0.0]);
    let entropy = entropy(&[0.2, 0.3, 0.5]);
    assert!((MutualInformation.value(&joint) - entropy).abs() < 1e-12);
    assert!((NormalizedMutualInformation.value(&joint) - 2.0).abs() < 1e-12);
    assert!((EntropyCorrelation.value(&joint) - 1.0).abs() < 1e-12);
    assert!(ConditionalEntropy.value(&joint).abs() < 1e-12);
    assert!((CorrelationRatio.value(&joint) - 1.0).abs() < 1e-12);
}

/// T. Cover and J. Thomas, *Elements of Information Theory*, example 2.2.1 and its continuation: H(X) = 7/4 bits, H(Y) = 2 bits,
/// H(X | Y) = 11/8, H(Y | X) = 13/8, H(X, Y) = 27/8, I(X; Y) = 3/8.
#[test]
fn the_textbook_example() {
    // Rows are Y, columns X, in units of 1/32.
    let cells = [4, 2, 1, 1, 2, 4, 1, 1, 2, 2, 2, 2, 8, 0, 0, 0].map(f64::from);
    let joint = Joint::from_masses(4, cells.to_vec());
    let bit = std::f64::consts::LN_2;
    assert!((MutualInformation.value(&joint) - 0.375 * bit).abs() < 1e-12);
    assert!((ConditionalEntropy.value(&joint) + 1.375 * bit).abs() < 1e-12);
    assert!((NormalizedMutualInformation.value(&joint) - (2.0 + 1.75) / 3.375).abs() < 1e-12);
    assert!((EntropyCorrelation.value(&joint) - 2.0 * 0.375 / 3.75).abs() < 1e-12);
}

#[test]
fn ranges_and_relations() {
    for seed in 0..50 {
        let joint = random_joint(5, 6, seed);
        let (model, photo) = (entropy(&joint.model_marginal()), entropy(&joint.photo_marginal()));
        let information = MutualInformation.value(&joint);
        assert!(information >= 0.0 && information <= model.min(photo) + 1e-12);
        let normalized = NormalizedMutualInformation.value(&joint);
        assert!((1.0..=2.0).contains(&normalized));
        assert!((normalized - 1.0 - information / entropy(joint.cells())).abs() < 1e-12);
        assert!((0.0..=1.0).contains(&EntropyCorrelation.value(&joint)));
        assert!((0.0..=1.0).contains(&CorrelationRatio.value(&joint)));
        assert!((ConditionalEntropy.value(&joint) - (information - photo)).abs() < 1e-12);
    }
}

#[test]
fn bins_have_no_order_for_entropies() {
    let joint = random_joint(4, 5, 9);
    let relabelled: Vec<f64> =
        [2, 0, 3, 1].into_iter().flat_map(|u| [4, 2, 0, 1, 3].map(|v| joint.cells()[u * 5 + v])).collect();
    let relabelled = Joint::from_masses(4, relabelled);
    let pairs: [&dyn Metric; 4] =
        [&MutualInformation, &NormalizedMutualInformation, &EntropyCorrelation, &ConditionalEntropy];
    for metric in pairs {
        assert!((metric.value(&joint) - metric.value(&relabelled)).abs() < 1e-12);
    }
}

/// Of independent pairs the estimate without the correction is too large by about (rows − 1)(columns − 1) / 2N.
#[test]
fn the_bias_of_few_samples_is_taken_off() {
    let mut random = StdRng::seed_from_u64(11);
    let density = Histogram { model_bins: 8, photo_bins: 16 };
    let (mut plain, mut corrected) = (0.0, 0.0);
    for _ in 0..200 {
        let model: Vec<u16> = (0..1000).map(|_| random.random_range(0..8)).collect();
        let photo: Vec<f64> = (0..1000).map(|_| random.random_range(0.0..1.0)).collect();
        let joint = density.estimate(&Samples { model: &model, photo: &photo });
        plain += MutualInformation.value(&joint) / 200.0;
        corrected += MillerMadow(MutualInformation).value(&joint) / 200.0;
    }
    let bias = 7.0 * 15.0 / 2000.0;
    assert!((plain - bias).abs() < 0.1 * bias, "{plain} against {bias}");
    assert!(corrected.abs() < 0.1 * bias, "{corrected}");
}

#[test]
fn ranks_are_evenly_spread() {
    let mut values = [5.0, f64::NAN, -1.0, 5.0, 100.0, 0.0];
    ranks(&mut values);
    assert!(values[1].is_nan());
    let expected = [0.625, 0.0, 0.625, 1.0, 0.25];
    assert_eq!([values[0], values[2], values[3], values[4], values[5]], expected);
}

#[test]
fn threads_change_nothing() {
    let (model, photo) = related(100_000, 4);
    let photo: Vec<f32> = photo.iter().map(|&v| v as f32).collect();
    let samples = Samples { model: &model, photo: &photo };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let joint = DENSITY.estimate(&samples);
            let scores = DENSITY.scores(&samples, &MutualInformation.derivative(&joint));
            (joint, scores)
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn no_samples_make_an_empty_density() {
    let joint = DENSITY.estimate(&Samples::<f32> { model: &[], photo: &[] });
    for (name, metric) in metrics(7, 21) {
        assert!(metric.value(&joint).is_finite(), "{name}");
        assert!(metric.derivative(&joint).iter().all(|d| d.is_finite()), "{name}");
        assert!(metric.unit(&joint).is_finite(), "{name}");
    }
}
