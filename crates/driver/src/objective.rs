//! How well a view explains a photo, as a function of the view: fixed surface samples, moved by the camera through one level
//! of the photo.
//!
//! With the metric `M` over the density of pairs (bin `u_i`, photo value `v_i`), `∂M/∂ξ = 1/N Σ s_i g_i` for the scores
//! `s_i = N ∂M/∂v_i` and `g_i = ∂v_i/∂ξ`, the photo's gradient times the projection's Jacobian. The curvature is the empirical
//! Fisher matrix `1/N Σ s_i² g_i g_iᵀ`.

use crate::Refine;
use crate::parameters::{Dense, MOST, POSE, ViewSpace};
use crate::pyramid::Level;
use crate::samples::SurfaceSamples;
use nalgebra::{DMatrix, DVector, Point3, Vector2, Vector3};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_mi::{Density, Metric, Samples};
use texreg_optim::{Curvature, Derivatives, Objective};

/// What is known of the camera before the photo was looked at.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Prior {
    /// The expected camera.
    pub(crate) camera: Camera,
    /// What the prior counts for, against one photo: the reciprocal of the number of independent samples in it.
    pub(crate) weight: f64,
}

impl Prior {
    /// Minus half the squared distance from the expected camera in standard deviations, weighted.
    pub(crate) fn log(&self, refine: Refine, camera: &Camera) -> f64 {
        let offset = refine.offset(&self.camera, camera);
        let deviations = refine.deviations(&self.camera);
        -0.5 * self.weight * offset.iter().zip(deviations).map(|(x, d)| (x / d).powi(2)).sum::<f64>()
    }

    /// The derivatives of [`log`](Self::log) by the camera's components.
    pub(crate) fn derivatives(&self, refine: Refine, camera: &Camera) -> Dense {
        let offset = DVector::from_vec(refine.offset(&self.camera, camera));
        let deviations = DVector::from_vec(refine.deviations(&self.camera));
        let precision = deviations.map(|d| self.weight / (d * d));
        Dense { gradient: -precision.component_mul(&offset), curvature: DMatrix::from_diagonal(&precision) }
    }
}

/// The metric over the views of one photo.
pub(crate) struct PhotoObjective<'a> {
    pub(crate) samples: &'a SurfaceSamples,
    pub(crate) level: &'a Level,
    pub(crate) density: &'a dyn Density,
    pub(crate) metric: &'a dyn Metric,
    pub(crate) space: &'a ViewSpace<'a>,
    pub(crate) prior: Prior,
    seen: Option<Seen>,
    /// How often the metric was evaluated.
    pub(crate) evaluations: usize,
}

/// What the samples show from the view that was evaluated last.
struct Seen {
    view: View,
    values: Vec<f32>,
    slopes: Vec<[f32; 2]>,
    /// The metric's derivatives by cell of the joint density.
    table: Vec<f64>,
}

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 2048;

impl<'a> PhotoObjective<'a> {
    pub(crate) fn new(
        samples: &'a SurfaceSamples,
        level: &'a Level,
        density: &'a dyn Density,
        metric: &'a dyn Metric,
        space: &'a ViewSpace<'a>,
        prior: Prior,
    ) -> Self {
        Self { samples, level, density, metric, space, prior, seen: None, evaluations: 0 }
    }

