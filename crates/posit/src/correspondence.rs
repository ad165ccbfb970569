//! What is known: a point of the model and where the photo shows it.

use nalgebra::{Point2, Point3, Vector2, Vector3};
use texreg_camera::Camera;

/// A model point and its pixel, as clicked or matched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Correspondence {
    /// In the world, model units.
    pub point: Point3<f64>,
    /// In the photo, distorted as the lens left it.
    pub pixel: Point2<f64>,
}

impl Correspondence {
    /// A model point and its pixel.
    pub fn new(point: Point3<f64>, pixel: Point2<f64>) -> Self {
        Self { point, pixel }
    }

    /// The same with the camera taken out; `None` if the lens shows nothing at the pixel or a number is not finite.
    pub fn bearing(&self, camera: &Camera) -> Option<Bearing> {
        let ray = camera.unproject(&self.pixel)?;
        let finite = self.point.iter().all(|x| x.is_finite());
        finite.then(|| Bearing { point: self.point.coords, image: ray.xy() })
    }
}

/// A point and its undistorted normalized image coordinates: what a camera with K = I and no distortion sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bearing {
    /// In the world.
    pub point: Vector3<f64>,
    /// X/Z, Y/Z in the camera frame.
    pub image: Vector2<f64>,
}
