//! From corners to a camera: homographies, a closed form, all photos together, and which of them and of the lens's terms
//! to believe.

use crate::bundle::{self, Fit, Shot};
use crate::model::{Model, PARAMETERS};
use crate::{Board, BoardCorner, Error, homography, zhang};
use nalgebra::{Matrix3, Point2, Vector2};
use texreg_camera::Camera;
use texreg_lie::Pose;

/// How to calibrate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// The lens model; without one, the simplest that no other has strong evidence against.
    pub model: Option<Model>,
    /// Whether photos that do not go with the others are left out.
    pub leave_out: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self { model: None, leave_out: true }
    }
}

/// A calibrated camera, and how far to believe it.
#[derive(Clone, Debug)]
pub struct Calibration {
    /// The camera.
    pub camera: Camera,
    /// Its lens model.
    pub model: Model,
    /// The standard deviations of fx, fy, cx, cy, skew, k1, k2, p1, p2, k3; 0 for those the model does not have.
    pub deviations: [f64; PARAMETERS],
    /// The root of the mean squared reprojection error (of distances, as OpenCV states it), in pixels.
    pub rms: f64,
    /// The standard deviation of a corner's coordinate, in pixels.
    pub sigma: f64,
    /// One entry a photo, in the order given.
    pub photos: Vec<PhotoFit>,
    /// The models that were tried.
    pub trials: Vec<Trial>,
}

/// How a photo fits.
#[derive(Clone, Debug)]
pub struct PhotoFit {
    /// `camera_from_board`, in the unit of the board's square.
    pub pose: Pose,
    /// The standard deviations of its left tangent (ω, t) about the middle of its corners, radians and units; infinite for
    /// a photo that is left out.
    pub deviations: [f64; 6],
    /// The photo's own root mean squared distance, pixels.
    pub rms: f64,
    /// Seen minus predicted, pixels, for each of its corners.
    pub residuals: Vec<Vector2<f64>>,
    /// Whether it does not go with the others, and was left out.
    pub is_outlier: bool,
}

impl PhotoFit {
    /// The angle between the board and the image plane, radians.
    pub fn tilt(&self) -> f64 {
        self.pose.rotation.matrix().m33.abs().min(1.0).acos()
    }
}

/// A lens model and how well it explains the corners.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trial {
    /// The model.
    pub model: Model,
    /// Its error, pixels.
    pub rms: f64,
    /// Schwarz's information criterion (G. Schwarz, *Estimating the dimension of a model*, 1978); less is better.
    pub bic: f64,
}

/// The fewest photos of a calibration.
const FEWEST: usize = 3;

/// A difference of the criterion that is very strong evidence (R. Kass & A. Raftery, *Bayes factors*, JASA 90, 1995).
const EVIDENCE: f64 = 10.0;

/// A photo whose error is this many times the median of the photos' errors does not go with the others.
const ODD: f64 = 3.0;

/// And no photo with an error below this is left out, pixels.
const HARMLESS: f64 = 0.2;

/// The largest relative standard deviation of a focal length that is worth stating.
const LOOSEST: f64 = 0.03;

/// Boards whose normals are all within this angle are parallel, radians.
const PARALLEL: f64 = 0.035;

