//! How sure a view is.
//!
//! At the maximum of the metric M, with −H its Hessian, what its samples do not agree on moves the maximum. Cut the photo into
//! G regions of equally many samples; leaving out region g leaves a gradient r_g, and so moves the maximum by δ_g = H⁻¹ r_g to
//! first order. The covariance is
//!
//! ```text
//! Σ = (G − 1)/G Σ_g δ_g δ_gᵀ,
//! ```
//!
//! the delete-a-group jackknife (J. Shao and C. F. J. Wu, *A general theory for jackknife variance estimation*, Annals of
//! Statistics 17(3), 1989), in its one-step form, which is a sandwich estimator with the density's own uncertainty in it.
//! Regions are large, as what the model leaves unexplained (paint, shadows, clutter) is alike over large parts of a photo; the
//! inverse Hessian alone would take every sample for a witness of its own. The Hessian is taken by differences; where these see next
//! to no curvature it is a share of the Fisher information.
//!
//! Photos that share a lens have H in the shape of an arrow, and a region of one photo moves the lens, and through it all.

use crate::bounds::Limits;
use crate::parameters::{POSE, Refine, ViewSpace};
use crate::register::{EFFORTS, Registration};
use crate::samples::{Sampler, Sampling};
use crate::sweep::chain;
use crate::{Outcome, RotationName, Status};
use nalgebra::{DMatrix, DVector, Matrix6, Point2, Point3, Vector2, Vector6};
use rayon::prelude::*;
use serde_json::json;
use texreg_camera::{Camera, View};
use texreg_lie::so3;
use texreg_optim::{Arrow, Manifold};

/// The standard deviations of a view.
#[derive(Clone, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of the orientation: the root of the summed variances about three axes, in degrees.
    pub rotation_deg: f64,
    /// Of the camera's centre, in model units: the root of the summed variances along three axes.
    pub centre: f64,
    /// Of the surface in the photo, in pixels: the root mean square over what is visible.
    pub pixels: f64,
    /// The direction that is determined worst, in words.
    pub weakest: String,
    /// Of the focal length, where it is refined.
    pub focal: Option<FocalUncertainty>,
    /// The covariance of `(ω, t)` for the pose `exp(ω, t) · pose`, in radians and model units.
    pub covariance: Matrix6<f64>,
}

/// How sure a focal length is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FocalUncertainty {
    /// The standard deviation in percent.
    pub percent: f64,
    /// The correlation with the distance of the model, −1 to 1: near 1, one stands in for the other.
    pub with_distance: f64,
}

/// The number of regions: a power of two.
const REGIONS: usize = 16;

/// The steps of the differences that make the Hessian move the picture by about this many pixels.
const STEP: f64 = 0.5;

/// A direction whose curvature is less than this share of the Fisher information counts as one of so much. By differences the metric
/// of a small picture is flat or not even concave at its maximum, as they follow its ripples.
const FLAT: f64 = 0.02;

/// Points of the surface that stand for all of it.
const PROBES: usize = 300;

/// A surface that is looser than this share of the photo's diagonal is not registered: three quarters of what counts as found.
const LOOSE: f64 = 0.0015;

/// A focal length that is looser than this, in percent, and bound to the distance like this, has not been found.
const LOOSE_FOCAL: f64 = 2.0;
const TRADED: f64 = 0.9;

/// What one photo says of its view, and how far its regions agree.
pub(crate) struct Witness {
    view: View,
    refine: Refine,
    /// Visible points of the surface.
    probes: Vec<Point3<f64>>,
    /// Minus the Hessian.
    information: DMatrix<f64>,
    /// The gradients without each region, less their mean.
    left: Vec<DVector<f64>>,
}

