//! The scalar coefficients of the exponential map and its Jacobians, as functions of the angle θ ≥ 0.
//!
//! Each closed form cancels near zero; below θ = 1 the Taylor series in θ² is summed instead, far enough for full
//! double precision there.

/// Σ cₖ xᵏ.
fn polynomial<const N: usize>(c: [f64; N], x: f64) -> f64 {
    c.iter().rev().fold(0.0, |sum, c| sum * x + c)
}

/// sin θ / θ.
pub(crate) fn sinc(theta: f64) -> f64 {
    if theta == 0.0 { 1.0 } else { theta.sin() / theta }
}

/// (1 − cos θ) / θ², by the half angle, which does not cancel.
pub(crate) fn versine(theta: f64) -> f64 {
    let s = sinc(0.5 * theta);
    0.5 * s * s
}

/// (θ − sin θ) / θ³.
pub(crate) fn third(theta: f64) -> f64 {
    if theta >= 1.0 {
        return (theta - theta.sin()) / theta.powi(3);
    }
    const C: [f64; 9] = alternating(3, [1.0; 9]);
    polynomial(C, theta * theta)
}

/// (θ²/2 − 1 + cos θ) / θ⁴.
pub(crate) fn fourth(theta: f64) -> f64 {
    if theta >= 1.0 {
        return (0.5 * theta * theta - 1.0 + theta.cos()) / theta.powi(4);
    }
    const C: [f64; 9] = alternating(4, [1.0; 9]);
    polynomial(C, theta * theta)
}

/// (2θ − 3 sin θ + θ cos θ) / (2θ⁵).
pub(crate) fn fifth(theta: f64) -> f64 {
    if theta >= 1.0 {
        return (2.0 * theta - 3.0 * theta.sin() + theta * theta.cos()) / (2.0 * theta.powi(5));
    }
    const C: [f64; 9] = alternating(5, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0]);
    polynomial(C, theta * theta)
}

/// (1 − θ/2 cot θ/2) / θ², the coefficient of [ω]×² in the inverse Jacobian; infinite at θ = 2π.
pub(crate) fn inverse(theta: f64) -> f64 {
    if theta >= 1.0 {
        let half = 0.5 * theta;
        return (1.0 - half * half.cos() / half.sin()) / (theta * theta);
    }
    // |B₂ₖ| / (2k)! with the Bernoulli numbers B.
    const C: [f64; 10] = [
        1.0 / 12.0,
        1.0 / 720.0,
        1.0 / 30_240.0,
        1.0 / 1_209_600.0,
        1.0 / 47_900_160.0,
        691.0 / 1_307_674_368_000.0,
        1.0 / 74_724_249_600.0,
        3_617.0 / 10_670_622_842_880_000.0,
        43_867.0 / 5_109_094_217_170_944_000.0,
        174_611.0 / 802_857_662_698_291_200_000.0,
    ];
    polynomial(C, theta * theta)
}

/// (−1)ᵏ wₖ / (2k + first)!.
const fn alternating<const N: usize>(first: usize, weights: [f64; N]) -> [f64; N] {
    let mut c = weights;
    let (mut k, mut n, mut factorial) = (0, 0, 1.0);
    while k < N {
        while n < 2 * k + first {
            n += 1;
            factorial *= n as f64;
        }
        c[k] /= if k % 2 == 0 { factorial } else { -factorial };
        k += 1;
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the power series summed with 60 digits.
    #[test]
    fn digits_are_kept() {
        #[rustfmt::skip]
        let table = [
            (1e-8, [0.5, 0.16666666666666666, 0.041666666666666664, 0.008333333333333333, 0.08333333333333333]),
            (1e-4, [0.49999999958333335, 0.16666666658333334, 0.041666666652777774, 0.008333333329365079, 0.08333333334722222]),
            (1e-2, [0.4999958333472222, 0.16666583333531745, 0.04166652777802579, 0.008333293650876322, 0.08333347222255291]),
            (0.5, [0.48966975243850913, 0.16459569116637598, 0.04132099024596346, 0.008234642121237716, 0.0836826353540599]),
            (0.999, [0.45977558483250813, 0.15854489735930935, 0.04030498483217136, 0.007945436550374139, 0.08475322555824442]),
            (1.001, [0.4596197360357459, 0.1585131186579003, 0.040299624415798076, 0.00794391419666993, 0.084759055929927]),
            (3.0, [0.2211102774000495, 0.10588444414593084, 0.030987746955550056, 0.005363503057652391, 0.09929197039400237]),
        ];
        for (theta, expected) in table {
            let found = [versine(theta), third(theta), fourth(theta), fifth(theta), inverse(theta)];
            for (name, (found, expected)) in
                ["versine", "third", "fourth", "fifth", "inverse"].iter().zip(found.into_iter().zip(expected))
            {
                // Just above the switch the closed form of `fifth` has lost two digits, of a term that matters θ³ as much.
                let tolerance = if theta > 1.0 { 2e-13 } else { 4e-16 };
                assert!(
                    (found - expected).abs() <= tolerance * expected,
                    "{name}({theta}) = {found:e}, not {expected:e}"
                );
            }
        }
    }
}