/// Calibrates the camera that took photos of `size` pixels of a board, from the corners in each photo.
///
/// The error `Σ ‖seen − predicted‖²` is minimized over the model's parameters and the boards' poses, starting from
/// Zhang's closed form. Standard deviations follow from its curvature and the residuals' size.
///
/// # Errors
/// Fewer than three photos, corners that span no plane, boards that leave the camera open, or no camera at all.
pub fn calibrate(
    photos: &[Vec<BoardCorner>],
    board: &Board,
    size: [u32; 2],
    options: &Options,
) -> Result<Calibration, Error> {
    if photos.len() < FEWEST {
        return Err(Error::TooFew { found: photos.len(), needed: FEWEST });
    }
    let shot = |corners: &Vec<BoardCorner>| Shot::new(corners.iter().map(|c| (board.point(c.column, c.row), c.pixel)));
    let shots: Vec<Shot> = photos.iter().map(shot).collect();
    let homographies = photos.iter().enumerate().map(|(photo, corners)| {
        let pairs: Vec<_> = corners.iter().map(|c| (board.point(c.column, c.row).xy(), c.pixel)).collect();
        let finite = corners.iter().all(|c| c.pixel.iter().all(|x| x.is_finite()));
        Some(()).filter(|()| finite).and_then(|()| homography::fit(&pairs)).ok_or(Error::Degenerate { photo })
    });
    let homographies: Vec<Matrix3<f64>> = homographies.collect::<Result<_, _>>()?;

    let mut used: Vec<usize> = (0..photos.len()).collect();
    let mut start = start(&shots, &homographies, size).ok_or(Error::NoFit)?;
    loop {
        let chosen: Vec<Shot> = used.iter().map(|i| shots[*i].clone()).collect();
        let poses: Vec<Pose> = used.iter().map(|i| start.poses[*i]).collect();
        let (model, fit, trials) = choose(&chosen, &start.camera, &poses, options.model).ok_or(Error::NoFit)?;
        start.camera = fit.camera;
        for (i, pose) in used.iter().zip(&fit.poses) {
            start.poses[*i] = *pose;
        }
        if let Some(odd) = odd(&chosen, &fit).filter(|_| options.leave_out && used.len() > FEWEST) {
            used.remove(odd);
            continue;
        }
        return finish(&shots, &used, &start.poses, model, &fit, trials);
    }
}

/// The guess with the least error.
fn start(shots: &[Shot], homographies: &[Matrix3<f64>], size: [u32; 2]) -> Option<Fit> {
    let guesses = zhang::guesses(homographies, size);
    let fits = guesses.iter().filter_map(|camera| {
        let poses = homographies.iter().zip(shots).map(|(h, shot)| Some(shot.enter(&zhang::pose(camera, h)?)));
        let poses: Vec<Pose> = poses.collect::<Option<_>>()?;
        let cost = shots.iter().zip(&poses).map(|(shot, pose)| shot.cost(camera, pose)).sum::<Option<f64>>()?;
        Some(Fit { camera: *camera, poses, cost })
    });
    fits.min_by(|a, b| a.cost.total_cmp(&b.cost))
}

/// The fit of the wanted model, or of the one the corners speak for; and what else was tried.
fn choose(shots: &[Shot], camera: &Camera, poses: &[Pose], wanted: Option<Model>) -> Option<(Model, Fit, Vec<Trial>)> {
    let corners: usize = shots.iter().map(Shot::len).sum();
    let models: Vec<Model> = wanted.map_or_else(|| Model::ALL.to_vec(), |model| vec![model]);
    let mut fits: Vec<(Trial, Fit)> = Vec::new();
    for model in models {
        let (camera, poses) = fits.last().map_or((camera, poses), |(_, fit)| (&fit.camera, &fit.poses));
        // A start from another model has terms this one lacks.
        let camera = &model.restrict(camera);
        let Some(fit) = bundle::fit(shots, camera, poses, model.parameters()) else { continue };
        let n = 2.0 * corners as f64;
        let bic = n * (fit.cost.max(f64::MIN_POSITIVE) / n).ln() + model.parameters().len() as f64 * n.ln();
        fits.push((Trial { model, rms: (fit.cost / corners as f64).sqrt(), bic }, fit));
    }
    let trials: Vec<Trial> = fits.iter().map(|(trial, _)| *trial).collect();
    let best = trials.iter().map(|trial| trial.bic).fold(f64::INFINITY, f64::min);
    let (trial, fit) = fits.into_iter().find(|(trial, _)| trial.bic <= best + EVIDENCE)?;
    Some((trial.model, fit, trials))
}

