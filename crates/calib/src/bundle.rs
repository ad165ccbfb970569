//! All photos together: the reprojection error over the camera and every board's pose, by Levenberg–Marquardt on normal equations
//! in the shape of an arrow: the poses' blocks, and the camera that they share. A pose is stepped by `R' = exp(ω) R`, `T' = T + t`
//! about the middle of its corners.

use crate::model::{PARAMETERS, from_array, to_array};
use nalgebra::{DMatrix, DVector, Matrix6, Point2, Point3, SMatrix, Vector2, Vector3};
use texreg_camera::Camera;
use texreg_lie::{Pose, so3};
use texreg_optim::{
    Accumulator, Curvature, LeastSquares, LevenbergMarquardt, Loss, Manifold, MinusCost, Objective, Solver,
};

/// A board's corners: in its own frame, and their pixels.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    points: Vec<Vector3<f64>>,
    pixels: Vec<Point2<f64>>,
    middle: Vector3<f64>,
}

impl Shot {
    pub(crate) fn new(pairs: impl Iterator<Item = (Point3<f64>, Point2<f64>)>) -> Self {
        let (points, pixels): (Vec<_>, Vec<_>) = pairs.unzip();
        let middle = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords) / points.len().max(1) as f64;
        Self { points: points.iter().map(|p| p.coords - middle).collect(), pixels, middle }
    }

    /// The number of corners.
    pub(crate) fn len(&self) -> usize {
        self.pixels.len()
    }

    /// From the pose of the board to that of the frame in the middle of its corners.
    pub(crate) fn enter(&self, pose: &Pose) -> Pose {
        Pose::new(pose.rotation, pose.rotation * self.middle + pose.translation)
    }

    /// The inverse of [`enter`](Self::enter).
    pub(crate) fn leave(&self, pose: &Pose) -> Pose {
        Pose::new(pose.rotation, pose.translation - pose.rotation * self.middle)
    }

    /// Seen minus predicted, pixels; `None` if the camera sees some corner nowhere.
    pub(crate) fn residuals(&self, camera: &Camera, pose: &Pose) -> Option<Vec<Vector2<f64>>> {
        let seen = self
            .points
            .iter()
            .zip(&self.pixels)
            .map(|(p, pixel)| Some(pixel - camera.project(&Point3::from(pose.rotation * p + pose.translation))?));
        seen.collect()
    }

    /// The sum of squared residuals.
    pub(crate) fn cost(&self, camera: &Camera, pose: &Pose) -> Option<f64> {
        Some(self.residuals(camera, pose)?.iter().map(Vector2::norm_squared).sum())
    }
}

/// A camera and the poses (of [`Shot`]s' middles) that minimize the error.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    pub(crate) camera: Camera,
    pub(crate) poses: Vec<Pose>,
    /// The sum of squared residuals, px².
    pub(crate) cost: f64,
}

/// The covariances of a fit for residuals of unit variance.
pub(crate) struct Covariances {
    /// Of the camera's parameters; what was not fitted says nothing.
    pub(crate) camera: DMatrix<f64>,
    /// Of each pose's (ω, t) about the middle of its corners, the camera marginalized.
    pub(crate) poses: Vec<Matrix6<f64>>,
}

/// The most steps tried, and the gain a corner, px², below which no more are.
const STEPS: usize = 100;
const GAIN: f64 = 1e-12;

/// Minimizes the error over the camera's parameters with these indices, and the poses; `None` if the start sees some corner nowhere.
pub(crate) fn fit(shots: &[Shot], start: &Camera, poses: &[Pose], parameters: &[usize]) -> Option<Fit> {
    let boards = Boards { shots, parameters };
    let corners: usize = shots.iter().map(Shot::len).sum();
    let solver = LevenbergMarquardt { iterations: STEPS, damping: 1e-4, gain_tolerance: GAIN * corners as f64 };
    let start = (*start, poses.to_vec());
    let report = solver.maximize(&boards, &mut boards.objective(), start, &mut |_| ())?;
    let (camera, poses) = report.point;
    Some(Fit { camera, poses, cost: -2.0 * report.value })
}

/// The covariances at a fit; `None` where something is not determined.
pub(crate) fn covariances(shots: &[Shot], fit: &Fit, parameters: &[usize]) -> Option<Covariances> {
    let at = (fit.camera, fit.poses.clone());
    let Curvature::Arrow(arrow) = (Boards { shots, parameters }).objective().derivatives(&at).curvature else {
        return None;
    };
    let inverse = arrow.inverse()?;
    let poses = inverse.own.iter().map(|own| own.fixed_view::<6, 6>(0, 0).into_owned());
    Some(Covariances { camera: inverse.shared, poses: poses.collect() })
}

/// The problem: a step has the poses' components, and then all of the camera's; those that are not fitted have no influence.
#[derive(Clone, Copy)]
struct Boards<'a> {
    shots: &'a [Shot],
    parameters: &'a [usize],
}

impl Boards<'_> {
    fn objective(&self) -> MinusCost<Self> {
        MinusCost { problem: *self, loss: Loss::Squared, own: vec![6; self.shots.len()], shared: PARAMETERS }
    }
}

impl Manifold<(Camera, Vec<Pose>)> for Boards<'_> {
    fn dimension(&self) -> usize {
        6 * self.shots.len() + PARAMETERS
    }

    /// Focal lengths stay positive.
    fn retract(&self, (camera, poses): &(Camera, Vec<Pose>), step: &DVector<f64>) -> Option<(Camera, Vec<Pose>)> {
        let moved = |(i, pose): (usize, &Pose)| {
            let (omega, t) = (step.fixed_rows::<3>(6 * i).into_owned(), step.fixed_rows::<3>(6 * i + 3));
            Pose::new(so3::exp(&omega) * pose.rotation, pose.translation + t)
        };
        let mut values = to_array(camera);
        self.parameters.iter().for_each(|&k| values[k] += step[6 * poses.len() + k]);
        (values[0] > 0.0 && values[1] > 0.0)
            .then(|| (from_array(camera, &values), poses.iter().enumerate().map(moved).collect()))
    }
}

impl LeastSquares<(Camera, Vec<Pose>)> for Boards<'_> {
    fn residuals(&self, (camera, poses): &(Camera, Vec<Pose>), into: &mut Accumulator) -> Option<()> {
        for (arm, (shot, pose)) in self.shots.iter().zip(poses).enumerate() {
            for (point, pixel) in shot.points.iter().zip(&shot.pixels) {
                let turned = pose.rotation * point;
                let seen = camera.project_with_jacobians(&Point3::from(turned + pose.translation))?;
                into.add_arm(arm, &(seen.pixel - pixel), || {
                    let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
                    by_pose.fixed_columns_mut::<3>(0).copy_from(&(-seen.point * so3::hat(&turned)));
                    by_pose.fixed_columns_mut::<3>(3).copy_from(&seen.point);
                    let mut by_camera = SMatrix::<f64, 2, PARAMETERS>::zeros();
                    for &k in self.parameters {
                        let all = if k < 5 { seen.intrinsics.column(k) } else { seen.distortion.column(k - 5) };
                        by_camera.set_column(k, &all);
                    }
                    (by_pose, by_camera)
                });
            }
        }
        Some(())
    }
}