impl Witness {
    /// What a photo says at the best view, of the model's frame, by the components of a view in the Lie chart; `expected` is
    /// the expected camera, `prior` what that counts for. `None` where the view shows nothing of the model.
    pub(crate) fn new(
        photo: &Registration,
        view: &View,
        refine: Refine,
        expected: &Camera,
        prior: f64,
    ) -> Option<Self> {
        let space = ViewSpace { rotation: RotationName::Lie.chart(), refine, limits: Limits::default() };
        let sampling = Sampling::with_halo(EFFORTS[EFFORTS.len() - 1].samples, photo.options.metric);
        let samples = Sampler::new(photo.model.mesh, &*photo.model.signal).sample(view, &photo.levels[0], &sampling)?;
        let background = photo.model.signal.bins() as u16;
        let surface = samples.bins.iter().filter(|&&bin| bin != background).count();
        let probes: Vec<_> = samples.points[..surface].iter().step_by(surface / PROBES + 1).copied().collect();
        let objective = || photo.objective(0, &samples, &space, expected, prior);
        let reach = motions(view, refine, &probes);
        let columns: Vec<DVector<f64>> = (0..space.dimension())
            .into_par_iter()
            .map(|k| {
                let step = STEP / reach[k].max(f64::MIN_POSITIVE);
                let at = |step: f64| {
                    let mut tangent = DVector::zeros(space.dimension());
                    tangent[k] = step;
                    space.retract(view, &tangent).map(|at| objective().dense(&at).gradient)
                };
                Some((at(-step)? - at(step)?) / (2.0 * step))
            })
            .collect::<Option<_>>()?;
        let mut here = objective();
        let information = convex(&DMatrix::from_columns(&columns), &here.dense(view).curvature)?;
        let mut left = here.gradients_without(view, &regions(view, &samples.points));
        let mean = left.iter().sum::<DVector<f64>>() / left.len() as f64;
        left.iter_mut().for_each(|left| *left -= &mean);
        Some(Self { view: *view, refine, probes, information, left })
    }
}

/// A Hessian made symmetric and positive definite: no direction has less than a small share of the Fisher information. `None` where
/// the photo says nothing of one.
fn convex(hessian: &DMatrix<f64>, fisher: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let unit = fisher.clone().cholesky()?.l();
    let inverse = unit.clone().try_inverse()?;
    let mut eigen = (0.5 * &inverse * (hessian + hessian.transpose()) * inverse.transpose()).symmetric_eigen();
    eigen.eigenvalues.apply(|value| *value = value.max(FLAT));
    Some(&unit * eigen.recompose() * unit.transpose())
}

/// The points of each region: halves of halves, with as many in each.
fn regions(view: &View, points: &[Point3<f64>]) -> Vec<Vec<usize>> {
    let pixel = |point: &Point3<f64>| view.project(point).unwrap_or(Point2::origin());
    let pixels: Vec<Point2<f64>> = points.par_iter().with_min_len(1024).map(pixel).collect();
    let mut regions = vec![(0..pixels.len()).collect::<Vec<usize>>()];
    while regions.len() < REGIONS {
        let halves = regions.into_iter().flat_map(|mut region| {
            let extent = |axis: usize| {
                let along = region.iter().map(|&i| pixels[i][axis]);
                let (low, high) = along.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
                high - low
            };
            let axis = usize::from(extent(1) > extent(0));
            let middle = region.len() / 2;
            if middle < region.len() {
                let order = |&i: &usize, &j: &usize| pixels[i][axis].total_cmp(&pixels[j][axis]).then(i.cmp(&j));
                region.select_nth_unstable_by(middle, order);
            }
            let half = region.split_off(middle);
            [region, half]
        });
        regions = halves.collect();
    }
    regions
}

/// How far the picture moves with each component of a view: the root mean square over points, in pixels per unit.
fn motions(view: &View, refine: Refine, probes: &[Point3<f64>]) -> Vec<f64> {
    let mut sums = vec![0.0; refine.dimension()];
    for row in probes.iter().flat_map(|point| rows(view, refine, point)) {
        sums.iter_mut().zip(row.iter()).for_each(|(sum, x)| *sum += x * x);
    }
    sums.into_iter().map(|sum| (sum / probes.len().max(1) as f64).sqrt()).collect()
}

