//! Checks derivatives against differences: the gradient checker for every analytic Jacobian of the workspace.

use nalgebra::DMatrix;

/// ∂f/∂x by the five-point central difference, `(8 (f₊₁ − f₋₁) − (f₊₂ − f₋₂)) / 12h` along each coordinate.
///
/// For a smooth f of order one, `step` = 1e-3 gives about twelve digits: the truncation falls with h⁴, the rounding rises with 1/h.
/// `f` maps a slice as long as `x` to a vector of constant length.
pub fn differences(f: impl Fn(&[f64]) -> Vec<f64>, x: &[f64], step: f64) -> DMatrix<f64> {
    let mut at = x.to_vec();
    let columns: Vec<Vec<f64>> = (0..x.len())
        .map(|i| {
            let mut sample = |k: f64| {
                at[i] = x[i] + k * step;
                let value = f(&at);
                at[i] = x[i];
                value
            };
            let (far_left, left, right, far_right) = (sample(-2.0), sample(-1.0), sample(1.0), sample(2.0));
            (0..left.len())
                .map(|j| (8.0 * (right[j] - left[j]) - (far_right[j] - far_left[j])) / (12.0 * step))
                .collect()
        })
        .collect();
    DMatrix::from_fn(columns.first().map_or(0, Vec::len), x.len(), |row, column| columns[column][row])
}

/// The largest difference between the entries of two matrices, relative to the largest entry or 1. Infinite when shapes
/// differ or an entry is not a number.
pub fn discrepancy<'a>(
    analytic: impl Into<nalgebra::DMatrixView<'a, f64>>,
    numeric: impl Into<nalgebra::DMatrixView<'a, f64>>,
) -> f64 {
    let (a, b) = (analytic.into(), numeric.into());
    if a.shape() != b.shape() || a.iter().chain(b.iter()).any(|x| x.is_nan()) {
        return f64::INFINITY;
    }
    let scale = b.amax().max(1.0);
    a.iter().zip(b.iter()).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max)
}
