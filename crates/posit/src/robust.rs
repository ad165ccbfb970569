//! Poses from correspondences of which some are wrong: LO-RANSAC.
//!
//! Poses of three points are scored by the truncated squared reprojection error over all points (MSAC, P. H. S. Torr &
//! A. Zisserman, *MLESAC*, 2000); each new best is refined on that same error before it has to beat the next (O. Chum,
//! J. Matas & J. Kittler, *Locally Optimized RANSAC*, DAGM 2003; K. Lebeda, J. Matas & O. Chum, *Fixing the Locally Optimized
//! RANSAC*, BMVC 2012). While there are few triples, all of them are tried; otherwise random ones, the same every time,
//! until a better pose would have been found with the asked confidence.
//!
//! The σ-marginalized loss of MAGSAC++ (D. Barath et al., CVPR 2020) was tried as the score: the same poses from twenty
//! points on, but worse ones at ten, where it prizes the exact fit of three points over the fair fit of five.

use crate::frame::Frame;
use crate::random::Random;
use crate::refine::refine_centred;
use crate::{Bearing, Correspondence, NoSolution, Refinement, p3p};
use nalgebra::{Matrix3, Point3};
use texreg_camera::{Camera, Distortion, View};
use texreg_lie::Pose;

/// How long to look.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Triples tried at least, if there are as many.
    pub least: usize,
    /// Triples tried at most.
    pub most: usize,
    /// Probability that a better pose would have been found.
    pub confidence: f64,
    /// Of the random numbers.
    pub seed: u64,
}

impl Default for Sampling {
    fn default() -> Self {
        Self { least: 50, most: 10_000, confidence: 0.9999, seed: 0 }
    }
}

/// The best pose and who agrees with it.
#[derive(Clone, Debug, PartialEq)]
pub struct Consensus {
    /// `camera_from_world`.
    pub pose: Pose,
    /// One a bearing: whether it lies within the threshold.
    pub inliers: Vec<bool>,
    /// The sum of squared residuals, each at most the threshold's square, px².
    pub score: f64,
    /// Triples tried.
    pub samples: usize,
}

/// The pose that most of the bearings agree with to within `threshold` pixels of an undistorted photo with this camera's
/// intrinsics.
pub fn consensus(
    bearings: &[Bearing],
    camera: &Camera,
    threshold: f64,
    sampling: &Sampling,
) -> Result<Consensus, NoSolution> {
    let n = bearings.len();
    if n < 4 {
        return Err(NoSolution::TooFew { usable: n, needed: 4 });
    }
    let frame = Frame::new(bearings.iter().map(|b| b.point))?;
    let inner: Vec<Bearing> =
        bearings.iter().map(|b| Bearing { point: frame.enter(&b.point), image: b.image }).collect();
    let search = Search::new(&inner, camera, threshold);
    let triples = n * (n - 1) * (n - 2) / 6;
    let mut best = Best { pose: Pose::identity(), score: f64::INFINITY };
    let mut samples = 0;
    let exhaustive = triples <= sampling.least.max(120);
    let mut all = every_triple(n);
    let mut random = Random::new(sampling.seed);
    let mut enough = if exhaustive { triples } else { sampling.most };
    while samples < enough {
        samples += 1;
        let triple = if exhaustive { all.next() } else { None }.unwrap_or_else(|| random.triple(n));
        for pose in p3p(&triple.map(|i| inner[i])) {
            let score = search.score(&pose, best.score);
            if score < best.score {
                best = search.polish(pose, score);
                if !exhaustive {
                    let inliers = search.inliers(&best.pose).filter(|i| *i).count();
                    enough = needed(inliers, n, sampling);
                }
            }
        }
    }
    let inliers: Vec<bool> = search.inliers(&best.pose).collect();
    if inliers.iter().filter(|i| **i).count() < 4 {
        return Err(NoSolution::NoConsensus);
    }
    Ok(Consensus { pose: frame.leave(&best.pose), inliers, score: best.score, samples })
}

/// Samples after which one of three inliers has been drawn with the asked confidence.
fn needed(inliers: usize, n: usize, sampling: &Sampling) -> usize {
    let all_good = (0..3).map(|i| inliers.saturating_sub(i) as f64 / (n - i) as f64).product::<f64>();
    let samples = (1.0 - sampling.confidence).ln() / (-all_good).ln_1p();
    (samples.ceil() as usize).clamp(sampling.least, sampling.most)
}

/// Every three indices below n.
fn every_triple(n: usize) -> impl Iterator<Item = [usize; 3]> {
    (0..n).flat_map(move |a| (a + 1..n).flat_map(move |b| (b + 1..n).map(move |c| [a, b, c])))
}

struct Best {
    pose: Pose,
    score: f64,
}

/// The data in the shape the scoring loop wants it.
struct Search {
    /// The points and their pixels in the undistorted photo.
    correspondences: Vec<Correspondence>,
    camera: Camera,
    threshold: f64,
    focal: Matrix3<f64>,
}

impl Search {
    fn new(bearings: &[Bearing], camera: &Camera, threshold: f64) -> Self {
        let camera = Camera { distortion: Distortion::default(), ..*camera };
        let pixel = |b: &Bearing| camera.intrinsics.apply(&b.image);
        let correspondences = bearings.iter().map(|b| Correspondence::new(Point3::from(b.point), pixel(b))).collect();
        Self { correspondences, camera, threshold, focal: camera.intrinsics.matrix() }
    }

    /// The truncated error of a pose, given up once it exceeds the best.
    fn score(&self, pose: &Pose, best: f64) -> f64 {
        let rotation = self.focal * pose.rotation.matrix();
        let translation = self.focal * pose.translation;
        let limit = self.threshold * self.threshold;
        let mut score = 0.0;
        for block in self.correspondences.chunks(16) {
            for Correspondence { point, pixel } in block {
                let p = rotation * point.coords + translation;
                let inverse = 1.0 / p.z;
                let (du, dv) = (p.x * inverse - pixel.x, p.y * inverse - pixel.y);
                let square = du * du + dv * dv;
                score += if p.z > 0.0 && square < limit { square } else { limit };
            }
            if score >= best {
                break;
            }
        }
        score
    }

    /// The pose refined on the truncated error.
    fn polish(&self, pose: Pose, score: f64) -> Best {
        let options = Refinement { truncation: Some(self.threshold), iterations: 10, ..Refinement::default() };
        match refine_centred(&self.correspondences, &View { camera: self.camera, pose }, &options) {
            Some(refined) if refined.cost < score => Best { pose: refined.view.pose, score: refined.cost },
            _ => Best { pose, score },
        }
    }

    fn inliers(&self, pose: &Pose) -> impl Iterator<Item = bool> {
        let view = View { camera: self.camera, pose: *pose };
        self.correspondences
            .iter()
            .map(move |c| view.project(&c.point).is_some_and(|p| (p - c.pixel).norm() < self.threshold))
    }
}