/// The derivatives of a point's pixel, u and v, by the components of a view.
fn rows(view: &View, refine: Refine, point: &Point3<f64>) -> impl Iterator<Item = DVector<f64>> {
    let row = |axis: Vector2<f64>| {
        let row = chain(view, &view.camera, refine, 1.0, point, &axis)?;
        Some(DVector::from_column_slice(&row[..refine.dimension()]))
    };
    [row(Vector2::x()), row(Vector2::y())].into_iter().flatten()
}

/// How sure each view is, where the last `common` components are the same for all, with `precision` what is known of them before.
/// `None` where numbers fail.
pub(crate) fn uncertainties(
    witnesses: &[Witness],
    common: usize,
    precision: &DVector<f64>,
) -> Vec<Option<Uncertainty>> {
    let n = |witness: &Witness| witness.information.nrows() - common;
    let mut arrow = Arrow::zeros(&witnesses.iter().map(n).collect::<Vec<_>>(), common);
    arrow.shared.set_diagonal(precision);
    for (arm, witness) in arrow.arms.iter_mut().zip(witnesses) {
        let (n, information) = (n(witness), &witness.information);
        arm.own.copy_from(&information.view((0, 0), (n, n)));
        arm.with_shared.copy_from(&information.view((0, n), (n, common)));
        arrow.shared += information.view((n, n), (common, common));
    }
    let inverse = arrow.inverse().and_then(|inverse| Some((inverse.shared.clone().try_inverse()?, inverse)));
    let Some((schur, inverse)) = inverse else { return vec![None; witnesses.len()] };
    // How each region of each photo moves that photo's own components and the common ones.
    let moves = witnesses.iter().enumerate().map(|(k, witness)| {
        let (own, beside) = (&inverse.own[k], &inverse.with_shared[k]);
        let of = |left: &DVector<f64>| {
            let (a, b) = (left.rows(0, n(witness)), left.rows(n(witness), common));
            (own * a + beside * b, beside.tr_mul(&a) + &inverse.shared * b)
        };
        witness.left.iter().map(of).collect()
    });
    let moves: Vec<Vec<(DVector<f64>, DVector<f64>)>> = moves.collect();
    let spread = moves.iter().flatten().map(|(_, shared)| shared * shared.transpose());
    let spread = spread.fold(DMatrix::zeros(common, common), |sum, part| sum + part);
    let of = |k: usize| {
        let n = n(&witnesses[k]);
        // Regions of other photos move the view through the common components alone.
        let mut through = DMatrix::zeros(n + common, common);
        through.view_mut((0, 0), (n, common)).copy_from(&(&inverse.with_shared[k] * &schur));
        through.view_mut((n, 0), (common, common)).fill_with_identity();
        let mut covariance = &through * &spread * through.transpose();
        for (own, shared) in &moves[k] {
            let (mut all, others) = (DVector::zeros(n + common), &through * shared);
            all.rows_mut(0, n).copy_from(own);
            all.rows_mut(n, common).copy_from(shared);
            covariance += &all * all.transpose() - &others * others.transpose();
        }
        Some(describe(&witnesses[k], &((REGIONS - 1) as f64 / REGIONS as f64 * covariance)))
    };
    (0..witnesses.len()).map(of).collect()
}

/// The numbers of a covariance by the components of a view.
fn describe(witness: &Witness, covariance: &DMatrix<f64>) -> Uncertainty {
    let view = &witness.view;
    let pose: Matrix6<f64> = covariance.fixed_view::<POSE, POSE>(0, 0).into_owned();
    // A step of the view turns the model about its own origin; exp(ω, t) · pose turns it about the camera's centre.
    let mut about_camera = Matrix6::identity();
    about_camera.fixed_view_mut::<3, 3>(3, 0).copy_from(&so3::hat(&view.pose.translation));
    let left = about_camera * pose * about_camera.transpose();
    let deviation = |matrix: &Matrix6<f64>, first: usize| -> f64 {
        (first..first + 3).map(|k| matrix[(k, k)]).sum::<f64>().max(0.0).sqrt()
    };
    let variances = witness.probes.iter().flat_map(|point| rows(view, witness.refine, point));
    let variance: f64 = variances.map(|row| (covariance * &row).dot(&row)).sum();
    let focal = witness.refine.focal.then(|| {
        let (focal, distance) = (covariance[(POSE, POSE)], covariance[(5, 5)]);
        let with_distance = covariance[(POSE, 5)] / (focal * distance).sqrt();
        FocalUncertainty { percent: 100.0 * focal.max(0.0).sqrt(), with_distance }
    });
    Uncertainty {
        rotation_deg: deviation(&pose, 0).to_degrees(),
        centre: deviation(&left, 3),
        pixels: (variance / witness.probes.len().max(1) as f64).max(0.0).sqrt(),
        weakest: weakest(&witness.probes, &pose),
        focal,
        covariance: left,
    }
}

