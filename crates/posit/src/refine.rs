//! Refinement of a pose on the reprojection error, `Σ ‖π(K, C, R X + T) − u‖²`, by Levenberg–Marquardt
//! (D. W. Marquardt, 1963), optionally with the focal length and with outliers cut off.
//!
//! The rotation is stepped about the centroid of the points, `R' = exp(ω) R`, the translation is that of the centroid and
//! the focal lengths share one factor, `f' = f exp(s)`: in these coordinates the unknowns hardly depend on each other,
//! however far the object. Every step keeps the points in front of the camera, and the error falls with every step taken.

use crate::frame::Frame;
use crate::normal::Normal;
use crate::{Correspondence, NoSolution};
use nalgebra::{Matrix6, Point3, SVector, Vector3};
use texreg_camera::{Camera, View};
use texreg_lie::{Pose, so3};

/// How to refine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// Whether the focal length is refined too, fx and fy in step.
    pub focal: bool,
    /// Residuals beyond this many pixels count as much as one of this length, and pull no more.
    pub truncation: Option<f64>,
    /// Steps tried before giving up on convergence.
    pub iterations: usize,
}

impl Default for Refinement {
    fn default() -> Self {
        Self { focal: false, truncation: None, iterations: 30 }
    }
}

/// A refined view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refined {
    /// Camera and pose; the camera differs from the given one in its focal lengths only.
    pub view: View,
    /// The sum of squared (truncated) residuals, px².
    pub cost: f64,
    /// The covariance of the left tangent (ω, t) of the pose for residuals of unit variance: the inverse of JᵀJ over the
    /// points within the truncation, focal length marginalized. Infinite where the points leave a direction undetermined.
    pub covariance: Matrix6<f64>,
    /// The variance of ln f for residuals of unit variance, if it was refined.
    pub focal_variance: Option<f64>,
    /// Steps tried.
    pub iterations: usize,
}

/// Refines a view whose points are all in front of its camera and within its lens; otherwise [`NoSolution::BehindCamera`].
/// With a truncation, points that are not count as outliers.
pub fn refine(correspondences: &[Correspondence], view: &View, options: &Refinement) -> Result<Refined, NoSolution> {
    let needed = if options.focal { 4 } else { 3 };
    if correspondences.len() < needed {
        return Err(NoSolution::TooFew { usable: correspondences.len(), needed });
    }
    let frame = Frame::new(correspondences.iter().map(|c| c.point.coords))?;
    let inner: Vec<Correspondence> = correspondences
        .iter()
        .map(|c| Correspondence::new(Point3::from(frame.enter(&c.point.coords)), c.pixel))
        .collect();
    let start = View { camera: view.camera, pose: frame.adopt(&view.pose) };
    let refined = refine_centred(&inner, &start, options).ok_or(NoSolution::BehindCamera)?;
    Ok(refined.leave(&frame))
}

/// [`refine`] for points that are centred on the origin and of order one.
pub(crate) fn refine_centred(
    correspondences: &[Correspondence],
    start: &View,
    options: &Refinement,
) -> Option<Refined> {
    if options.focal {
        descend::<7>(correspondences, start, options)
    } else {
        descend::<6>(correspondences, start, options)
    }
}

/// Levenberg–Marquardt over (ω, t) and, for N = 7, s.
fn descend<const N: usize>(correspondences: &[Correspondence], start: &View, options: &Refinement) -> Option<Refined> {
    let truncation = options.truncation.map_or(f64::INFINITY, |t| t * t);
    let mut view = *start;
    let (mut cost, mut normal) = linearize::<N>(correspondences, &view, truncation)?;
    let mut damping = 1e-4;
    let mut iterations = 0;
    while iterations < options.iterations {
        iterations += 1;
        let Some(step) = normal.step(damping) else {
            damping *= 10.0;
            continue;
        };
        let size = step.fixed_rows::<3>(0).norm_squared()
            + step.fixed_rows::<3>(3).norm_squared() / view.pose.translation.norm_squared();
        let next = moved(&view, &step);
        let Some((next_cost, next_normal)) = linearize::<N>(correspondences, &next, truncation) else {
            damping *= 10.0;
            continue;
        };
        if next_cost <= cost {
            // What is left to gain is a small part of this gain; residuals of 1e-11 px are rounding.
            let settled = cost - next_cost <= 1e-10 * cost || next_cost <= 1e-22 * correspondences.len() as f64;
            (view, cost, normal) = (next, next_cost, next_normal);
            damping = (0.1 * damping).max(1e-12);
            if settled || size < 1e-28 {
                break;
            }
        } else {
            if size < 1e-20 {
                break;
            }
            damping *= 10.0;
        }
    }
    let (covariance, focal_variance) = covariance(&normal, &view.pose);
    Some(Refined { view, cost, covariance, focal_variance, iterations })
}