    /// The derivatives at a view, by a step of the chart and by the camera's components.
    pub(crate) fn dense(&mut self, at: &View) -> Dense {
        if self.seen.as_ref().is_none_or(|seen| seen.view != *at) {
            self.value(at);
        }
        let seen = self.seen.as_ref().expect("the view was just evaluated");
        let scores = self.density.scores(&Samples { model: &self.samples.bins, photo: &seen.values }, &seen.table);
        let camera = self.level.camera(&at.camera);
        let dimension = self.space.refine.dimension();
        let sums: Vec<Sums<MOST>> = self
            .samples
            .points
            .par_chunks(CHUNK)
            .zip(seen.slopes.par_chunks(CHUNK))
            .zip(scores.par_chunks(CHUNK))
            .map(|((points, slopes), scores)| {
                let mut sums = Sums::default();
                for ((point, slope), &score) in points.iter().zip(slopes).zip(scores) {
                    if score != 0.0 {
                        let gradient = f64::from(score) * Vector2::new(f64::from(slope[0]), f64::from(slope[1]));
                        if let Some(row) = chain(at, &camera, self.space.refine, self.level.scale, point, &gradient) {
                            sums.add(&row[..dimension]);
                        }
                    }
                }
                sums
            })
            .collect();
        let scale = 1.0 / self.samples.points.len().max(1) as f64;
        let mut total = Sums::default();
        sums.iter().for_each(|part| total.merge(part));
        let mut tangent = total.derivatives(dimension, scale);
        let prior = self.prior.derivatives(self.space.refine, &at.camera);
        let camera = prior.gradient.len();
        let mut own = tangent.gradient.rows_mut(POSE, camera);
        own += prior.gradient;
        let mut own = tangent.curvature.view_mut((POSE, POSE), (camera, camera));
        own += prior.curvature;
        self.space.pull_back(at, &tangent)
    }
}

impl Objective<View> for PhotoObjective<'_> {
    fn value(&mut self, at: &View) -> Option<f64> {
        self.evaluations += 1;
        let (values, slopes) = look(&self.samples.points, self.level, at);
        let joint = self.density.estimate(&Samples { model: &self.samples.bins, photo: &values });
        let value = self.metric.value(&joint);
        let table = self.metric.derivative(&joint);
        self.seen = Some(Seen { view: *at, values, slopes, table });
        Some(value + self.prior.log(self.space.refine, &at.camera)).filter(|value| value.is_finite())
    }

    fn derivatives(&mut self, at: &View) -> Derivatives {
        let Dense { gradient, curvature } = self.dense(at);
        Derivatives { gradient, curvature: Curvature::Dense(curvature) }
    }
}

/// What a view sees of points in a level of the photo: the values, NaN outside it, and their slopes.
pub(crate) fn look(points: &[Point3<f64>], level: &Level, view: &View) -> (Vec<f32>, Vec<[f32; 2]>) {
    let camera = level.camera(&view.camera);
    let mut values = vec![f32::NAN; points.len()];
    let mut slopes = vec![[0.0; 2]; points.len()];
    (points.par_chunks(CHUNK), values.par_chunks_mut(CHUNK), slopes.par_chunks_mut(CHUNK)).into_par_iter().for_each(
        |(points, values, slopes)| {
            for ((point, value), slope) in points.iter().zip(values).zip(slopes) {
                let pixel = camera.project(&view.pose.transform_point(point));
                if let Some([v, dx, dy]) = pixel.and_then(|p| level.sample(p.x, p.y)) {
                    *value = v;
                    *slope = [dx, dy];
                }
            }
        },
    );
    (values, slopes)
}

/// `gradientᵀ · ∂pixel/∂ξ` for one point and the tangent ξ; `gradient` is by the level's pixels.
#[inline]
pub(crate) fn chain(
    view: &View,
    camera: &Camera,
    refine: Refine,
    scale: f64,
    point: &Point3<f64>,
    gradient: &Vector2<f64>,
) -> Option<[f64; MOST]> {
    let turned: Vector3<f64> = view.pose.rotation * point.coords;
    let in_camera = Point3::from(turned + view.pose.translation);
    let mut row = [0.0; MOST];
    let by_point = if refine == Refine::default() {
        camera.project_with_jacobian(&in_camera)?.1.tr_mul(gradient)
    } else {
        let projection = camera.project_with_jacobians(&in_camera)?;
        refine.chain(camera, scale, &projection, gradient, &mut row[POSE..]);
        projection.point.tr_mul(gradient)
    };
    // A step ω turns the point about the model's origin: d(exp(ω) R X)/dω = −[R X]×.
    row[..3].copy_from_slice(turned.cross(&by_point).as_slice());
    row[3..6].copy_from_slice(by_point.as_slice());
    Some(row)
}

/// Sums of rows of at most `N` numbers, and of the lower triangles of their outer products.
pub(crate) struct Sums<const N: usize> {
    first: [f64; N],
    second: [[f64; N]; N],
}

impl<const N: usize> Default for Sums<N> {
    fn default() -> Self {
        Self { first: [0.0; N], second: [[0.0; N]; N] }
    }
}

