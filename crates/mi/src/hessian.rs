//! The exact second derivatives of a metric.

use crate::{Metric, TwiceDifferentiable};

/// The Hessian of `metric` along `K` motions of the samples: in motion `k`, sample `i` changes its photo value at the rate
/// `rates[k][i]`. `K × K` numbers, row by row; `None` if the metric does not tell its second derivatives.
///
/// With `dp_k` the changes of the density, `D` the metric's derivative by cell and `β''` the windows' second derivative,
///
/// `∂²M/∂ξ_k∂ξ_l = Σ Σ ∂²M/∂p∂p' dp_k dp'_l + 1/N Σ_i (Σ_v D(u_i, v) β''(b_i − v)) g_ik g_il`,
///
/// which for mutual information is `Σ_v dp_v dp_vᵀ / p_v` and `−Σ dp dpᵀ / p` in the first place (the term by `p(u)` is zero as
/// long as bins are fixed). Where photo values bend along the motions, `1/N Σ_i s_i ∂²v_i/∂ξ_k∂ξ_l` with the scores `s_i` is to
/// be added by whoever knows them.
pub fn hessian<S, D>(density: &D, metric: &dyn Metric, samples: &S, rates: &[Vec<f64>]) -> Option<Vec<f64>>
where
    D: TwiceDifferentiable<S, Score: Copy + Into<f64>>,
{
    let joint = density.estimate(samples);
    let changes: Vec<Vec<f64>> = rates.iter().map(|rates| density.along(samples, rates)).collect();
    let mut hessian = metric.bend(&joint, &changes)?;
    let second = density.second_scores(samples, &metric.derivative(&joint));
    let share = 1.0 / second.len().max(1) as f64;
    for (row, first) in hessian.chunks_exact_mut(rates.len()).zip(rates) {
        for (cell, other) in row.iter_mut().zip(rates) {
            let products = second.iter().zip(first).zip(other).map(|((&s, x), y)| s.into() * x * y);
            *cell += share * products.sum::<f64>();
        }
    }
    Some(hessian)
}
