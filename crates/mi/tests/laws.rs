//! What must hold of every density and metric.

use rand::{Rng, SeedableRng, rngs::StdRng};
use texreg_mi::{
    ConditionalEntropy, Density, EntropyCorrelation, Joint, Metric, MutualInformation, NormalizedMutualInformation,
    Parzen, Samples,
};

const DENSITY: Parzen = Parzen { model_bins: 7, photo_bins: 20 };

fn metrics() -> [(&'static str, &'static dyn Metric); 4] {
    [
        ("mutual information", &MutualInformation),
        ("normalized mutual information", &NormalizedMutualInformation),
        ("entropy correlation", &EntropyCorrelation),
        ("conditional entropy", &ConditionalEntropy),
    ]
}

/// Photo values that depend on the model's bin, with noise; every fiftieth outside the photo.
fn related(count: usize, seed: u64) -> (Vec<u16>, Vec<f32>) {
    let mut random = StdRng::seed_from_u64(seed);
    let model: Vec<u16> = (0..count).map(|_| random.random_range(0..7)).collect();
    let photo = model
        .iter()
        .enumerate()
        .map(|(i, &u)| {
            let value = 0.1 + 0.1 * f32::from(u) + random.random_range(0.0..0.2);
            if i % 50 == 0 { f32::NAN } else { value }
        })
        .collect();
    (model, photo)
}

#[test]
fn the_density_keeps_its_mass() {
    let (model, photo) = related(20_000, 1);
    let joint = DENSITY.estimate(&Samples { model: &model, photo: &photo });
    assert_eq!((joint.model_bins(), joint.photo_bins()), (7, 21));
    assert!((joint.cells().iter().sum::<f64>() - 1.0).abs() < 1e-12);
    let outside = photo.iter().filter(|v| v.is_nan()).count() as f64 / photo.len() as f64;
    assert!((joint.photo_marginal()[20] - outside).abs() < 1e-12);
    for (bin, p) in joint.model_marginal().into_iter().enumerate() {
        let share = model.iter().filter(|&&u| usize::from(u) == bin).count() as f64 / model.len() as f64;
        assert!((p - share).abs() < 1e-12);
    }
}

#[test]
fn nothing_is_learned_from_an_independent_model() {
    let model_marginal = [0.2, 0.3, 0.5];
    let photo_marginal = [0.1, 0.0, 0.6, 0.3];
    let product = model_marginal.iter().flat_map(|u| photo_marginal.iter().map(move |v| u * v)).collect();
    let joint = Joint::from_masses(3, product);
    let photo_entropy = -photo_marginal.iter().filter(|&&p| p > 0.0).map(|p: &f64| p * p.ln()).sum::<f64>();
    assert!(MutualInformation.value(&joint).abs() < 1e-12);
    assert!((NormalizedMutualInformation.value(&joint) - 1.0).abs() < 1e-12);
    assert!(EntropyCorrelation.value(&joint).abs() < 1e-12);
    assert!((ConditionalEntropy.value(&joint) + photo_entropy).abs() < 1e-12);
}

#[test]
fn a_faithful_model_tells_everything() {
    let joint = Joint::from_masses(3, vec![2.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 5.0]);
    let entropy = -[0.2f64, 0.3, 0.5].iter().map(|p| p * p.ln()).sum::<f64>();
    assert!((MutualInformation.value(&joint) - entropy).abs() < 1e-12);
    assert!((NormalizedMutualInformation.value(&joint) - 2.0).abs() < 1e-12);
    assert!((EntropyCorrelation.value(&joint) - 1.0).abs() < 1e-12);
    assert!(ConditionalEntropy.value(&joint).abs() < 1e-12);
}

/// Draws every sample towards grey, some more than others, and compares the slope of the value with the scores.
#[test]
fn scores_agree_with_differences() {
    let (model, photo) = related(5_000, 2);
    let mut random = StdRng::seed_from_u64(3);
    let direction: Vec<f32> = photo.iter().map(|v| (0.5 - v) * random.random_range(0.0..2.0)).collect();
    let moved = |step: f32| -> Vec<f32> { photo.iter().zip(&direction).map(|(v, d)| v + step * d).collect() };
    for (name, metric) in metrics() {
        let value = |photo: &[f32]| metric.value(&DENSITY.estimate(&Samples { model: &model, photo }));
        let samples = Samples { model: &model, photo: &photo };
        let scores = DENSITY.scores(&samples, &metric.derivative(&DENSITY.estimate(&samples)));
        let terms: Vec<f64> =
            scores.iter().zip(&direction).map(|(s, d)| f64::from(s * d)).filter(|t| !t.is_nan()).collect();
        let slope = terms.iter().sum::<f64>() / model.len() as f64;
        let scale = terms.iter().map(|t| t.abs()).sum::<f64>() / model.len() as f64;
        // Richardson's extrapolation of central differences: steps of f32 values cannot be small.
        let central = |h: f32| (value(&moved(h)) - value(&moved(-h))) / (2.0 * f64::from(h));
        let difference = (4.0 * central(1e-3) - central(2e-3)) / 3.0;
        assert!((slope - difference).abs() < 1e-5 * scale, "{name}: {slope} against {difference}");
    }
}

#[test]
fn threads_change_nothing() {
    let (model, photo) = related(100_000, 4);
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
    let joint = DENSITY.estimate(&Samples { model: &[], photo: &[] });
    for (_, metric) in metrics() {
        assert!(metric.value(&joint).is_finite());
        assert!(metric.derivative(&joint).iter().all(|d| d.is_finite()));
    }
}