/// The cost and the normal equations; `None` where a point is not seen.
fn linearize<const N: usize>(
    correspondences: &[Correspondence],
    view: &View,
    truncation: f64,
) -> Option<(f64, Normal<N>)> {
    let mut normal = Normal::new();
    let mut cost = 0.0;
    for Correspondence { point, pixel } in correspondences {
        let turned = view.pose.rotation * point.coords;
        let seen = view.camera.project_with_jacobian(&Point3::from(turned + view.pose.translation));
        let Some((projected, jacobian)) = seen else {
            if truncation.is_infinite() {
                return None;
            }
            cost += truncation;
            continue;
        };
        let residual = projected - pixel;
        let square = residual.norm_squared();
        if square > truncation {
            cost += truncation;
            continue;
        }
        cost += square;
        let row = |r: usize| {
            let g = Vector3::new(jacobian[(r, 0)], jacobian[(r, 1)], jacobian[(r, 2)]);
            let turn = turned.cross(&g);
            let mut row = [0.0; N];
            row[..3].copy_from_slice(turn.as_slice());
            row[3..6].copy_from_slice(g.as_slice());
            if N == 7 {
                let center = [view.camera.intrinsics.cx, view.camera.intrinsics.cy];
                row[6] = projected[r] - center[r];
            }
            row
        };
        normal.add([&row(0), &row(1)], [residual.x, residual.y]);
    }
    cost.is_finite().then_some((cost, normal))
}

/// The view after a step.
fn moved<const N: usize>(view: &View, step: &SVector<f64, N>) -> View {
    let rotation = so3::exp(&Vector3::new(step[0], step[1], step[2])) * view.pose.rotation;
    let translation = view.pose.translation + Vector3::new(step[3], step[4], step[5]);
    let mut camera = view.camera;
    if N == 7 {
        scale_focal(&mut camera, step[6].exp());
    }
    View { camera, pose: Pose::new(rotation, translation) }
}

/// Multiplies what is linear in the focal length.
fn scale_focal(camera: &mut Camera, factor: f64) {
    camera.intrinsics.fx *= factor;
    camera.intrinsics.fy *= factor;
    camera.intrinsics.skew *= factor;
}

/// The inverse of the normal matrix, its pose part carried to the left tangent of the pose in the points' frame.
fn covariance<const N: usize>(normal: &Normal<N>, pose: &Pose) -> (Matrix6<f64>, Option<f64>) {
    let Some(factor) = normal.factor(0.0) else {
        return (Matrix6::from_diagonal_element(f64::INFINITY), (N == 7).then_some(f64::INFINITY));
    };
    let inverse = factor.inverse();
    // A turn ω about the centroid c and its translation t are a turn about the origin and t − ω × c = t + [c]× ω.
    let mut carry = Matrix6::identity();
    carry.fixed_view_mut::<3, 3>(3, 0).copy_from(&so3::hat(&pose.translation));
    let covariance = carry * inverse.fixed_view::<6, 6>(0, 0) * carry.transpose();
    (covariance, (N == 7).then(|| inverse[(6, 6)]))
}

impl Refined {
    /// From the points' frame to the world.
    pub(crate) fn leave(&self, frame: &Frame) -> Self {
        let mut scale = Matrix6::identity();
        for i in 3..6 {
            scale[(i, i)] = frame.scale();
        }
        let view = View { camera: self.view.camera, pose: frame.leave(&self.view.pose) };
        Self { view, covariance: scale * self.covariance * scale, ..*self }
    }
}
