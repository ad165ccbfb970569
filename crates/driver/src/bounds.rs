//! Bounds that the user sets: how long the focal length, how far off the principal point and how far away the model may be.
//!
//! Each is an interval of one component of a step, so that a solver keeps to it in the problem that gives its step. The distance
//! is that of the model's centre, and a turn of the model about the origin beside it changes that a little as well: so views
//! are held to the bounds after each step, along the line from the camera to the centre.

use crate::Refine;
use nalgebra::Vector3;
use texreg_camera::{Camera, View};

/// Bounds of a camera, ends included. Starts outside are moved to the nearest view inside. A part of the camera that is not
/// refined is not bounded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bounds {
    /// The least and the greatest focal length `fx`, in pixels of the photo.
    pub focal: Option<[f64; 2]>,
    /// How far the principal point may be from where it starts along each axis, in pixels of the photo.
    pub principal: Option<f64>,
    /// The least and the greatest distance: of the centre of the model's bounding box from the camera, along the optical axis, in
    /// model units.
    pub distance: Option<[f64; 2]>,
}

/// Intervals in which a view's numbers are kept: infinite where nothing bounds them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Limits {
    focal: [f64; 2],
    principal: [[f64; 2]; 2],
    distance: [f64; 2],
    /// The model's centre, in its frame.
    centre: Vector3<f64>,
}

/// No bounds.
const FREE: [f64; 2] = [f64::NEG_INFINITY, f64::INFINITY];

impl Default for Limits {
    fn default() -> Self {
        Self { focal: FREE, principal: [FREE; 2], distance: FREE, centre: Vector3::zeros() }
    }
}

fn within(x: f64, [least, most]: [f64; 2]) -> f64 {
    x.max(least).min(most)
}

impl Limits {
    /// The limits of views of a model with a centre, whose camera is expected to be near another.
    pub(crate) fn new(bounds: &Bounds, refine: Refine, expected: &Camera, centre: Vector3<f64>) -> Self {
        let k = &expected.intrinsics;
        let off = bounds.principal.filter(|_| refine.principal);
        Self {
            focal: bounds.focal.filter(|_| refine.focal).unwrap_or(FREE),
            principal: [k.cx, k.cy].map(|c| off.map_or(FREE, |off| [c - off, c + off])),
            distance: bounds.distance.unwrap_or(FREE),
            centre,
        }
    }

    /// The nearest view inside: with another camera, or on the line to the model's centre.
    pub(crate) fn held(&self, view: &View) -> View {
        let mut view = *view;
        let k = &mut view.camera.intrinsics;
        let focal = within(k.fx, self.focal);
        k.fy *= focal / k.fx;
        k.fx = focal;
        k.cx = within(k.cx, self.principal[0]);
        k.cy = within(k.cy, self.principal[1]);
        let beside = view.pose.rotation * self.centre;
        let centre = beside + view.pose.translation;
        let distance = within(centre.z, self.distance);
        if centre.z > 0.0 && distance != centre.z {
            view.pose.translation = centre * (distance / centre.z) - beside;
        }
        view
    }

    /// What may be added to the translation along the optical axis.
    pub(crate) fn distance_step(&self, view: &View) -> [f64; 2] {
        let distance = (view.pose.rotation * self.centre + view.pose.translation).z;
        self.distance.map(|end| end - distance)
    }

    /// What may be added to log f.
    pub(crate) fn focal_step(&self, view: &View) -> [f64; 2] {
        self.focal.map(|end| (end / view.camera.intrinsics.fx).max(0.0).ln())
    }

    /// What may be added to the principal point's coordinates.
    pub(crate) fn principal_step(&self, view: &View) -> [[f64; 2]; 2] {
        let k = &view.camera.intrinsics;
        [self.principal[0].map(|end| end - k.cx), self.principal[1].map(|end| end - k.cy)]
    }

