//! Many photos at once: a point is a view for each, and the metric is a sum over the photos and over pairs of them.
//!
//! The tangent space has the photos' own components first, photo by photo, and then those of the camera, if they share one.
//! With `M_p` the metric between the model and photo p, and `I_pq` the mutual information of photos p and q over the surface
//! that both see,
//!
//! ```text
//! M = Σ_p M_p + Σ_p Σ_q w_pq I_pq + log prior of the camera.
//! ```

use crate::Refine;
use crate::objective::{PhotoObjective, Prior};
use crate::pair::PairObjective;
use crate::parameters::{Dense, ViewSpace};
use nalgebra::DVector;
use texreg_camera::View;
use texreg_mi::Real;
use texreg_optim::{Arrow, Curvature, Derivatives, Manifold, Objective, Pair, Region};

/// The views of several photos, whose cameras are their own or the same for all.
pub(crate) struct RigSpace<'a> {
    /// One a photo.
    pub(crate) views: &'a [ViewSpace<'a>],
    /// Whether one camera took all photos: their views then have equal cameras.
    pub(crate) shared: bool,
}

impl RigSpace<'_> {
    fn refine(&self) -> Refine {
        self.views[0].refine
    }

    /// The components that the photos share.
    fn common(&self) -> usize {
        if self.shared { self.refine().camera() } else { 0 }
    }

    /// The components of one photo alone.
    fn own(&self) -> usize {
        self.views[0].dimension() - self.common()
    }

    /// Where a component of a photo's view is among those of all.
    fn component(&self, photo: usize, k: usize) -> usize {
        let own = self.own();
        if k < own { photo * own + k } else { self.views.len() * own + k - own }
    }
}

impl Manifold<Vec<View>> for RigSpace<'_> {
    fn dimension(&self) -> usize {
        self.views.len() * self.own() + self.common()
    }

    fn retract(&self, at: &Vec<View>, step: &DVector<f64>) -> Option<Vec<View>> {
        let of = |(photo, view): (usize, &View)| {
            let space = &self.views[photo];
            let step = DVector::from_fn(space.dimension(), |k, _| step[self.component(photo, k)]);
            space.retract(view, &step)
        };
        at.iter().enumerate().map(of).collect()
    }

    /// That of each view; the shared camera is the same for all.
    fn region(&self, at: &Vec<View>) -> Region {
        at.iter().enumerate().fold(Region::default(), |all, (photo, view)| {
            let mut region = self.views[photo].region(view);
            region.bounds.retain(|&(k, ..)| photo == 0 || k < self.own());
            all.and_by(region, |k| self.component(photo, k))
        })
    }
}

/// The metric over the views of several photos.
pub(crate) struct RigObjective<'a, T = f32> {
    pub(crate) space: &'a RigSpace<'a>,
    /// One a photo; they weigh the prior of their cameras where these are not shared.
    pub(crate) photos: Vec<PhotoObjective<'a, T>>,
    pub(crate) pairs: Vec<PairObjective<'a>>,
    /// What is known of the shared camera.
    pub(crate) prior: Option<Prior>,
}

impl<T: Real> Objective<Vec<View>> for RigObjective<'_, T> {
    fn value(&mut self, at: &Vec<View>) -> Option<f64> {
        let mut value = 0.0;
        for (photo, view) in self.photos.iter_mut().zip(at) {
            value += photo.value(view)?;
        }
        for pair in &mut self.pairs {
            value += pair.value(at);
        }
        let prior = self.prior.as_ref().zip(at.first());
        Some(value + prior.map_or(0.0, |(prior, view)| prior.log(self.space.refine(), &view.camera)))
    }

    fn derivatives(&mut self, at: &Vec<View>) -> Derivatives {
        let mut sum = Sum::new(self.space);
        for (p, (photo, view)) in self.photos.iter_mut().zip(at).enumerate() {
            sum.add(&[p], &photo.dense(view));
        }
        for pair in &mut self.pairs {
            let photos = pair.photos();
            sum.add(&photos, &pair.derivatives(at, &self.space.views[0]));
        }
        if let (Some(prior), Some(view)) = (&self.prior, at.first()) {
            sum.add(&[], &prior.derivatives(self.space.refine(), &view.camera));
        }
        Derivatives { gradient: sum.gradient, curvature: Curvature::Arrow(sum.curvature) }
    }
}

