//! Agreement of directions: where the model predicts an edge, the photo should have one along it.
//!
//! With `m_i` the direction along the predicted edge, of weight `w_i`, and `g_i` the photo's gradient,
//!
//! `G = Σ w_i a_i / Σ w_i`, `a_i = sin²(m_i, g_i) · |g_i|² / (|g_i|² + η²)`.
//!
//! An edge is across its gradient, so the sine between edge and gradient is the cosine between the gradients: this is the weight
//! `(cos 2α + 1) / 2` of J. Pluim, J. Maintz, M. Viergever, *Image registration by maximization of combined mutual information and
//! gradient information*, IEEE TMI 19(8), 2000. Their minimum of the magnitudes, which has a kink, is replaced by the factor of E. Haber
//! and J. Modersitzki, *Intensity gradient based registration and fusion of multi-modal images*, MICCAI 2006: gradients weaker
//! than `η` are noise.

use crate::Real;
use rayon::prelude::*;

/// The agreement of predicted edges with the photo's gradients, between 0 and 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeAgreement {
    /// The magnitude `η` below which a gradient of the photo is noise, in its unit.
    pub noise: f64,
}

/// The agreement and its derivatives.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement<T> {
    /// The value, between 0 and 1.
    pub value: f64,
    /// `N` times the derivatives by the components of the direction along the edge, and of the photo's gradient, for each of the
    /// `N` samples.
    pub scores: Vec<([T; 2], [T; 2])>,
}

impl EdgeAgreement {
    /// The agreement of edges along `edges`, of any length but zero, with the photo's gradients. A pair with a NaN, or an edge
    /// without length, agrees in nothing.
    ///
    /// # Panics
    /// If the slices differ in length.
    #[must_use]
    pub fn evaluate<T: Real>(&self, edges: &[[T; 2]], weights: &[f32], gradients: &[[T; 2]]) -> Agreement<T> {
        assert!(edges.len() == gradients.len() && edges.len() == weights.len(), "samples come in triples");
        let total: f64 = weights.iter().map(|&w| f64::from(w)).sum();
        if total <= 0.0 {
            return Agreement { value: 0.0, scores: vec![Default::default(); edges.len()] };
        }
        let share = edges.len() as f64 / total;
        let (values, scores): (Vec<f64>, Vec<_>) = (edges, gradients, weights)
            .into_par_iter()
            .with_min_len(4096)
            .map(|(&edge, &gradient, &weight)| {
                let (value, by_edge, by_gradient) = self.pair(edge.map(Into::into), gradient.map(Into::into));
                let scale = share * f64::from(weight);
                let scaled = |d: [f64; 2]| d.map(|x| T::of(scale * x));
                (f64::from(weight) * value, (scaled(by_edge), scaled(by_gradient)))
            })
            .unzip();
        Agreement { value: values.iter().sum::<f64>() / total, scores }
    }

    /// `(m × g)² / (|m|² (|g|² + η²))` and its derivatives by `m` and `g`.
    fn pair(&self, m: [f64; 2], g: [f64; 2]) -> (f64, [f64; 2], [f64; 2]) {
        let cross = m[0] * g[1] - m[1] * g[0];
        let length = m[0] * m[0] + m[1] * m[1];
        let energy = g[0] * g[0] + g[1] * g[1] + self.noise * self.noise;
        let value = cross * cross / (length * energy);
        if !value.is_finite() {
            return (0.0, [0.0; 2], [0.0; 2]);
        }
        let twice = 2.0 * cross / (length * energy);
        let by = |slope: f64, x: f64, square: f64| twice * slope - 2.0 * value * x / square;
        (value, [by(g[1], m[0], length), by(-g[0], m[1], length)], [by(-m[1], g[0], energy), by(m[0], g[1], energy)])
    }
}