/// The direction in which the surface moves most, in words: turns count by how far they move it.
fn weakest(probes: &[Point3<f64>], pose: &Matrix6<f64>) -> String {
    const NAMES: [&str; POSE] = [
        "nodding about the horizontal axis",
        "turning about the upright axis",
        "rolling about the line of sight",
        "shift to the side",
        "shift up or down",
        "distance",
    ];
    let square = probes.iter().map(|point| point.coords.norm_squared()).sum::<f64>() / probes.len().max(1) as f64;
    let radius = square.sqrt();
    let scale = Matrix6::from_diagonal(&Vector6::new(radius, radius, radius, 1.0, 1.0, 1.0));
    let eigen = (scale * pose * scale).symmetric_eigen();
    let direction: Vector6<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let most = direction.amax();
    let mut parts: Vec<(f64, &str)> =
        direction.iter().zip(NAMES).map(|(x, name)| (x.abs(), name)).filter(|(x, _)| *x > 0.6 * most).collect();
    parts.sort_by(|a, b| b.0.total_cmp(&a.0));
    parts.into_iter().map(|(_, name)| name).collect::<Vec<_>>().join(" with ")
}

impl Uncertainty {
    /// What `cameras.json` tells of it.
    pub fn json(&self) -> serde_json::Value {
        json!({
            "rotation_deg": self.rotation_deg,
            "centre": self.centre,
            "pixels": self.pixels,
            "weakest": self.weakest,
            "focal_pct": self.focal.map(|focal| focal.percent),
            "focal_distance_correlation": self.focal.map(|focal| focal.with_distance),
            "covariance": self.covariance.row_iter().map(|row| row.iter().copied().collect()).collect::<Vec<Vec<f64>>>(),
        })
    }
}

