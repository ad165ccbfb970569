//! How well a view explains a photo, as a function of the view: fixed surface samples, moved by the camera through one level
//! of the photo.
//!
//! With the metric `M` over the density of pairs (bin `u_i`, photo value `v_i`), `∂M/∂ξ = 1/N Σ s_i g_i` for the scores
//! `s_i = N ∂M/∂v_i` and `g_i = ∂v_i/∂ξ`, the photo's gradient times the projection's Jacobian. The curvature is the empirical
//! Fisher matrix `1/N Σ s_i² g_i g_iᵀ`, by the metric's unit. The agreement of edges and that of silhouettes have files of their
//! own; what is climbed is one of the three, a product or a sum.

use crate::needles::Edges;
use crate::options::{Composition, Terms};
use crate::parameters::{Dense, MOST, POSE, ViewSpace};
use crate::pyramid::Level;
use crate::samples::SurfaceSamples;
use crate::sweep::{look, rows, weigh};
use crate::{FocalSource, Refine};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_mi::{Density, Measurement, Metric, Parzen, Real, Samples};
use texreg_optim::{Curvature, Derivatives, Manifold, Objective};

/// What is known of the camera before the photo was looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// The expected camera.
    pub(crate) camera: Camera,
    /// How well its focal length is known.
    pub(crate) focal_from: FocalSource,
    /// What the prior counts for, against one photo: the reciprocal of the number of independent samples in it.
    pub(crate) weight: f64,
}

impl Prior {
    /// Minus half the squared distance from the expected camera in standard deviations, weighted.
    pub(crate) fn log(&self, refine: Refine, camera: &Camera) -> f64 {
        let offset = refine.offset(&self.camera, camera);
        let deviations = refine.deviations(&self.camera, self.focal_from);
        -0.5 * self.weight * offset.iter().zip(deviations).map(|(x, d)| (x / d).powi(2)).sum::<f64>()
    }

    /// The derivatives of [`log`](Self::log) by the camera's components.
    pub(crate) fn derivatives(&self, refine: Refine, camera: &Camera) -> Dense {
        let offset = DVector::from_vec(refine.offset(&self.camera, camera));
        let deviations = DVector::from_vec(refine.deviations(&self.camera, self.focal_from));
        let precision = deviations.map(|d| self.weight / (d * d));
        Dense { gradient: -precision.component_mul(&offset), curvature: DMatrix::from_diagonal(&precision) }
    }
}

/// The metric over the views of one photo, with photo values of type `T`.
pub(crate) struct PhotoObjective<'a, T = f32> {
    pub(crate) samples: &'a SurfaceSamples,
    pub(crate) level: &'a Level,
    pub(crate) density: &'a Parzen,
    pub(crate) terms: Terms,
    pub(crate) space: &'a ViewSpace<'a>,
    pub(crate) prior: Prior,
    seen: Option<Seen<T>>,
    /// How often the metric was evaluated.
    pub(crate) evaluations: usize,
}

/// What the samples show from the view that was evaluated last.
struct Seen<T> {
    view: View,
    /// The values of the terms.
    values: [Option<f64>; 3],
    shown: Shown<T>,
}

/// What the metric over the joint density read and made of it.
#[derive(Default)]
struct Shown<T> {
    values: Vec<T>,
    slopes: Vec<[T; 2]>,
    /// The metric's derivatives by cell of the joint density.
    table: Vec<f64>,
    /// The metric's change with the mean log-likelihood.
    unit: f64,
    /// What the needles met with.
    edges: Option<Edges<T>>,
}

/// The least share of edges that is taken for misaligned.
const LEAST: f64 = 1e-3;

/// An edge counts as much as so many samples, on the finest two levels and on coarser ones: the errors of samples go together with
/// their neighbours', as shading changes slowly. Coarse edges are fewer and less sure.
const EDGE: [f64; 2] = [5.0, 2.0];

impl<'a, T: Real> PhotoObjective<'a, T> {
    pub(crate) fn new(
        samples: &'a SurfaceSamples,
        level: &'a Level,
        density: &'a Parzen,
        space: &'a ViewSpace<'a>,
        prior: Prior,
    ) -> Self {
        let terms = samples.metric.terms(samples, density);
        Self { samples, level, density, terms, space, prior, seen: None, evaluations: 0 }
    }

