//! The one entry point: correspondences and a camera in, a judged pose out.

use crate::frame::Frame;
use crate::global::minima;
use crate::refine::refine_centred;
use crate::{Bearing, Correspondence, NoSolution, Refined, Refinement, Sampling, consensus, refine};
use nalgebra::{Matrix6, Point3};
use texreg_camera::{Camera, View};
use texreg_lie::Pose;

/// What [`pose`] should do.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Correspondences farther than this many pixels from where the pose puts them are rejected; `None` keeps all that
    /// are usable. Four correspondences are always kept: no three can outvote the fourth.
    pub threshold: Option<f64>,
    /// Whether to refine the focal length as well. Focal length and distance are nearly the same thing for shallow objects.
    pub focal: bool,
    /// The search for a consensus, when some must be rejected.
    pub sampling: Sampling,
}

/// A pose and how far to trust it.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The camera (its focal length refined if asked) and the pose, `camera_from_world`.
    pub view: View,
    /// The indices of the correspondences the pose does not rest on.
    pub rejected: Vec<usize>,
    /// The root mean square distance, in pixels, between the kept pixels and where their points are projected.
    pub rms: f64,
    /// The standard deviation of one pixel coordinate as the residuals tell it, √(Σ r² / (2n − 6)), 7 with a focal length.
    pub sigma: f64,
    /// The covariance of the left tangent (ω, t) of the pose, scaled by σ². It knows of random errors of the pixels only.
    pub covariance: Matrix6<f64>,
    /// The relative standard deviation of the focal length, if it was refined.
    pub focal_deviation: Option<f64>,
    /// Another pose that explains the pixels about as well (its rms within twice this one's, or half a pixel), as happens
    /// with few, flat or distant points.
    pub alternative: Option<Pose>,
}

/// The pose with the least reprojection error over the correspondences that agree.
///
/// All correspondences are tried first; if the best pose leaves some beyond the threshold, the largest consensus is sought.
/// Correspondences with numbers that are not finite or pixels the lens cannot show are rejected like outliers.
pub fn pose(correspondences: &[Correspondence], camera: &Camera, options: &Options) -> Result<Solution, NoSolution> {
    let mut usable = Vec::with_capacity(correspondences.len());
    let mut bearings = Vec::with_capacity(correspondences.len());
    for (i, c) in correspondences.iter().enumerate() {
        if let Some(bearing) = c.bearing(camera) {
            usable.push(i);
            bearings.push(bearing);
        }
    }
    let needed = 4;
    if usable.len() < needed {
        let finite = |c: &Correspondence| c.point.iter().chain(c.pixel.iter()).all(|x| x.is_finite());
        return Err(if correspondences.len() >= needed && !correspondences.iter().all(finite) {
            NoSolution::NotFinite
        } else {
            NoSolution::TooFew { usable: usable.len(), needed }
        });
    }
    let keep = |kept: &[usize]| -> Vec<Correspondence> { kept.iter().map(|i| correspondences[*i]).collect() };
    let refinement = Refinement { focal: options.focal, ..Refinement::default() };
    let everyone = solve(&keep(&usable), &bearings, camera, &refinement);
    let threshold = match options.threshold {
        Some(threshold) if usable.len() > needed => threshold,
        _ => return everyone.map(|fit| fit.solution(correspondences.len(), &usable)),
    };
    let agrees = |view: &View, i: usize| {
        let c = &correspondences[i];
        view.project(&c.point).is_some_and(|p| (p - c.pixel).norm() <= threshold)
    };
    if let Ok(fit) = &everyone
        && usable.iter().all(|i| agrees(&fit.best.view, *i))
    {
        return everyone.map(|fit| fit.solution(correspondences.len(), &usable));
    }
    let found = consensus(&bearings, camera, threshold, &options.sampling)?;
    let mut kept: Vec<usize> =
        usable.iter().zip(&found.inliers).filter(|(_, inlier)| **inlier).map(|(i, _)| *i).collect();
    bearings = bearings.into_iter().zip(found.inliers).filter(|(_, inlier)| *inlier).map(|(b, _)| b).collect();
    let mut fit = solve(&keep(&kept), &bearings, camera, &refinement)?;
    // The consensus was found in the undistorted photo; settle who belongs to it in the photo itself.
    for _ in 0..10 {
        let now: Vec<usize> = usable.iter().copied().filter(|i| agrees(&fit.best.view, *i)).collect();
        if now == kept || now.len() < needed {
            break;
        }
        kept = now;
        fit.best = refine(&keep(&kept), &fit.best.view, &refinement)?;
    }
    Ok(fit.solution(correspondences.len(), &kept))
}

/// A refined pose and its rival.
struct Fit {
    best: Refined,
    alternative: Option<Pose>,
}

impl Fit {
    fn solution(self, total: usize, kept: &[usize]) -> Solution {
        let Fit { best, alternative } = self;
        let parameters = if best.focal_variance.is_some() { 7.0 } else { 6.0 };
        let count = kept.len() as f64;
        let variance = best.cost / (2.0 * count - parameters).max(1.0);
        Solution {
            view: best.view,
            rejected: (0..total).filter(|i| kept.binary_search(i).is_err()).collect(),
            rms: (best.cost / count).sqrt(),
            sigma: variance.sqrt(),
            covariance: best.covariance * variance,
            focal_deviation: best.focal_variance.map(|v| (v * variance).sqrt()),
            alternative,
        }
    }
}

/// The global minimum of the reprojection error: every minimum of the depth-weighted error, refined.
fn solve(
    correspondences: &[Correspondence],
    bearings: &[Bearing],
    camera: &Camera,
    refinement: &Refinement,
) -> Result<Fit, NoSolution> {
    let frame = Frame::new(correspondences.iter().map(|c| c.point.coords))?;
    let inner: Vec<Correspondence> = correspondences
        .iter()
        .map(|c| Correspondence::new(Point3::from(frame.enter(&c.point.coords)), c.pixel))
        .collect();
    let starts = minima(inner.iter().zip(bearings).map(|(c, b)| Bearing { point: c.point.coords, image: b.image }))?;
    let mut fits: Vec<Refined> = Vec::new();
    // Whatever may turn out the best, or an alternative to it. The error is in image coordinates times depth.
    let half_pixel = starts[0].map_or(0.0, |m| 0.5 * m.pose.translation.z / camera.intrinsics.fy);
    let least = starts[0].map_or(0.0, |m| m.error).max(half_pixel * half_pixel * inner.len() as f64);
    for start in starts.into_iter().flatten().filter(|m| m.error <= 16.0 * least) {
        let view = View { camera: *camera, pose: start.pose };
        fits.extend(refine_centred(&inner, &view, refinement));
    }
    fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let best = *fits.first().ok_or(NoSolution::BehindCamera)?;
    let alternative = fits[1..]
        .iter()
        .find(|f| (f.view.pose.rotation.matrix() - best.view.pose.rotation.matrix()).norm() > 1e-3)
        .filter(|f| f.cost <= (4.0 * best.cost).max(0.25 * inner.len() as f64))
        .map(|f| frame.leave(&f.view.pose));
    Ok(Fit { best: best.leave(&frame), alternative })
}
