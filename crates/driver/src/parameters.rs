//! What is refined: the pose always, and parts of the camera when asked.
//!
//! A step has the pose's six components first, rotation then translation, and then those of the camera: `log f` (both focal
//! lengths by the same factor), the principal point in pixels, and `k1, k2, p1, p2, k3`.

use nalgebra::{DVector, Matrix2x5, Vector2};
use texreg_camera::{Camera, Projection, View};
use texreg_lie::{Pose, so3};
use texreg_optim::Manifold;

/// Which parts of the camera are refined with the pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refine {
    /// The focal length, one factor for both axes.
    pub focal: bool,
    /// The principal point.
    pub principal: bool,
    /// The five distortion coefficients.
    pub distortion: bool,
}

/// The components of the pose in a step.
pub(crate) const POSE: usize = 6;

/// The most components a step can have.
pub(crate) const MOST: usize = POSE + 8;

impl Refine {
    /// The camera's components in a step, and what is known of each beforehand: its standard deviation.
    fn camera_deviations(self, camera: &Camera) -> impl Iterator<Item = f64> {
        let principal = 0.01 * f64::from(camera.width.max(camera.height));
        let focal = self.focal.then_some(0.03);
        let principal = self.principal.then_some([principal; 2]);
        let distortion = self.distortion.then_some([0.1, 0.1, 0.002, 0.002, 0.05]);
        focal.into_iter().chain(principal.into_iter().flatten()).chain(distortion.into_iter().flatten())
    }

    /// The standard deviations of the camera's components before the photo was looked at.
    pub(crate) fn deviations(self, camera: &Camera) -> Vec<f64> {
        self.camera_deviations(camera).collect()
    }

    /// How far a camera is from another in the camera's components of a step.
    pub(crate) fn offset(self, from: &Camera, to: &Camera) -> Vec<f64> {
        let (a, b) = (&from.intrinsics, &to.intrinsics);
        let focal = self.focal.then(|| (b.fx / a.fx).ln());
        let principal = self.principal.then_some([b.cx - a.cx, b.cy - a.cy]);
        let (c, d) = (from.distortion.to_array(), to.distortion.to_array());
        let distortion = self.distortion.then(|| std::array::from_fn::<_, 5, _>(|i| d[i] - c[i]));
        let rest = principal.into_iter().flatten().chain(distortion.into_iter().flatten());
        focal.into_iter().chain(rest).collect()
    }

    /// The number of components of a step.
    pub(crate) fn dimension(self) -> usize {
        POSE + usize::from(self.focal) + 2 * usize::from(self.principal) + 5 * usize::from(self.distortion)
    }

    /// Writes the derivatives of `gradientᵀ · pixel` by the camera's components to `out`. The camera, its projection and the
    /// gradient are those of a level of `scale` pixels per pixel of the photo.
    #[inline]
    pub(crate) fn chain(
        self,
        camera: &Camera,
        scale: f64,
        projection: &Projection,
        gradient: &Vector2<f64>,
        out: &mut [f64],
    ) {
        let mut next = 0;
        let mut push = |value: f64| {
            out[next] = value;
            next += 1;
        };
        let by = |jacobian: &Matrix2x5<f64>, k: usize| jacobian.column(k).dot(gradient);
        if self.focal {
            let k = &camera.intrinsics;
            push(k.fx * by(&projection.intrinsics, 0) + k.fy * by(&projection.intrinsics, 1));
        }
        if self.principal {
            push(scale * by(&projection.intrinsics, 2));
            push(scale * by(&projection.intrinsics, 3));
        }
        if self.distortion {
            (0..5).for_each(|k| push(by(&projection.distortion, k)));
        }
    }
}

impl Manifold<View> for Refine {
    fn dimension(&self) -> usize {
        (*self).dimension()
    }

    fn retract(&self, at: &View, step: &DVector<f64>) -> Option<View> {
        let rotation = step.fixed_rows::<3>(0).into_owned();
        if rotation.norm() >= std::f64::consts::PI {
            return None;
        }
        let pose = Pose::new(so3::exp(&rotation) * at.pose.rotation, at.pose.translation + step.fixed_rows::<3>(3));
        let mut camera = at.camera;
        let mut rest = step.iter().skip(POSE);
        let mut next = || *rest.next().expect("a step has as many components as the manifold has dimensions");
        if self.focal {
            let factor = next().exp();
            camera.intrinsics.fx *= factor;
            camera.intrinsics.fy *= factor;
        }
        if self.principal {
            camera.intrinsics.cx += next();
            camera.intrinsics.cy += next();
        }
        if self.distortion {
            let coefficients = camera.distortion.to_array().map(|c| c + next());
            camera.distortion = coefficients.into();
        }
        Some(View { camera, pose })
    }
}