    /// The metric over the joint density of what the samples show.
    fn over_density(&self, metric: &dyn Metric, at: &View) -> (f64, Shown<T>) {
        let (values, slopes) = look(&self.samples.points, self.level, at);
        let joint = self.density.estimate(&Samples { model: &self.samples.bins, photo: &values });
        let Measurement { value, derivative: table, unit } = metric.measure(&joint);
        (value, Shown { values, slopes, table, unit, edges: None })
    }

    /// What the metric would be at a view if the model told nothing of the photo: over the product of the marginals of each joint
    /// density; and over the same samples, each with the photo's value of another, so that what many cells explain of few samples by
    /// chance is in it. The agreement of edges counts from zero.
    pub(crate) fn independent(&self, at: &View) -> Option<[f64; 2]> {
        let camera = self.level.camera(&at.camera);
        let density = self.terms.density.as_ref().map(|metric| {
            let looked;
            let values = match self.seen_from(at) {
                Some(seen) => &seen.shown.values,
                None => {
                    looked = look::<T>(&self.samples.points, self.level, at).0;
                    &looked
                }
            };
            let mixed: Vec<T> = mixed(values.len()).map(|i| values[i]).collect();
            let joint = self.density.estimate(&Samples { model: &self.samples.bins, photo: &mixed });
            [metric.value(&joint.independent()), metric.value(&joint)]
        });
        let silhouettes = match self.samples.contour.as_ref().zip(self.level.silhouette.as_ref()) {
            Some((contour, silhouette)) => Some(contour.independent(silhouette, &camera, at)?),
            None => None,
        };
        let edges = self.samples.needles.as_ref().map(|_| 0.0);
        Some([0, 1].map(|k| self.compose(&[density.map(|values| values[k]), edges, silhouettes]).0))
    }

    /// Its derivatives by the tangent.
    fn density_derivatives(&self, at: &View, shown: &Shown<T>) -> Dense {
        let scores = self.density.scores(&Samples { model: &self.samples.bins, photo: &shown.values }, &shown.table);
        let total = weigh(&self.samples.points, &shown.slopes, &scores, self.level, at, self.space.refine);
        let scale = 1.0 / self.samples.points.len().max(1) as f64;
        let mut derivatives = total.derivatives(self.space.refine.dimension(), scale);
        derivatives.curvature /= shown.unit;
        derivatives
    }

    /// The derivatives of the terms.
    fn term_derivatives(&self, at: &View, shown: &Shown<T>) -> [Option<Dense>; 3] {
        let (camera, refine, scale) = (self.level.camera(&at.camera), self.space.refine, self.level.scale);
        let silhouettes = self.samples.contour.as_ref().zip(self.level.silhouette.as_ref());
        [
            self.terms.density.as_ref().map(|_| self.density_derivatives(at, shown)),
            self.samples
                .needles
                .as_ref()
                .zip(shown.edges.as_ref())
                .map(|(needles, edges)| needles.derivatives(edges, self.level, at, refine)),
            silhouettes.map(|(contour, silhouette)| contour.derivatives(silhouette, &camera, at, refine, scale)),
        ]
    }

    /// The terms' values together, and how the whole changes with each.
    fn compose(&self, values: &[Option<f64>; 3]) -> (f64, [f64; 3]) {
        let one = |value: &Option<f64>| value.unwrap_or(1.0);
        let [a, b, c] = [0, 1, 2].map(|k| one(&values[k]));
        match self.terms.composition {
            Composition::Product => (a * b * c, [b * c, a * c, a * b]),
            Composition::Nats => {
                let rest = (1.0 - b).max(LEAST);
                let edge = EDGE[usize::from(self.level.scale < 0.5)];
                (a - edge * rest.ln(), [1.0, edge / rest, 0.0])
            }
            Composition::Sum => (values.iter().flatten().sum(), [1.0; 3]),
        }
    }

    /// The derivatives at a view, by a step of the chart and by the camera's components.
    pub(crate) fn dense(&mut self, at: &View) -> Dense {
        self.ensure(at);
        let terms = self.seen_from(at).map(|seen| (seen.values, self.term_derivatives(at, &seen.shown)));
        let (values, terms) = terms.unwrap_or_default();
        self.together(at, &values, &terms)
    }

