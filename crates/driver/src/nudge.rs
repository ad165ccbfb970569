//! Moving a camera by hand.

use nalgebra::{Point3, Vector3};
use texreg_camera::View;
use texreg_lie::{Pose, so3};

/// A small motion of the model in the picture, about one of its points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nudge {
    /// To the right and down, in pixels at the point.
    pub shift: [f64; 2],
    /// A rotation vector in the camera frame, in radians.
    pub turn: [f64; 3],
    /// By how much the point's distance is multiplied, above zero.
    pub distance: f64,
}

impl Default for Nudge {
    /// No motion.
    fn default() -> Self {
        Self { shift: [0.0; 2], turn: [0.0; 3], distance: 1.0 }
    }
}

impl Nudge {
    /// The view after the motion, for a model around `centre`; `None` if that is not in front of the camera.
    pub fn apply(&self, view: &View, centre: &Point3<f64>) -> Option<View> {
        let at = view.pose.transform_point(centre).coords;
        let k = &view.camera.intrinsics;
        let shift = Vector3::new(self.shift[0] / k.fx, self.shift[1] / k.fy, 0.0) * at.z;
        let rotation = so3::exp(&Vector3::from(self.turn)) * view.pose.rotation;
        let pose = Pose::new(rotation, at * self.distance + shift - rotation * centre.coords).renormalized();
        let in_front = at.z > 0.0 && self.distance > 0.0;
        (in_front && pose.is_finite()).then_some(View { camera: view.camera, pose })
    }
}
