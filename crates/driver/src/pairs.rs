//! Cameras from clicked pairs: the pose, and which of the pairs to doubt.

use nalgebra::Point2;
use texreg_camera::{Camera, View};
use texreg_posit::{self as posit, Correspondence, NoSolution, Options, Solution};

/// The fewest pairs that make a pose.
pub const FEWEST_PAIRS: usize = 4;

/// A pair farther from where the pose puts it than this share of the photo's diagonal is left out.
const ASTRAY: f64 = 0.02;

/// From this many pairs on a focal length can be told from them, and a pair be judged by the others.
const TELLING: usize = 6;

/// With more pairs than this, one that is wrong no longer draws the pose to itself.
const MANY: usize = 40;

/// A pair is suspicious if it is off by this many times what the others are off by, and by this share of the diagonal.
const SUSPICIOUS: (f64, f64) = (4.0, 0.003);

/// Focal lengths to begin with where none is known, over the longer side of the photo: from wide angle to telephoto.
const FOCALS: [f64; 5] = [0.7, 1.0, 1.5, 2.5, 4.5];

/// The pose with the least reprojection error over the pairs that agree.
///
/// # Errors
/// If fewer than four pairs are usable, or no pose explains them.
pub fn pose_from_pairs(pairs: &[Correspondence], camera: &Camera) -> Result<Solution, NoSolution> {
    posit::pose(pairs, camera, &Options { threshold: Some(ASTRAY * diagonal(camera)), ..Options::default() })
}

/// The pose, and the focal length where there are six pairs or more, for a photo of which no focal length is known. With fewer
/// pairs the focal length is half as long again as the photo's longer side.
///
/// # Errors
/// As [`pose_from_pairs`].
pub fn pose_and_focal_from_pairs(pairs: &[Correspondence], [width, height]: [u32; 2]) -> Result<Solution, NoSolution> {
    let guess = |share: f64| Camera::ideal(width, height, share * f64::from(width.max(height)));
    if pairs.len() < TELLING {
        return pose_from_pairs(pairs, &guess(FOCALS[2]));
    }
    let solve = |share: f64| {
        let camera = guess(share);
        let options = Options { threshold: Some(ASTRAY * diagonal(&camera)), focal: true, ..Options::default() };
        posit::pose(pairs, &camera, &options)
    };
    let likely = |focal: f64| (0.4..=8.0).contains(&(focal / f64::from(width.max(height))));
    let found = FOCALS.into_iter().filter_map(|share| solve(share).ok());
    let found = found.filter(|solution| likely(solution.view.camera.intrinsics.fx));
    let best = found.min_by(|a, b| {
        let worth = |s: &Solution| (s.rejected.len(), s.rms);
        worth(a).partial_cmp(&worth(b)).unwrap_or(std::cmp::Ordering::Equal)
    });
    best.map_or_else(|| pose_from_pairs(pairs, &guess(FOCALS[2])), Ok)
}

/// How a pair goes with a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairFit {
    /// Where the camera puts the pair's point, if it has a pixel.
    pub predicted: Option<Point2<f64>>,
    /// Its distance from the pair's pixel; infinite without a prediction.
    pub residual: f64,
    /// Whether the pair does not go with the others.
    pub suspicious: bool,
}

/// How each pair goes with a view, and with the others.
///
/// A wrong pair draws the pose to itself and hides its residual. So where there are six pairs or more, each is judged by the
/// pose of the others: its distance from where that one puts it, over what the others are off by (the deleted residual of
/// R. D. Cook and S. Weisberg, *Residuals and Influence in Regression*, 1982). Those that are `left_out` already, by their index,
/// are suspicious and judge nobody.
pub fn fit_of_pairs(pairs: &[Correspondence], view: &View, left_out: &[usize]) -> Vec<PairFit> {
    let diagonal = diagonal(&view.camera);
    let off = |view: &View, pair: &Correspondence| {
        view.project(&pair.point).map_or(f64::INFINITY, |pixel| (pixel - pair.pixel).norm())
    };
    let kept: Vec<usize> = (0..pairs.len()).filter(|i| !left_out.contains(i)).collect();
    let doubtful = |i: usize| {
        if left_out.contains(&i) {
            return true;
        }
        if !(TELLING..=MANY).contains(&kept.len()) {
            return off(view, &pairs[i]) > ASTRAY * diagonal;
        }
        let others: Vec<Correspondence> = kept.iter().filter(|k| **k != i).map(|&k| pairs[k]).collect();
        let Ok(solution) = posit::pose(&others, &view.camera, &Options::default()) else { return false };
        off(&solution.view, &pairs[i]) > (SUSPICIOUS.0 * solution.sigma).max(SUSPICIOUS.1 * diagonal)
    };
    (0..pairs.len())
        .map(|i| PairFit {
            predicted: view.project(&pairs[i].point),
            residual: off(view, &pairs[i]),
            suspicious: doubtful(i),
        })
        .collect()
}

fn diagonal(camera: &Camera) -> f64 {
    f64::from(camera.width).hypot(f64::from(camera.height))
}
