//! Uniform B-splines as windows: weights over the neighbours of a place, and their derivatives (I. Schoenberg, 1946).

use crate::Real;

/// The cubic B-spline at the four neighbours of a place that lies `t` (0..=1) after the second, and its derivative by `t`.
#[inline(always)]
pub fn cubic<T: Real>(t: T) -> ([T; 4], [T; 4]) {
    let c = T::of;
    let s = c(1.0) - t;
    let near = |t: T| c(2.0 / 3.0) - t * t * (c(1.0) - c(0.5) * t);
    let slope = |t: T| t * (c(1.5) * t - c(2.0));
    let (sixth, half) = (c(1.0 / 6.0), c(0.5));
    let zero = T::default();
    (
        [sixth * s * s * s, near(t), near(s), sixth * t * t * t],
        [zero - half * s * s, slope(t), zero - slope(s), half * t * t],
    )
}

/// The quadratic B-spline at the three neighbours of a place that lies `t` (−½..=½) after the middle one, and its derivative.
#[inline]
pub(crate) fn quadratic<T: Real>(t: T) -> ([T; 3], [T; 3]) {
    let half = T::of(0.5);
    let (before, after) = (half - t, half + t);
    let weights = [half * before * before, T::of(0.75) - t * t, half * after * after];
    (weights, [T::default() - before, T::of(-2.0) * t, after])
}