    /// A number of a view that lies at an end of its interval, in words; one a hair inside is held back by it as well.
    pub(crate) fn reached(&self, view: &View) -> Option<&'static str> {
        let near = |[least, most]: [f64; 2], scale: f64| {
            let hair = (1e-3 * (most - least)).clamp(1e-6 * scale, 1e-4 * scale);
            least.abs() < hair || most.abs() < hair
        };
        let k = &view.camera.intrinsics;
        let distance = view.pose.translation.norm();
        if near(self.focal_step(view), 1.0) {
            Some("focal length")
        } else if self.principal_step(view).into_iter().any(|step| near(step, k.fx)) {
            Some("principal point")
        } else {
            near(self.distance_step(view), distance).then_some("distance")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RotationName;
    use crate::parameters::ViewSpace;
    use nalgebra::DVector;
    use texreg_lie::{Pose, so3};
    use texreg_optim::Manifold;

    #[test]
    fn steps_end_within_the_bounds_and_the_regions_ends_on_them() {
        let refine = Refine { focal: true, principal: true, distortion: false };
        let camera = Camera::ideal(640, 480, 500.0);
        let bounds = Bounds { focal: Some([450.0, 520.0]), principal: Some(4.0), distance: Some([2.0, 3.0]) };
        let centre = Vector3::new(0.03, -0.05, 0.04);
        let limits = Limits::new(&bounds, refine, &camera, centre);
        let pose = Pose::new(so3::exp(&Vector3::new(0.4, -0.2, 0.1)), Vector3::new(0.2, -0.1, 2.5));
        let start = limits.held(&View { camera, pose });
        assert_eq!(start, View { camera, pose });
        let space = ViewSpace { rotation: RotationName::Lie.chart(), refine, limits };
        let distance = |view: &View| (view.pose.rotation * centre + view.pose.translation).z;
        for k in 0..50 {
            let step = DVector::from_fn(9, |i, _| {
                let scale = [0.3, 0.3, 0.3, 1.0, 1.0, 2.0, 0.3, 10.0, 10.0][i];
                scale * (12.9898 * i as f64 + 78.233 * f64::from(k)).sin()
            });
            let end = space.retract(&start, &step).unwrap();
            let intrinsics = &end.camera.intrinsics;
            assert!((450.0..=520.0).contains(&intrinsics.fx) && (intrinsics.fy / intrinsics.fx - 1.0).abs() < 1e-12);
            assert!((intrinsics.cx - 319.5).abs() <= 4.0 && (intrinsics.cy - 239.5).abs() <= 4.0);
            assert!((2.0 - 1e-12..3.0 + 1e-12).contains(&distance(&end)));
        }
        for (i, least, most) in space.region(&start).bounds {
            for end in [least, most] {
                let mut step = DVector::zeros(9);
                step[i] = end;
                let view = space.retract(&start, &step).unwrap();
                let word = [("distance", 5), ("focal length", 6), ("principal point", 7), ("principal point", 8)];
                let word = word.iter().find(|(_, component)| *component == i).unwrap().0;
                assert_eq!(limits.reached(&view), Some(word));
                let step = space.region(&view).held(step);
                assert!(step.amax() < 1e-9, "nothing beyond: {step}");
            }
        }
        assert_eq!(limits.reached(&start), None);
        let mut hair = start;
        hair.camera.intrinsics.fx = 520.0 * (1.0 - 5e-5);
        assert_eq!(limits.reached(&hair), Some("focal length"));
        let pose_alone = Limits::new(&bounds, Refine::default(), &camera, centre);
        let far =
            View { camera: Camera::ideal(640, 480, 900.0), pose: Pose::new(pose.rotation, 2.0 * pose.translation) };
        let held = pose_alone.held(&far);
        assert_eq!(held.camera, far.camera);
        assert!((distance(&held) - 3.0).abs() < 1e-12);
        let directions = [&far, &held].map(|view| (view.pose.rotation * centre + view.pose.translation).normalize());
        assert!((directions[0] - directions[1]).norm() < 1e-12);
    }
}