impl<const N: usize> Sums<N> {
    #[inline]
    pub(crate) fn add(&mut self, row: &[f64]) {
        for (i, x) in row.iter().enumerate() {
            self.first[i] += x;
            for (sum, y) in self.second[i][..=i].iter_mut().zip(row) {
                *sum += x * y;
            }
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        for i in 0..N {
            self.first[i] += other.first[i];
            for j in 0..=i {
                self.second[i][j] += other.second[i][j];
            }
        }
    }

    /// Gradient and curvature of the first components, scaled.
    pub(crate) fn derivatives(&self, dimension: usize, scale: f64) -> Dense {
        Dense {
            gradient: DVector::from_fn(dimension, |i, _| scale * self.first[i]),
            curvature: DMatrix::from_fn(dimension, dimension, |i, j| scale * self.second[i.max(j)][i.min(j)]),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::RotationName;
    use crate::options::MetricName;
    use nalgebra::Rotation3;
    use texreg_camera::{Distortion, Intrinsics};
    use texreg_lie::Pose;
    use texreg_mi::Parzen;
    use texreg_optim::Manifold;

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
        let points: Vec<Point3<f64>> = (0..6_000)
            .map(|i| {
                let (x, y) = (f64::from(i % 80) / 40.0 - 1.0, f64::from(i / 80) / 37.5 - 1.0);
                Point3::new(0.8 * x, 0.6 * y, 0.2 * (3.0 * x).sin() * (2.0 * y).cos())
            })
            .collect();
        let bins = points.iter().map(|p| (3.0 + 2.0 * (4.0 * p.x).sin() + 1.5 * (5.0 * p.y).cos()) as u16).collect();
        let covered = points.len();
        (View { camera, pose }, Level::new(1.0, 160, 120, &values), SurfaceSamples { points, bins, covered })
    }

    #[test]
    fn derivatives_agree_with_differences_in_every_chart() {
        let (view, level, samples) = scene();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let refine = Refine { focal: true, principal: true, distortion: true };
        let mut expected = view.camera;
        expected.intrinsics.fx *= 1.01;
        let prior = Prior { camera: expected, weight: 1e-2 };
        for &rotation in RotationName::ALL {
            let space = ViewSpace { rotation: rotation.chart(), refine };
            let metric = MetricName::MutualInformation.metric();
            let mut objective = PhotoObjective::new(&samples, &level, &density, metric, &space, prior);
            let gradient = objective.derivatives(&view).gradient;
            assert_eq!(gradient.len(), space.dimension());
            for k in 0..gradient.len() {
                // Values are of single precision: each step moves the picture by a hundredth of a pixel or so.
                let reach = match (k + MOST).saturating_sub(space.dimension()) {
                    7 | 8 => 1e-2,
                    9.. => 2e-3,
                    _ => 1e-4,
                };
                let mut along = |amount: f64| {
                    let mut step = DVector::zeros(space.dimension());
                    step[k] = amount;
                    objective.value(&space.retract(&view, &step).unwrap()).unwrap()
                };
                let central = |h: f64, along: &mut dyn FnMut(f64) -> f64| (along(h) - along(-h)) / (2.0 * h);
                let slope = (4.0 * central(reach, &mut along) - central(2.0 * reach, &mut along)) / 3.0;
                let scale = gradient[k].abs().max(1e-2 * gradient.amax());
                assert!(
                    (gradient[k] - slope).abs() < 2e-3 * scale,
                    "{rotation}, component {k}: {} against {slope}",
                    gradient[k]
                );
            }
        }
    }

    #[test]
    fn the_curvature_is_positive_and_symmetric() {
        let (view, level, samples) = scene();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let space = ViewSpace { rotation: RotationName::Lie.chart(), refine: Refine::default() };
        let prior = Prior { camera: view.camera, weight: 0.0 };
        let metric = MetricName::MutualInformation.metric();
        let curvature =
            PhotoObjective::new(&samples, &level, &density, metric, &space, prior).derivatives(&view).curvature;
        let curvature = curvature.to_dense().unwrap();
        assert_eq!(curvature, curvature.transpose());
        assert!(curvature.symmetric_eigenvalues().min() > 0.0);
    }
}
