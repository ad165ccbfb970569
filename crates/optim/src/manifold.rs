//! Spaces whose points are moved by steps in a tangent space: vector spaces, charts, and products of them.

use crate::Region;
use nalgebra::DVector;
use texreg_lie::Chart;

/// A space whose points are moved by steps in a tangent space.
pub trait Manifold<Point> {
    /// The number of components of a step.
    fn dimension(&self) -> usize;

    /// The point that a step from `at` leads to; the zero step leads to `at`. `None` where the step is not allowed:
    /// outside the region where the chart is safe, or beyond the parameters' bounds.
    fn retract(&self, at: &Point, step: &DVector<f64>) -> Option<Point>;

    /// Where steps from `at` may lead to: solvers keep to it. Everywhere, unless said otherwise.
    fn region(&self, _at: &Point) -> Region {
        Region::default()
    }
}

/// The vector space of a given dimension, stepped by addition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Euclidean(
    /// The dimension.
    pub usize,
);

impl Manifold<DVector<f64>> for Euclidean {
    fn dimension(&self) -> usize {
        self.0
    }

    fn retract(&self, at: &DVector<f64>, step: &DVector<f64>) -> Option<DVector<f64>> {
        Some(at + step)
    }
}

/// The points of a chart of `texreg-lie`, rotations or poses. Its steps are kept within the chart's radius.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Charted<C>(
    /// The chart.
    pub C,
);

impl<Point, C: Chart<Point>> Manifold<Point> for Charted<C> {
    fn dimension(&self) -> usize {
        self.0.dimension()
    }

    fn retract(&self, at: &Point, step: &DVector<f64>) -> Option<Point> {
        self.0.retract(at, step.as_slice())
    }

    /// The part that turns comes first; of a pose, the translation's three components follow it.
    fn region(&self, at: &Point) -> Region {
        let turn = if self.0.derivative(at).nrows() == 6 { self.dimension() - 3 } else { self.dimension() };
        Region::default().ball(0..turn, self.0.radius())
    }
}

/// The product of two spaces: a step has the components of the first, then those of the second.
impl<A, B, M: Manifold<A>, N: Manifold<B>> Manifold<(A, B)> for (M, N) {
    fn dimension(&self) -> usize {
        self.0.dimension() + self.1.dimension()
    }

    fn retract(&self, at: &(A, B), step: &DVector<f64>) -> Option<(A, B)> {
        let n = self.0.dimension();
        let first = self.0.retract(&at.0, &step.rows(0, n).into_owned())?;
        Some((first, self.1.retract(&at.1, &step.rows(n, step.len() - n).into_owned())?))
    }

    fn region(&self, at: &(A, B)) -> Region {
        self.0.region(&at.0).and(self.0.dimension(), self.1.region(&at.1))
    }
}

/// So many points of one space, one after the other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Power<M> {
    /// The space of each point.
    pub of: M,
    /// The number of points.
    pub count: usize,
}

impl<Point, M: Manifold<Point>> Manifold<Vec<Point>> for Power<M> {
    fn dimension(&self) -> usize {
        self.count * self.of.dimension()
    }

    fn retract(&self, at: &Vec<Point>, step: &DVector<f64>) -> Option<Vec<Point>> {
        let n = self.of.dimension();
        at.iter().enumerate().map(|(i, point)| self.of.retract(point, &step.rows(i * n, n).into_owned())).collect()
    }

    fn region(&self, at: &Vec<Point>) -> Region {
        let n = self.of.dimension();
        at.iter().enumerate().fold(Region::default(), |all, (i, point)| all.and(i * n, self.of.region(point)))
    }
}
