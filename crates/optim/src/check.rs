//! Checks an objective's gradient against differences along the manifold.

use crate::{Manifold, Objective};
use nalgebra::DVector;

/// How far the gradient at a point is from differences of values, relative to its largest component: with `step` in each
/// component, by the five-point formula. Infinite where a value is not defined.
///
/// About 1e-9 for a smooth objective of order one and a `step` of 1e-3; a wrong sign or factor shows as 1.
pub fn gradient_discrepancy<Point>(
    manifold: &dyn Manifold<Point>,
    objective: &mut dyn Objective<Point>,
    at: &Point,
    step: f64,
) -> f64 {
    if objective.value(at).is_none() {
        return f64::INFINITY;
    }
    let gradient = objective.derivatives(at).gradient;
    let mut value = |k: usize, amount: f64| {
        let mut tangent = DVector::zeros(gradient.len());
        tangent[k] = amount;
        objective.value(&manifold.retract(at, &tangent)?)
    };
    let mut slope = |k: usize| {
        let near = value(k, step)? - value(k, -step)?;
        let far = value(k, 2.0 * step)? - value(k, -2.0 * step)?;
        Some((8.0 * near - far) / (12.0 * step))
    };
    let slopes: Option<Vec<f64>> = (0..gradient.len()).map(&mut slope).collect();
    let Some(slopes) = slopes else { return f64::INFINITY };
    let scale = gradient.amax().max(slopes.iter().fold(0.0, |most, x| x.abs().max(most))).max(f64::MIN_POSITIVE);
    let worst = gradient.iter().zip(&slopes).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max);
    if gradient.iter().all(|x| x.is_finite()) { worst } else { f64::INFINITY }
}