/// Derivatives of a sum by the components of all photos.
struct Sum<'a> {
    space: &'a RigSpace<'a>,
    gradient: DVector<f64>,
    curvature: Arrow,
}

impl<'a> Sum<'a> {
    fn new(space: &'a RigSpace<'a>) -> Self {
        let curvature = Arrow::zeros(&vec![space.own(); space.views.len()], space.common());
        Self { space, gradient: DVector::zeros(space.dimension()), curvature }
    }

    /// Adds derivatives by the components of some photos, each with the common ones; without a photo, by the common ones alone.
    fn add(&mut self, photos: &[usize], part: &Dense) {
        let (own, common) = (self.space.own(), self.space.common());
        let starts: Vec<usize> = (0..photos.len()).map(|k| k * (own + common)).collect();
        let ends: Vec<usize> =
            if photos.is_empty() { vec![0] } else { starts.iter().map(|start| start + own).collect() };
        let block = |row: usize, rows: usize, column: usize, columns: usize| {
            part.curvature.view((row, column), (rows, columns)).clone_owned()
        };
        for (k, &photo) in photos.iter().enumerate() {
            let mut gradient = self.gradient.rows_mut(photo * own, own);
            gradient += part.gradient.rows(starts[k], own);
            let arm = &mut self.curvature.arms[photo];
            arm.own += block(starts[k], own, starts[k], own);
            ends.iter().for_each(|&end| arm.with_shared += block(starts[k], own, end, common));
            for (j, &other) in photos.iter().enumerate().skip(k + 1) {
                let between = block(starts[k], own, starts[j], own);
                self.curvature.pairs.push(Pair { first: photo, second: other, between });
            }
        }
        for &row in &ends {
            let mut gradient = self.gradient.rows_mut(self.space.views.len() * own, common);
            gradient += part.gradient.rows(row, common);
            ends.iter().for_each(|&column| self.curvature.shared += block(row, common, column, common));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::{Bounds, Limits};
    use crate::objective::tests::scene;
    use crate::pair::Overlap;
    use crate::pyramid::Level;
    use crate::{FocalSource, RotationName, SolverName, samples::SurfaceSamples};
    use nalgebra::Vector3;
    use texreg_lie::{Pose, so3};
    use texreg_mi::Parzen;

    /// Three photos of one surface: the scene's, and two taken from beside it with other light.
    fn photos() -> (Vec<View>, Vec<Level>, SurfaceSamples) {
        let (view, level, samples) = scene();
        let values = |k: f32| -> Vec<f32> {
            let of = |y: usize| {
                level
                    .row(y)
                    .iter()
                    .enumerate()
                    .map(move |(x, v)| 0.05 + 0.9 * v * v + 0.04 * (k * (x + y) as f32).sin())
            };
            (0..level.height).flat_map(of).collect()
        };
        let beside = |turn: f64| View {
            camera: view.camera,
            pose: Pose::new(so3::exp(&Vector3::new(0.02, turn, -0.01)) * view.pose.rotation, view.pose.translation),
        };
        let views = vec![view, beside(0.05), beside(-0.07)];
        let other = |k: f32| Level::new(1.0, level.width, level.height, &values(k));
        let levels = vec![level.clone(), other(0.07), other(0.05)];
        (views, levels, samples)
    }

    #[test]
    fn derivatives_agree_with_differences_for_shared_and_own_cameras() {
        let (views, levels, samples) = photos();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let overlap = |photos| Overlap { photos, points: samples.points.clone(), weight: 0.7 };
        let overlaps = [overlap([0, 1]), overlap([1, 0]), overlap([2, 0])];
        let refine = Refine { focal: true, principal: true, distortion: true };
        let mut expected = views[0].camera;
        expected.intrinsics.fx *= 1.01;
        for (rotation, shared) in
            [(RotationName::Lie, true), (RotationName::Quaternion, true), (RotationName::Lie, false)]
        {
            let view_space = || ViewSpace { rotation: rotation.chart(), refine, limits: Limits::default() };
            let spaces = [view_space(), view_space(), view_space()];
            let space = RigSpace { views: &spaces, shared };
            let prior = |weight| Prior { camera: expected, focal_from: FocalSource::Stated, weight };
            let weight = if shared { 0.0 } else { 1e-2 };
            let photos = levels
                .iter()
                .map(|level| PhotoObjective::<f64>::new(&samples, level, &density, &spaces[0], prior(weight)));
            let pairs =
                overlaps.iter().map(|overlap| PairObjective::new(overlap, overlap.photos.map(|photo| &levels[photo])));
            let mut objective = RigObjective {
                space: &space,
                photos: photos.collect(),
                pairs: pairs.collect(),
                prior: shared.then_some(prior(1e-2)),
            };
            let derivatives = objective.derivatives(&views);
            assert_eq!(derivatives.gradient.len(), space.dimension());
            assert_eq!(space.dimension(), if shared { 3 * (rotation.chart().dimension() + 3) + 8 } else { 3 * 14 });
            let curvature = derivatives.curvature.to_dense().unwrap();
            assert!((&curvature - curvature.transpose()).amax() < 1e-9 * curvature.amax());
            assert!(curvature.symmetric_eigenvalues().min() > -1e-9 * curvature.amax());
            let own = space.own();
            for k in 0..space.dimension() {
                // Values of pairs are of single precision: each step moves the picture by a hundredth of a pixel or so.
                let pose = rotation.chart().dimension() + 3;
                let camera = if k < 3 * own { (k % own).checked_sub(pose) } else { Some(k - 3 * own) };
                let reach = match camera {
                    Some(1 | 2) => 1e-2,
                    Some(3..) => 2e-3,
                    _ => 1e-4,
                };
                let mut along = |amount: f64| {
                    let mut step = DVector::zeros(space.dimension());
                    step[k] = amount;
                    objective.value(&space.retract(&views, &step).unwrap()).unwrap()
                };
                let mut central = |h: f64| (along(h) - along(-h)) / (2.0 * h);
                let slope = (4.0 * central(reach) - central(2.0 * reach)) / 3.0;
                let gradient = derivatives.gradient[k];
                let scale = gradient.abs().max(1e-2 * derivatives.gradient.amax());
                assert!(
                    (gradient - slope).abs() < 2e-3 * scale,
                    "{rotation}, {shared}, {k}: {gradient} against {slope}"
                );
            }
        }
    }

    #[test]
    fn all_solvers_keep_a_shared_camera_and_each_distance_within_their_bounds() {
        let (views, levels, samples) = photos();
        let density = Parzen { model_bins: 7, photo_bins: 16 };
        let refine = Refine { focal: true, principal: true, distortion: false };
        let bounds = Bounds { focal: Some([149.95, 150.02]), principal: Some(0.05), distance: Some([2.3999, 2.4002]) };
        let limits = Limits::new(&bounds, refine, &views[0].camera, Vector3::new(0.01, -0.02, 0.0));
        let views: Vec<View> = views.iter().map(|view| limits.held(view)).collect();
        let spaces = [0; 3].map(|_| ViewSpace { rotation: RotationName::Lie.chart(), refine, limits });
        let space = RigSpace { views: &spaces, shared: true };
        let prior = Prior { camera: views[0].camera, focal_from: FocalSource::Stated, weight: 0.0 };
        let overlap = Overlap { photos: [0, 1], points: samples.points.clone(), weight: 0.7 };
        for &solver in SolverName::ALL {
            let photos =
                levels.iter().map(|level| PhotoObjective::<f32>::new(&samples, level, &density, &spaces[0], prior));
            let pair = PairObjective::new(&overlap, [&levels[0], &levels[1]]);
            let mut objective =
                RigObjective { space: &space, photos: photos.collect(), pairs: vec![pair], prior: Some(prior) };
            let report = solver
                .solver::<Vec<View>>(3, 4, 1e-9)
                .maximize(&space, &mut objective, views.clone(), &mut |_| ())
                .unwrap();
            assert!(report.value > report.start, "{solver}");
            for view in &report.point {
                assert_eq!(view.camera, report.point[0].camera, "{solver}");
                let k = &view.camera.intrinsics;
                let off = [k.fx - 150.0 - 0.02, 149.95 - k.fx, (k.cx - 81.0).abs() - 0.05, (k.cy - 58.5).abs() - 0.05];
                assert!(off.iter().all(|off| *off < 1e-9), "{solver}: {k:?}");
                let [least, most] = limits.distance_step(view);
                assert!(least < 1e-9 && most > -1e-9, "{solver}");
            }
            let ends = report.point.iter().filter(|view| limits.reached(view).is_some()).count();
            assert!(ends > 0 || solver == SolverName::StochasticGradient, "{solver}: the bounds are narrow");
        }
    }
}