    /// The gradients at a view without each of some groups of samples: the photo is looked at once.
    pub(crate) fn gradients_without(&mut self, at: &View, groups: &[Vec<usize>]) -> Vec<DVector<f64>> {
        self.ensure(at);
        let Some(seen) = self.seen_from(at) else {
            return vec![DVector::zeros(self.space.dimension()); groups.len()];
        };
        let (points, shown, refine) = (&self.samples.points, &seen.shown, self.space.refine);
        let rows = rows(points, &shown.slopes, self.level, at, refine);
        let all = self.term_derivatives(at, shown);
        let without = |group: &Vec<usize>| {
            let mut is_kept = vec![true; points.len()];
            group.iter().for_each(|&i| is_kept[i] = false);
            let kept: Vec<usize> = (0..points.len()).filter(|&i| is_kept[i]).collect();
            let of = |i: &usize| self.samples.shading.get(*i).copied();
            let samples = SurfaceSamples {
                bins: kept.iter().map(|&i| self.samples.bins[i]).collect(),
                shading: kept.iter().map_while(of).collect(),
                metric: self.samples.metric,
                ..SurfaceSamples::default()
            };
            let (mut values, mut terms) = (seen.values, all.clone());
            if let Some(metric) = self.samples.metric.terms(&samples, self.density).density {
                let photo: Vec<T> = kept.iter().map(|&i| shown.values[i]).collect();
                let pairs = Samples { model: &samples.bins, photo: &photo };
                let joint = self.density.estimate(&pairs);
                let scores = self.density.scores(&pairs, &metric.derivative(&joint));
                let mut sum = [0.0; MOST];
                for (&i, &score) in kept.iter().zip(&scores) {
                    let score: f64 = score.into();
                    sum.iter_mut().zip(&rows[i]).for_each(|(sum, x)| *sum += score * x);
                }
                values[0] = Some(metric.value(&joint));
                let share = 1.0 / kept.len().max(1) as f64;
                if let Some(term) = &mut terms[0] {
                    term.gradient = DVector::from_fn(refine.dimension(), |k, _| share * sum[k]);
                }
            }
            self.together(at, &values, &terms).gradient
        };
        groups.par_iter().map(without).collect()
    }

    /// Evaluates a view, unless it was the last.
    fn ensure(&mut self, at: &View) {
        if self.seen_from(at).is_none() {
            self.value(at);
        }
    }

    /// What a view shows, if it was evaluated last.
    fn seen_from(&self, at: &View) -> Option<&Seen<T>> {
        self.seen.as_ref().filter(|seen| seen.view == *at)
    }

    /// The derivatives of the whole from the terms' values and derivatives.
    fn together(&self, at: &View, values: &[Option<f64>; 3], terms: &[Option<Dense>; 3]) -> Dense {
        let dimension = self.space.refine.dimension();
        let mut tangent =
            Dense { gradient: DVector::zeros(dimension), curvature: DMatrix::zeros(dimension, dimension) };
        let (_, weights) = self.compose(values);
        for (term, weight) in terms.iter().zip(weights) {
            if let Some(Dense { gradient, curvature }) = term {
                tangent.gradient += weight * gradient;
                tangent.curvature += weight.abs() * curvature;
            }
        }
        let prior = self.prior.derivatives(self.space.refine, &at.camera);
        let camera = prior.gradient.len();
        let mut own = tangent.gradient.rows_mut(POSE, camera);
        own += prior.gradient;
        let mut own = tangent.curvature.view_mut((POSE, POSE), (camera, camera));
        own += prior.curvature;
        self.space.pull_back(at, &tangent)
    }
}

impl<T: Real> Objective<View> for PhotoObjective<'_, T> {
    fn value(&mut self, at: &View) -> Option<f64> {
        self.evaluations += 1;
        let camera = self.level.camera(&at.camera);
        let (value, shown) = self.terms.density.as_ref().map(|metric| self.over_density(&**metric, at)).unzip();
        let edges = self.samples.needles.as_ref().map(|needles| needles.look::<T>(self.level, at));
        let silhouettes = match self.samples.contour.as_ref().zip(self.level.silhouette.as_ref()) {
            Some((contour, silhouette)) => Some(contour.value(silhouette, &camera, at)?),
            None => None,
        };
        let values = [value, edges.as_ref().map(|edges| edges.agreement.value), silhouettes];
        let (value, _) = self.compose(&values);
        self.seen = Some(Seen { view: *at, values, shown: Shown { edges, ..shown.unwrap_or_default() } });
        Some(value + self.prior.log(self.space.refine, &at.camera)).filter(|value| value.is_finite())
    }

    fn derivatives(&mut self, at: &View) -> Derivatives {
        let Dense { gradient, curvature } = self.dense(at);
        Derivatives { gradient, curvature: Curvature::Dense(curvature) }
    }
}

