//! All photos together: Levenberg–Marquardt on the reprojection error over the camera and every board's pose.
//!
//! The normal equations have the shape of an arrow: with A of the camera's parameters, Cᵢ of pose i and Bᵢ between them,
//!
//! ```text
//! | A   B₁ … Bₙ |            S = A − Σ Bᵢ Cᵢ⁻¹ Bᵢᵀ       (Schur's complement)
//! | B₁ᵀ C₁      | step = g   S a = g − Σ Bᵢ Cᵢ⁻¹ gᵢ
//! | …       …   |            cᵢ = Cᵢ⁻¹ (gᵢ − Bᵢᵀ a)
//! | Bₙᵀ      Cₙ |
//! ```
//!
//! so a step costs n small factorizations, and S⁻¹ is the covariance of the camera with the poses marginalized
//! (B. Triggs et al., *Bundle adjustment: a modern synthesis*, 1999). A pose is stepped by `R' = exp(ω) R`, `T' = T + t`
//! about the middle of its corners.

use crate::model::{PARAMETERS, from_array, to_array};
use nalgebra::{DMatrix, DVector, Matrix6, Point2, Point3, SMatrix, Vector2, Vector3, Vector6};
use texreg_camera::Camera;
use texreg_lie::{Pose, so3};

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

/// The covariances of a fit for residuals of unit variance; `None` where something is not determined.
pub(crate) struct Covariances {
    /// Of the camera's parameters that were fitted.
    pub(crate) camera: DMatrix<f64>,
    /// Of each pose's (ω, t) about the middle of its corners, the camera marginalized.
    pub(crate) poses: Vec<Matrix6<f64>>,
}

/// The blocks of a shot.
struct Arm {
    cost: f64,
    camera: SMatrix<f64, PARAMETERS, PARAMETERS>,
    between: SMatrix<f64, PARAMETERS, 6>,
    pose: Matrix6<f64>,
    camera_gradient: SMatrix<f64, PARAMETERS, 1>,
    pose_gradient: Vector6<f64>,
}

/// The most steps tried.
const STEPS: usize = 100;

/// Minimizes the error over the camera's parameters with these indices, and the poses; `None` if the start sees some corner nowhere.
pub(crate) fn fit(shots: &[Shot], start: &Camera, poses: &[Pose], parameters: &[usize]) -> Option<Fit> {
    let mut at = Fit { camera: *start, poses: poses.to_vec(), cost: 0.0 };
    let mut arms = linearize(shots, &at)?;
    at.cost = arms.iter().map(|arm| arm.cost).sum();
    let mut damping = 1e-4;
    for _ in 0..STEPS {
        let Some((camera_step, pose_steps)) = step(&arms, parameters, damping) else {
            damping *= 10.0;
            if damping > 1e10 {
                break;
            }
            continue;
        };
        let mut values = to_array(&at.camera);
        for (i, step) in parameters.iter().zip(camera_step.iter()) {
            values[*i] += step;
        }
        let mut next = Fit { camera: from_array(&at.camera, &values), poses: at.poses.clone(), cost: 0.0 };
        for (pose, step) in next.poses.iter_mut().zip(&pose_steps) {
            let (omega, t) = (step.fixed_rows::<3>(0).into_owned(), step.fixed_rows::<3>(3).into_owned());
            *pose = Pose::new(so3::exp(&omega) * pose.rotation, pose.translation + t);
        }
        let trial = linearize(shots, &next);
        let cost = trial.as_ref().map_or(f64::INFINITY, |arms| arms.iter().map(|arm| arm.cost).sum());
        let is_focal_fine = next.camera.intrinsics.fx > 0.0 && next.camera.intrinsics.fy > 0.0;
        match trial.filter(|_| cost < at.cost && is_focal_fine) {
            Some(trial) => {
                let settled = at.cost - cost <= 1e-10 * at.cost;
                next.cost = cost;
                (at, arms) = (next, trial);
                damping = (0.1 * damping).max(1e-12);
                if settled {
                    break;
                }
            }
            None => {
                damping *= 10.0;
                if damping > 1e10 {
                    break;
                }
            }
        }
    }
    Some(at)
}

/// The covariances at a fit.
pub(crate) fn covariances(shots: &[Shot], fit: &Fit, parameters: &[usize]) -> Option<Covariances> {
    let arms = linearize(shots, fit)?;
    let (schur, _) = reduced(&arms, parameters, 0.0)?;
    // Scaled to a unit diagonal: focal lengths and k3 are orders of magnitude apart.
    let scale = schur.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
    let unit = DMatrix::from_fn(schur.nrows(), schur.ncols(), |i, j| schur[(i, j)] * scale[i] * scale[j]);
    let inverse = unit.cholesky()?.inverse();
    let camera = DMatrix::from_fn(inverse.nrows(), inverse.ncols(), |i, j| inverse[(i, j)] * scale[i] * scale[j]);
    let poses = arms.iter().map(|arm| {
        let inverse = arm.pose.cholesky()?.inverse();
        let gain = inverse * rows(&arm.between, parameters).transpose();
        let spread = &gain * &camera * gain.transpose();
        Some(inverse + spread.fixed_view::<6, 6>(0, 0))
    });
    Some(Covariances { poses: poses.collect::<Option<_>>()?, camera })
}

