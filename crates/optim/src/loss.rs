//! Robust losses: what a residual block counts, so that a few wrong ones do not decide. Z. Zhang, *Parameter estimation
//! techniques: a tutorial with application to conic fitting*, Image and Vision Computing 15(1), 1997.

/// ρ(s) of a block's squared norm s, with a scale c in the residuals' units. Each has ρ(s) ≈ s for small s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Loss {
    /// `s`.
    #[default]
    Squared,
    /// `s` up to c², then `2 c √s − c²`: grows with the residual, not with its square.
    Huber(f64),
    /// `c² ln(1 + s/c²)`.
    Cauchy(f64),
    /// `c²/3 (1 − (1 − s/c²)³)` up to c², then constant: what is beyond has no influence.
    Tukey(f64),
    /// `s / (1 + s/c²)`: at most c².
    GemanMcClure(f64),
}

impl Loss {
    /// ρ(s) and its derivative ρ'(s), the weight of the block in reweighted least squares.
    #[inline]
    pub fn evaluate(self, s: f64) -> (f64, f64) {
        match self {
            Self::Squared => (s, 1.0),
            Self::Huber(c) => {
                let r = s.sqrt();
                if r <= c { (s, 1.0) } else { (2.0 * c * r - c * c, c / r) }
            }
            Self::Cauchy(c) => {
                let x = s / (c * c);
                (c * c * x.ln_1p(), 1.0 / (1.0 + x))
            }
            Self::Tukey(c) => {
                let x = (s / (c * c)).min(1.0);
                (c * c * x * (1.0 - x + x * x / 3.0), (1.0 - x) * (1.0 - x))
            }
            Self::GemanMcClure(c) => {
                let rest = 1.0 / (1.0 + s / (c * c));
                (s * rest, rest * rest)
            }
        }
    }
}