/// The indices below `count` in an order without pattern: by steps of the golden section, or of the next number without a common
/// divisor.
fn mixed(count: usize) -> impl Iterator<Item = usize> {
    let divisor = |mut a: usize, mut b: usize| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let golden = (0.618_033_988_75 * count as f64) as usize;
    let step = (golden..).find(|&step| divisor(step, count) <= 1).unwrap_or(1);
    (0..count).map(move |i| (count / 2 + i * step) % count)
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::bounds::Limits;
    use crate::contour::{Contour, Silhouette};
    use crate::needles::Needles;
    use crate::{MetricName, RotationName};
    use nalgebra::{Point3, Rotation3, Vector3};
    use texreg_camera::{Distortion, Intrinsics};
    use texreg_lie::Pose;
    use texreg_raster::{GBuffer, Options, Renderer};
    use texreg_surface::{Attributes, Mesh};

    /// A bumpy sheet inside a smooth picture, and bins that have to do with what is seen.
    pub(crate) fn scene() -> (View, Level, SurfaceSamples) {
        let (width, height) = (160, 120);
        let camera = Camera {
            width,
            height,
            intrinsics: Intrinsics { fx: 150.0, fy: 152.0, cx: 81.0, cy: 58.5, skew: 0.3 },
            distortion: Distortion::from([-0.1, 0.03, 0.001, -0.002, 0.01]),
        };
        let pose = Pose::new(Rotation3::from_euler_angles(0.2, -0.3, 0.1), Vector3::new(0.02, -0.05, 2.4));
        let at = |x: f32, y: f32| 0.5 + 0.3 * (0.11 * x).sin() * (0.13 * y).cos() + 0.1 * (0.05 * (x - y)).sin();
        let values: Vec<f32> = (0..width * height).map(|i| at((i % width) as f32, (i / width) as f32)).collect();
        let points: Vec<Point3<f64>> = (0..6_000).map(|i| sheet(i % 80, i / 80, 80)).collect();
        let bins = points.iter().map(|p| (3.0 + 2.0 * (4.0 * p.x).sin() + 1.5 * (5.0 * p.y).cos()) as u16).collect();
        let shading = points.iter().map(|p| (0.4 + 0.3 * (4.0 * p.x).sin()) as f32).collect();
        let covered = points.len();
        let samples = SurfaceSamples { points, bins, covered, shading, ..Default::default() };
        (View { camera, pose }, Level::new(1.0, 160, 120, &values), samples)
    }

    /// A point of the sheet, by its column and row of so many columns.
    fn sheet(i: u32, j: u32, columns: u32) -> Point3<f64> {
        let (x, y) =
            (2.0 * f64::from(i) / f64::from(columns) - 1.0, 8.0 * f64::from(j) / (3.0 * f64::from(columns)) - 1.0);
        Point3::new(0.8 * x, 0.6 * y, 0.2 * (3.0 * x).sin() * (2.0 * y).cos())
    }

    /// The scene with its edges and outline, and a photo whose silhouette is a little off.
    fn drawn_scene() -> (View, Level, SurfaceSamples) {
        let (view, mut level, mut samples) = scene();
        let mut positions = Vec::new();
        let mut triangles = Vec::new();
        for (j, i) in (0..30).flat_map(|j| (0..40).map(move |i| (j, i))) {
            positions.push(sheet(i, j, 40).coords.into());
            if i < 39 && j < 29 {
                let k = j * 40 + i;
                triangles.extend([[k, k + 1, k + 40], [k + 1, k + 41, k + 40]]);
            }
        }
        let mesh = Mesh::new(&positions, triangles, Attributes::default()).unwrap();
        let mut picture = GBuffer::default();
        let shape = mesh.shape();
        Renderer::new().render(&shape, &view.camera, &view.pose, &Options::default(), &mut picture);
        samples.needles = Some(Needles::of(&mesh, &picture, &level, &view, 500));
        samples.contour = Some(Contour::of(&picture, &view.camera, &view));
        let ellipse =
            |i: usize| ((i % 160) as f32 / 47.0 - 1.75).powi(2) + ((i / 160) as f32 / 36.0 - 1.6).powi(2) < 1.0;
        let mask: Vec<f32> = (0..160 * 120).map(|i| f32::from(u8::from(ellipse(i)))).collect();
        level.silhouette = Some(Silhouette::new(160, 120, &mask));
        (view, level, samples)
    }

    /// Every metric, in every chart, with every part of the camera.
    #[test]
    fn derivatives_agree_with_differences() {
        let (view, level, samples) = drawn_scene();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let refine = Refine { focal: true, principal: true, distortion: true };
        let mut expected = view.camera;
        expected.intrinsics.fx *= 1.01;
        let prior = Prior { camera: expected, focal_from: FocalSource::Stated, weight: 1e-2 };
        let charts = RotationName::ALL.iter().map(|&rotation| (rotation, MetricName::MutualInformation));
        let metrics = MetricName::ALL.iter().map(|&metric| (RotationName::Lie, metric));
        for (rotation, metric) in charts.chain(metrics) {
            let space = ViewSpace { rotation: rotation.chart(), refine, limits: Limits::default() };
            let mut samples = SurfaceSamples { metric, ..samples.clone() };
            samples.needles = samples.needles.filter(|_| metric.has_edges());
            samples.contour = samples.contour.filter(|_| metric.has_silhouettes());
            let mut objective = PhotoObjective::<f64>::new(&samples, &level, &density, &space, prior);
            let Derivatives { gradient, curvature } = objective.derivatives(&view);
            assert_eq!(gradient.len(), space.dimension());
            let curvature = curvature.to_dense().unwrap();
            assert!(curvature.symmetric_eigenvalues().min() > -1e-9 * curvature.amax(), "{metric}");
            for k in 0..gradient.len() {
                // Each step moves the picture by some ten-thousandths of a pixel.
                let reach = match (k + MOST).saturating_sub(space.dimension()) {
                    7 | 8 => 1e-4,
                    9.. => 1e-5,
                    _ => 2e-6,
                };
                let mut along = |amount: f64| {
                    let mut step = DVector::zeros(space.dimension());
                    step[k] = amount;
                    objective.value(&space.retract(&view, &step).unwrap()).unwrap()
                };
                let mut central = |h: f64| (along(h) - along(-h)) / (2.0 * h);
                let slope = (4.0 * central(reach) - central(2.0 * reach)) / 3.0;
                let scale = gradient[k].abs().max(1e-3 * gradient.amax());
                let error = (gradient[k] - slope).abs() / scale;
                assert!(error < 1e-6, "{metric}, {rotation}, component {k}: {} against {slope}", gradient[k]);
            }
        }
    }

    #[test]
    fn samples_are_left_out_as_if_they_had_not_been_there() {
        let (view, level, samples) = drawn_scene();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let group: Vec<usize> = (0..samples.points.len()).filter(|i| i % 7 < 3).collect();
        let refine = Refine { focal: true, principal: false, distortion: true };
        let prior = Prior { camera: view.camera, focal_from: FocalSource::Stated, weight: 0.0 };
        for &metric in MetricName::ALL {
            let space = ViewSpace { rotation: RotationName::Lie.chart(), refine, limits: Limits::default() };
            let mut samples = SurfaceSamples { metric, ..samples.clone() };
            samples.needles = samples.needles.filter(|_| metric.has_edges());
            samples.contour = samples.contour.filter(|_| metric.has_silhouettes());
            let mut all = PhotoObjective::<f64>::new(&samples, &level, &density, &space, prior);
            let found = all.gradients_without(&view, std::slice::from_ref(&group)).remove(0);
            let mut rest = samples.clone();
            let kept = |i: usize| i % 7 >= 3;
            rest.points = (0..).zip(&samples.points).filter(|(i, _)| kept(*i)).map(|(_, p)| *p).collect();
            rest.bins = (0..).zip(&samples.bins).filter(|(i, _)| kept(*i)).map(|(_, bin)| *bin).collect();
            rest.shading = (0..).zip(&samples.shading).filter(|(i, _)| kept(*i)).map(|(_, shade)| *shade).collect();
            let expected = PhotoObjective::<f64>::new(&rest, &level, &density, &space, prior).dense(&view).gradient;
            assert!((&found - &expected).amax() < 1e-9 * expected.amax(), "{metric}: {found} against {expected}");
        }
    }

    #[test]
    fn gains_over_independence_are_information() {
        let (view, level, samples) = drawn_scene();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let space =
            ViewSpace { rotation: RotationName::Lie.chart(), refine: Refine::default(), limits: Limits::default() };
        let prior = Prior { camera: view.camera, focal_from: FocalSource::Stated, weight: 0.0 };
        let of = |metric: MetricName| {
            let mut samples = SurfaceSamples { metric, ..samples.clone() };
            samples.needles = samples.needles.filter(|_| metric.has_edges());
            samples.contour = samples.contour.filter(|_| metric.has_silhouettes());
            let mut objective = PhotoObjective::<f64>::new(&samples, &level, &density, &space, prior);
            let [independent, chance] = objective.independent(&view).unwrap();
            (objective.value(&view).unwrap(), independent, chance)
        };
        for &metric in MetricName::ALL {
            let (value, independent, chance) = of(metric);
            assert!(value > independent && value > chance, "{metric}: {value}, {independent}, {chance}");
        }
        let gain = |metric| of(metric).0 - of(metric).1;
        let (information, _, chance) = of(MetricName::MutualInformation);
        assert!(chance > 0.0 && chance < 0.05 * information, "{chance} nats of {information} by chance");
        assert!((gain(MetricName::MutualInformation) - information).abs() < 1e-12);
        assert!((gain(MetricName::ConditionalEntropy) - information).abs() < 1e-12);
        let both = information + gain(MetricName::Silhouette);
        assert!((gain(MetricName::InformationSilhouette) - both).abs() < 1e-12);
    }

    #[test]
    fn mixing_takes_each_once() {
        for count in [0, 1, 2, 5, 144, 1000, 6_543] {
            let mut indices: Vec<usize> = mixed(count).collect();
            indices.sort_unstable();
            assert!(indices.into_iter().eq(0..count), "{count}");
        }
    }

    /// The Fisher matrix is made of what the metric changes by when one sample moves and the others stay.
    #[test]
    fn the_curvature_is_the_outer_product_of_differences() {
        let (view, level, mut samples) = scene();
        samples.points = samples.points.into_iter().step_by(25).collect();
        samples.bins = samples.bins.into_iter().step_by(25).collect();
        let count = samples.points.len();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let space =
            ViewSpace { rotation: RotationName::Lie.chart(), refine: Refine::default(), limits: Limits::default() };
        let prior = Prior { camera: view.camera, focal_from: FocalSource::Stated, weight: 0.0 };
        let (values, _) = look::<f64>(&samples.points, &level, &view);
        for metric in [MetricName::MutualInformation, MetricName::Normalized, MetricName::ConditionalEntropy] {
            let of = metric.terms(&samples, &density).density.unwrap();
            let estimate = |photo: &[f64]| density.estimate(&Samples { model: &samples.bins, photo });
            let unit = of.unit(&estimate(&values));
            let h = 1e-4;
            let mut expected = DMatrix::zeros(POSE, POSE);
            for (i, point) in samples.points.iter().enumerate() {
                let row = DVector::from_fn(POSE, |k, _| {
                    let moved = |amount: f64| {
                        let mut step = DVector::zeros(POSE);
                        step[k] = amount;
                        let mut photo = values.clone();
                        photo[i] = look(&[*point], &level, &space.retract(&view, &step).unwrap()).0[0];
                        of.value(&estimate(&photo))
                    };
                    (moved(h) - moved(-h)) / (2.0 * h)
                });
                expected += count as f64 / unit * &row * row.transpose();
            }
            samples.metric = metric;
            let mut objective = PhotoObjective::<f64>::new(&samples, &level, &density, &space, prior);
            let curvature = objective.derivatives(&view).curvature.to_dense().unwrap();
            assert_eq!(curvature, curvature.transpose());
            let error = (&curvature - &expected).amax() / expected.amax();
            assert!(error < 1e-4, "{metric}: {error}: {curvature} against {expected}");
        }
    }
}