/// The rows of a block that are fitted.
fn rows<const C: usize>(block: &SMatrix<f64, PARAMETERS, C>, parameters: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(parameters.len(), C, |i, j| block[(parameters[i], j)])
}

/// S and its right-hand side, with the diagonals of A and C multiplied by 1 + damping.
fn reduced(arms: &[Arm], parameters: &[usize], damping: f64) -> Option<(DMatrix<f64>, DVector<f64>)> {
    let n = parameters.len();
    let mut schur = DMatrix::zeros(n, n);
    let mut right = DVector::zeros(n);
    for arm in arms {
        schur += DMatrix::from_fn(n, n, |i, j| arm.camera[(parameters[i], parameters[j])]);
        right += rows(&arm.camera_gradient, parameters).column(0);
    }
    for i in 0..n {
        schur[(i, i)] *= 1.0 + damping;
    }
    for arm in arms {
        let factor = damped(&arm.pose, damping).cholesky()?;
        let between = rows(&arm.between, parameters);
        let solved = factor.solve(&arm.pose_gradient);
        right -= &between * solved;
        let inverse = factor.inverse();
        schur -= &between * inverse * between.transpose();
    }
    Some((schur, right))
}

fn damped(block: &Matrix6<f64>, damping: f64) -> Matrix6<f64> {
    let mut block = *block;
    for i in 0..6 {
        block[(i, i)] *= 1.0 + damping;
    }
    block
}

/// The damped Gauss–Newton step.
fn step(arms: &[Arm], parameters: &[usize], damping: f64) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
    let (schur, right) = reduced(arms, parameters, damping)?;
    let scale = schur.diagonal().map(|d| 1.0 / d.max(f64::MIN_POSITIVE).sqrt());
    let unit = DMatrix::from_fn(schur.nrows(), schur.ncols(), |i, j| schur[(i, j)] * scale[i] * scale[j]);
    let camera = unit.cholesky()?.solve(&right.component_mul(&scale)).component_mul(&scale);
    let poses = arms.iter().map(|arm| {
        let rest = arm.pose_gradient - (rows(&arm.between, parameters).transpose() * &camera).fixed_rows::<6>(0);
        Some(damped(&arm.pose, damping).cholesky()?.solve(&rest))
    });
    let poses = poses.collect::<Option<Vec<_>>>()?;
    camera.iter().all(|x| x.is_finite()).then_some((camera, poses))
}

/// The blocks of every shot; `None` where a corner is seen nowhere.
fn linearize(shots: &[Shot], fit: &Fit) -> Option<Vec<Arm>> {
    shots.iter().zip(&fit.poses).map(|(shot, pose)| arm(shot, &fit.camera, pose)).collect()
}

fn arm(shot: &Shot, camera: &Camera, pose: &Pose) -> Option<Arm> {
    const N: usize = PARAMETERS + 6;
    let mut hessian = [[0.0; N]; N];
    let mut gradient = [0.0; N];
    let mut cost = 0.0;
    for (point, pixel) in shot.points.iter().zip(&shot.pixels) {
        let turned = pose.rotation * point;
        let seen = camera.project_with_jacobians(&Point3::from(turned + pose.translation))?;
        let residual = pixel - seen.pixel;
        cost += residual.norm_squared();
        let row = |r: usize| {
            let g = Vector3::new(seen.point[(r, 0)], seen.point[(r, 1)], seen.point[(r, 2)]);
            let turn = turned.cross(&g);
            let (k, c) = (&seen.intrinsics, &seen.distortion);
            let mut row = [0.0; N];
            for i in 0..5 {
                row[i] = k[(r, i)];
                row[5 + i] = c[(r, i)];
            }
            row[PARAMETERS..PARAMETERS + 3].copy_from_slice(turn.as_slice());
            row[PARAMETERS + 3..].copy_from_slice(g.as_slice());
            row
        };
        let (a, b) = (row(0), row(1));
        for i in 0..N {
            for j in 0..N {
                hessian[i][j] += a[i] * a[j] + b[i] * b[j];
            }
            gradient[i] += a[i] * residual.x + b[i] * residual.y;
        }
    }
    cost.is_finite().then(|| Arm {
        cost,
        camera: SMatrix::from_fn(|i, j| hessian[i][j]),
        between: SMatrix::from_fn(|i, j| hessian[i][PARAMETERS + j]),
        pose: Matrix6::from_fn(|i, j| hessian[PARAMETERS + i][PARAMETERS + j]),
        camera_gradient: SMatrix::from_fn(|i, _| gradient[i]),
        pose_gradient: Vector6::from_fn(|i, _| gradient[PARAMETERS + i]),
    })
}
