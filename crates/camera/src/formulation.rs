//! Which of a view's numbers are unknown: the thesis's F(R, T), F(K, R, T) and F(K, C, R, T). F(P) is
//! [`ProjectionMatrix`](crate::ProjectionMatrix).

use crate::{View, pose_jacobian};
use nalgebra::{Matrix2xX, Point2, Point3, Vector6};
use texreg_lie::se3;

/// The unknowns of a [`View`], always in the order (ω, t), (fx, fy, cx, cy, skew), (k1, k2, p1, p2, k3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Formulation {
    /// F(R, T): the left tangent of the pose, 6 numbers.
    Pose,
    /// F(K, R, T): the pose and the intrinsics, 11 numbers, as many as P has.
    PoseAndIntrinsics,
    /// F(K, C, R, T): the pose, the intrinsics and the distortion, 16 numbers.
    All,
}

impl Formulation {
    /// How many unknowns there are.
    pub fn dimension(self) -> usize {
        match self {
            Self::Pose => 6,
            Self::PoseAndIntrinsics => 11,
            Self::All => 16,
        }
    }

    /// The view after a step of the unknowns: `exp(ω, t) · pose`, K and C by addition. `None` for a step of the wrong
    /// length, or to focal lengths that are not positive.
    pub fn step(self, view: &View, step: &[f64]) -> Option<View> {
        if step.len() != self.dimension() {
            return None;
        }
        let mut view = *view;
        view.pose = se3::exp(&Vector6::from_column_slice(&step[..6])) * view.pose;
        if self != Self::Pose {
            let mut k = view.camera.intrinsics.to_array();
            k.iter_mut().zip(&step[6..11]).for_each(|(k, d)| *k += d);
            view.camera.intrinsics = k.into();
        }
        if self == Self::All {
            let mut c = view.camera.distortion.to_array();
            c.iter_mut().zip(&step[11..]).for_each(|(c, d)| *c += d);
            view.camera.distortion = c.into();
        }
        (view.camera.intrinsics.fx > 0.0 && view.camera.intrinsics.fy > 0.0).then_some(view)
    }

    /// The pixel of a world point and its derivative with respect to the unknowns.
    pub fn project_with_jacobian(self, view: &View, point: &Point3<f64>) -> Option<(Point2<f64>, Matrix2xX<f64>)> {
        let point_in_camera = view.pose.transform_point(point);
        let projection = view.camera.project_with_jacobians(&point_in_camera)?;
        let mut jacobian = Matrix2xX::zeros(self.dimension());
        jacobian.fixed_columns_mut::<6>(0).copy_from(&pose_jacobian(&projection.point, &point_in_camera));
        if self != Self::Pose {
            jacobian.fixed_columns_mut::<5>(6).copy_from(&projection.intrinsics);
        }
        if self == Self::All {
            jacobian.fixed_columns_mut::<5>(11).copy_from(&projection.distortion);
        }
        Some((projection.pixel, jacobian))
    }
}
