//! How far a camera is from the true one: rotation, centre, focal length, and the displacement of visible surface points.

use std::path::Path;

use nalgebra::Point3;
use texreg_camera::{Camera, View};
use texreg_lie::{Pose, so3};

use texreg_formats::{CameraFile, FileError, read_cameras};

/// The displacement charged for a point that one of the two cameras does not see in front of itself, in pixels.
const LOST: f64 = 1e6;

/// True cameras with points of the surface each of them sees.
#[derive(Clone, Debug)]
pub struct Truth {
    /// What the set is called, empty where the file does not say.
    pub name: String,
    /// Diagonal of the model's bounding box in model units.
    pub diagonal: f64,
    /// One entry a photo.
    pub photos: Vec<TruePhoto>,
}

/// The true camera of one photo.
#[derive(Clone, Debug)]
pub struct TruePhoto {
    /// The photo's file name.
    pub file: String,
    /// Its camera and pose.
    pub view: View,
    /// Points of the surface, in the world, that the photo shows.
    pub visible: Vec<Point3<f64>>,
}

/// The error of one camera against the truth.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Score {
    /// Angle between the two orientations in degrees.
    pub rotation_deg: f64,
    /// Distance of the two camera centres over the diagonal of the model's bounding box.
    pub centre_over_bbox: f64,
    /// Mean displacement of the visible points in the photo, in pixels.
    pub mean_px: f64,
    /// Greatest displacement of a visible point, in pixels.
    pub max_px: f64,
    /// Error of the horizontal focal length in percent.
    pub focal_pct: f64,
    /// Error of the vertical focal length in percent.
    pub focal_y_pct: f64,
    /// Whether the mean displacement is below 0.2 % of the photo's diagonal.
    pub ok: bool,
    /// Whether the mean displacement is below one pixel.
    pub strict: bool,
}

/// Reads true cameras: a `cameras.json` whose entries have `width`, `height` and `visible_points`, with `bbox_diagonal` at the top.
pub fn read_truth(path: &Path) -> Result<Truth, FileError> {
    let lacking = |what: &str| FileError {
        path: path.to_owned(),
        cause: format!(
            "{what} is missing or malformed; a file of true cameras has bbox_diagonal, and width, height and visible_points in each entry"
        ),
    };
    let CameraFile { photos, mut other } = read_cameras(path)?;
    let diagonal = other.get("bbox_diagonal").and_then(serde_json::Value::as_f64);
    let diagonal = diagonal.filter(|d| *d > 0.0).ok_or_else(|| lacking("field bbox_diagonal"))?;
    let name = other.remove("case").and_then(|name| name.as_str().map(str::to_owned)).unwrap_or_default();
    let photos = photos.into_iter().map(|mut entry| {
        let field = |name: &str| format!("photo {}, field {name}", entry.file);
        let size = entry.lens.size.ok_or_else(|| lacking(&field("width")))?;
        let points = entry.other.remove("visible_points");
        let points = points.and_then(|points| serde_json::from_value::<Vec<[f64; 3]>>(points).ok());
        let points = points.filter(|points| !points.is_empty()).ok_or_else(|| lacking(&field("visible_points")))?;
        let visible = points.into_iter().map(Point3::from).collect();
        Ok(TruePhoto { view: entry.view(size), file: entry.file, visible })
    });
    Ok(Truth { name, diagonal, photos: photos.collect::<Result<_, _>>()? })
}

/// Scores a camera against the truth of its photo; `diagonal` is that of the model's bounding box.
pub fn score(truth: &TruePhoto, diagonal: f64, view: &View) -> Score {
    let (a, b) = (&truth.view, view);
    let displacement = |point: &Point3<f64>| match (a.project(point), b.project(point)) {
        (Some(p), Some(q)) if (p - q).norm().is_finite() => (p - q).norm(),
        _ => LOST,
    };
    let displacements: Vec<f64> = truth.visible.iter().map(displacement).collect();
    let mean_px = displacements.iter().sum::<f64>() / displacements.len() as f64;
    let motion = motion(&a.pose, &b.pose, diagonal);
    let focal = |get: fn(&Camera) -> f64| 100.0 * (get(&b.camera) / get(&a.camera) - 1.0);
    let image_diagonal = f64::from(a.camera.width).hypot(f64::from(a.camera.height));
    Score {
        rotation_deg: motion.rotation_deg,
        centre_over_bbox: motion.distance_pct / 100.0,
        mean_px,
        max_px: displacements.iter().copied().fold(0.0, f64::max),
        focal_pct: focal(|camera| camera.intrinsics.fx),
        focal_y_pct: focal(|camera| camera.intrinsics.fy),
        ok: mean_px < 0.002 * image_diagonal,
        strict: mean_px < 1.0,
    }
}

/// How far a camera is from another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Angle between the two orientations in degrees.
    pub rotation_deg: f64,
    /// Distance of the two centres in percent of the diagonal of the model's bounding box.
    pub distance_pct: f64,
}

/// The motion from one pose, camera from world, to another; `diagonal` is that of the model's bounding box.
pub fn motion(from: &Pose, to: &Pose, diagonal: f64) -> Motion {
    Motion {
        // From the logarithm: the arc cosine of a trace that rounding made greater than 3 is no number.
        rotation_deg: so3::log(&(to.rotation * from.rotation.inverse())).norm().to_degrees(),
        distance_pct: 100.0 * (to.center() - from.center()).norm() / diagonal,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    #[test]
    fn small_motions_have_their_angle_and_none_has_none() {
        for k in 0..500 {
            let number = |rate: f64| (rate * f64::from(k)).sin();
            let turn = 3.0 * Vector3::new(number(1.3), number(2.1), number(3.7));
            let pose = Pose::new(so3::exp(&turn), Vector3::new(number(0.7), number(1.9), 4.0));
            assert!(motion(&pose, &pose, 1.0).rotation_deg < 1e-12);
            let nearby = Pose::new(so3::exp(&Vector3::new(0.0, 3e-9, -4e-9)) * pose.rotation, pose.translation);
            assert!((motion(&pose, &nearby, 1.0).rotation_deg.to_radians() - 5e-9).abs() < 1e-14);
        }
    }
}
