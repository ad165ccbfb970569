//! Values by rank: equal bins of ranks are bins of equal frequency.

use crate::Real;
use rayon::prelude::*;

/// Replaces each value by its rank among all, as a share of `0..=1`; equal values share the middle of their ranks, NaN stays.
///
/// # Panics
/// If there are 2³² values or more.
pub fn ranks<T: Real>(values: &mut [T]) {
    let count = u32::try_from(values.len()).expect("fewer than 2³² values");
    let mut order: Vec<u32> = (0..count).filter(|&i| !values[i as usize].is_missing()).collect();
    order.par_sort_unstable_by(|&a, &b| {
        values[a as usize].partial_cmp(&values[b as usize]).unwrap_or(std::cmp::Ordering::Equal).then(a.cmp(&b))
    });
    let scale = 1.0 / (order.len().max(2) - 1) as f64;
    let mut first = 0;
    while first < order.len() {
        let value = values[order[first] as usize];
        let ties = order[first..].iter().take_while(|&&i| values[i as usize] == value).count();
        let rank = T::of(scale * (first as f64 + 0.5 * (ties - 1) as f64));
        order[first..first + ties].iter().for_each(|&i| values[i as usize] = rank);
        first += ties;
    }
}
