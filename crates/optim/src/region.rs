//! Where a step may lead to: balls around the zero step, and bounds of single components.

use nalgebra::DVector;
use std::ops::Range;

/// A convex set of steps that holds the zero step: within a ball where a chart is safe, within bounds the user gave.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Region {
    /// The components that are kept to a ball, and its radius.
    pub balls: Vec<(Range<usize>, f64)>,
    /// The components that are kept to an interval, and its ends: at most 0 and at least 0.
    pub bounds: Vec<(usize, f64, f64)>,
}

/// The share of a ball's radius that steps use: charts are defined inside, not on the border.
pub(crate) const INSIDE: f64 = 0.99;

impl Region {
    /// This region, with these components in a ball.
    pub fn ball(mut self, components: Range<usize>, radius: f64) -> Self {
        self.balls.push((components, radius));
        self
    }

    /// This region, with a component in an interval around 0.
    pub fn bound(mut self, component: usize, least: f64, most: f64) -> Self {
        self.bounds.push((component, least.min(0.0), most.max(0.0)));
        self
    }

    /// This region and another, whose components come after `offset` others.
    pub fn and(self, offset: usize, other: Self) -> Self {
        self.and_by(other, |i| i + offset)
    }

    /// This region and another, with the place of each of its components here. Those of a ball stay side by side.
    pub fn and_by(mut self, other: Self, place: impl Fn(usize) -> usize) -> Self {
        self.balls
            .extend(other.balls.into_iter().map(|(part, r)| (place(part.start)..place(part.start) + part.len(), r)));
        self.bounds.extend(other.bounds.into_iter().map(|(i, least, most)| (place(i), least, most)));
        self
    }

    /// Whether a step is inside, but for rounding.
    pub fn contains(&self, step: &DVector<f64>) -> bool {
        self.longest(step) >= 1.0 - 1e-12
    }

    /// The largest factor by which a direction may be multiplied: infinite where nothing ends it.
    pub fn longest(&self, direction: &DVector<f64>) -> f64 {
        let bounds = self.bounds.iter().map(|&(i, least, most)| match direction[i] {
            x if x > 0.0 => most / x,
            x if x < 0.0 => least / x,
            _ => f64::INFINITY,
        });
        bounds.fold(self.longest_in_balls(direction), f64::min)
    }

    /// The same, whatever the bounds.
    pub(crate) fn longest_in_balls(&self, direction: &DVector<f64>) -> f64 {
        let balls = self.balls.iter().map(|(part, radius)| {
            let length = direction.rows(part.start, part.len()).norm();
            if length > 0.0 { INSIDE * radius / length } else { f64::INFINITY }
        });
        balls.fold(f64::INFINITY, f64::min)
    }

    /// The direction without the components that a bound forbids at once, but for rounding.
    pub fn tangent(&self, direction: &DVector<f64>) -> DVector<f64> {
        let mut direction = direction.clone();
        for &(i, least, most) in &self.bounds {
            let width = most - least;
            let little = if width.is_finite() { 1e-12 * width } else { 0.0 };
            if (direction[i] > 0.0 && most <= little) || (direction[i] < 0.0 && least >= -little) {
                direction[i] = 0.0;
            }
        }
        direction
    }

    /// A step brought inside: components to their nearest end, and all of it shortened to the balls.
    pub fn held(&self, mut step: DVector<f64>) -> DVector<f64> {
        for &(i, least, most) in &self.bounds {
            step[i] = step[i].clamp(least, most);
        }
        step *= self.longest_in_balls(&step).min(1.0);
        step
    }

    /// The lower and the upper corner of the bounds, without the balls. Infinite where nothing bounds.
    pub(crate) fn intervals(&self, dimension: usize) -> (DVector<f64>, DVector<f64>) {
        let mut low = DVector::from_element(dimension, f64::NEG_INFINITY);
        let mut high = DVector::from_element(dimension, f64::INFINITY);
        for &(i, least, most) in &self.bounds {
            low[i] = low[i].max(least);
            high[i] = high[i].min(most);
        }
        (low, high)
    }

    /// A box inside, for methods that know no other bounds: its lower and upper corner. Infinite where nothing bounds.
    pub fn boxed(&self, dimension: usize) -> (DVector<f64>, DVector<f64>) {
        let (mut low, mut high) = self.intervals(dimension);
        for (part, radius) in &self.balls {
            let half = INSIDE * radius / (part.len() as f64).sqrt();
            for i in part.clone() {
                low[i] = low[i].max(-half);
                high[i] = high[i].min(half);
            }
        }
        (low, high)
    }
}