/// The photo that goes least with the others, if there is one that does not.
fn odd(shots: &[Shot], fit: &Fit) -> Option<usize> {
    let errors = shots.iter().zip(&fit.poses).map(|(shot, pose)| {
        let cost = shot.cost(&fit.camera, pose).unwrap_or(f64::INFINITY);
        (cost / shot.len() as f64).sqrt()
    });
    let errors: Vec<f64> = errors.collect();
    let mut sorted = errors.clone();
    sorted.sort_by(f64::total_cmp);
    let median = sorted[sorted.len() / 2];
    let worst = (0..errors.len()).max_by(|a, b| errors[*a].total_cmp(&errors[*b]))?;
    (errors[worst] > ODD * median && errors[worst] > HARMLESS).then_some(worst)
}

/// Deviations, the fit of photos that were left out, and whether all that determines a camera.
fn finish(
    shots: &[Shot],
    used: &[usize],
    starts: &[Pose],
    model: Model,
    fit: &Fit,
    trials: Vec<Trial>,
) -> Result<Calibration, Error> {
    let chosen: Vec<Shot> = used.iter().map(|i| shots[*i].clone()).collect();
    parallel(&fit.poses)?;
    let open = Error::Undetermined { deviation: f64::INFINITY };
    let covariances = bundle::covariances(&chosen, fit, model.parameters()).ok_or(open)?;
    let corners: usize = chosen.iter().map(Shot::len).sum();
    let freedom = (2 * corners).saturating_sub(model.parameters().len() + 6 * used.len());
    let sigma = (fit.cost / freedom.max(1) as f64).sqrt();
    let mut deviations = [0.0; PARAMETERS];
    for &k in model.parameters() {
        deviations[k] = sigma * covariances.camera[(k, k)].sqrt();
    }
    let deviation = deviations[0] / fit.camera.intrinsics.fx;
    if !deviation.is_finite() || deviation > LOOSEST {
        return Err(Error::Undetermined { deviation });
    }
    let photos = shots.iter().enumerate().map(|(i, shot)| {
        let place = used.iter().position(|u| *u == i);
        let pose = match place {
            Some(place) => fit.poses[place],
            // Its pose alone, to say how far off it is.
            None => bundle::fit(std::slice::from_ref(shot), &fit.camera, &starts[i..=i], &[])
                .map_or(starts[i], |f| f.poses[0]),
        };
        let deviations = place
            .map_or([f64::INFINITY; 6], |place| covariances.poses[place].diagonal().map(|v| sigma * v.sqrt()).into());
        let residuals = shot.residuals(&fit.camera, &pose).unwrap_or_default();
        let square: f64 = residuals.iter().map(Vector2::norm_squared).sum();
        let rms = if residuals.is_empty() { f64::INFINITY } else { (square / residuals.len() as f64).sqrt() };
        PhotoFit { pose: shot.leave(&pose), deviations, rms, residuals, is_outlier: place.is_none() }
    });
    Ok(Calibration {
        camera: fit.camera,
        model,
        deviations,
        rms: (fit.cost / corners as f64).sqrt(),
        sigma,
        photos: photos.collect(),
        trials,
    })
}

/// An error if no board is turned from the others.
fn parallel(poses: &[Pose]) -> Result<(), Error> {
    let normals: Vec<_> = poses.iter().map(|pose| pose.rotation.matrix().column(2).into_owned()).collect();
    let pairs = normals.iter().enumerate().flat_map(|(i, a)| normals[..i].iter().map(move |b| a.dot(b)));
    let spread = pairs.fold(1.0, f64::min).clamp(-1.0, 1.0).acos();
    if spread > PARALLEL {
        return Ok(());
    }
    let tilt = normals.iter().map(|n| n.z.abs()).fold(1.0, f64::min).min(1.0).acos();
    let (spread, tilt) = (spread.to_degrees(), tilt.to_degrees());
    Err(if tilt < 5.0 { Error::ParallelToImage { tilt } } else { Error::ParallelBoards { spread } })
}

impl Calibration {
    /// Where the camera shows a corner of a photo's board, as calibrated.
    pub fn predicted(&self, photo: usize, board: &Board, corner: &BoardCorner) -> Option<Point2<f64>> {
        let pose = self.photos.get(photo)?.pose;
        self.camera.project(&pose.transform_point(&board.point(corner.column, corner.row)))
    }
}