impl Outcome {
    /// Adds how sure the view is, and the doubts that follow from it.
    pub(crate) fn attach(&mut self, uncertainty: Option<Uncertainty>) {
        let camera = &self.view.camera;
        let diagonal = f64::from(camera.width).hypot(f64::from(camera.height));
        let mut doubts = Vec::new();
        match &uncertainty {
            None => doubts.push("how sure the view is cannot be said".to_owned()),
            Some(found) if found.pixels > LOOSE * diagonal => doubts
                .push(format!("the view is loose: ±{:.1} px on the surface, most in {}", found.pixels, found.weakest)),
            Some(_) => {}
        }
        if let Some(focal) = uncertainty.as_ref().and_then(|found| found.focal)
            && focal.percent > LOOSE_FOCAL
            && focal.with_distance.abs() > TRADED
        {
            doubts.push(format!(
                "the focal length (±{:.1} %) and the distance stand in for each other (correlation {:.2})",
                focal.percent, focal.with_distance
            ));
        }
        if self.status == Status::Registered && !doubts.is_empty() {
            self.status = Status::Uncertain;
        }
        self.reasons.extend(doubts);
        self.uncertainty = uncertainty;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix2;
    use texreg_lie::Pose;

    /// Numbers without a pattern, from −1 to 1.
    fn number(i: usize, j: usize, k: usize) -> f64 {
        (12.9898 * i as f64 + 78.233 * j as f64 + 37.719 * k as f64).sin()
    }

    #[test]
    fn the_covariance_is_that_of_the_whole_matrix() {
        let (photos, common) = (3, 1);
        let own = POSE;
        let refine = Refine { focal: true, ..Refine::default() };
        let view = View { camera: Camera::ideal(64, 48, 60.0), pose: Pose::identity() };
        let witness = |k: usize| {
            let root = DMatrix::from_fn(own + common, own + common, |i, j| number(i, j, k));
            let left = (0..REGIONS).map(|g| DVector::from_fn(own + common, |i, _| number(i, g, 100 + k)));
            let information = &root * root.transpose() + DMatrix::identity(own + common, own + common);
            Witness { view, refine, probes: Vec::new(), information, left: left.collect() }
        };
        let witnesses: Vec<Witness> = (0..photos).map(witness).collect();
        let precision = DVector::from_element(common, 0.3);
        let found = uncertainties(&witnesses, common, &precision);

        let dimension = photos * own + common;
        let place = |k: usize, i: usize| if i < own { k * own + i } else { photos * own + i - own };
        let mut whole = DMatrix::zeros(dimension, dimension);
        whole[(dimension - 1, dimension - 1)] = 0.3;
        for (k, witness) in witnesses.iter().enumerate() {
            for i in 0..own + common {
                for j in 0..own + common {
                    whole[(place(k, i), place(k, j))] += witness.information[(i, j)];
                }
            }
        }
        let inverse = whole.try_inverse().unwrap();
        let mut covariance = DMatrix::zeros(dimension, dimension);
        for (k, witness) in witnesses.iter().enumerate() {
            for left in &witness.left {
                let mut all = DVector::zeros(dimension);
                (0..own + common).for_each(|i| all[place(k, i)] = left[i]);
                let moved = &inverse * all;
                covariance += 15.0 / 16.0 * &moved * moved.transpose();
            }
        }
        for (k, found) in found.iter().enumerate() {
            let found = found.as_ref().unwrap();
            let pose = covariance.view((k * own, k * own), (own, own));
            assert!((found.covariance - pose).amax() < 1e-9 * pose.amax());
            let focal = covariance[(dimension - 1, dimension - 1)].sqrt();
            assert!((found.focal.unwrap().percent - 100.0 * focal).abs() < 1e-9);
        }
    }

    #[test]
    fn what_has_no_curvature_is_given_a_little() {
        let turn = Matrix2::new(0.8, -0.6, 0.6, 0.8);
        let matrix = |first: f64, second: f64| {
            let inner = turn * Matrix2::new(first, 0.0, 0.0, second) * turn.transpose();
            DMatrix::from_iterator(2, 2, inner.iter().copied())
        };
        let fisher = matrix(16.0, 9.0);
        for (hessian, expected) in [((4.0, 2.0), (4.0, 2.0)), ((4.0, -1.0), (4.0, 9.0 * FLAT))] {
            let convex = convex(&matrix(hessian.0, hessian.1), &fisher).unwrap();
            assert!((convex - matrix(expected.0, expected.1)).amax() < 1e-12);
        }
        assert!(convex(&fisher, &matrix(1.0, 0.0)).is_none());
    }

    #[test]
    fn regions_hold_as_many_samples_each_and_lie_together() {
        let view = View { camera: Camera::ideal(64, 48, 60.0), pose: Pose::identity() };
        let points = (0..1600).map(|i| Point3::new(f64::from(i % 40) / 60.0, f64::from(i / 40) / 80.0, 1.0));
        let points: Vec<Point3<f64>> = points.collect();
        let regions = regions(&view, &points);
        assert_eq!(regions.len(), REGIONS);
        assert!(regions.iter().all(|region| region.len() == 100));
        let extent = |region: &[usize], axis: usize| {
            let along = || region.iter().map(|&i| points[i][axis]);
            along().fold(0.0, f64::max) - along().fold(1.0, f64::min)
        };
        assert!(regions.iter().all(|region| extent(region, 0) < 0.2 && extent(region, 1) < 0.2));
        let mut all = regions.concat();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..1600));
    }
}
