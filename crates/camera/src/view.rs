//! A camera somewhere in the world.

use crate::Camera;
use nalgebra::{Matrix2x3, Matrix2x6, Point2, Point3};
use texreg_lie::Pose;

/// F(K, C, R, T): a camera and its place in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// K and C.
    pub camera: Camera,
    /// R and T, `camera_from_world`.
    pub pose: Pose,
}

impl View {
    /// The pixel of a world point, under the conditions of [`Camera::project`].
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.camera.project(&self.pose.transform_point(point))
    }

    /// [`project`](Self::project), and ∂pixel/∂(ω, t) for the pose `exp(ω, t) · pose`.
    pub fn project_with_jacobian(&self, point: &Point3<f64>) -> Option<(Point2<f64>, Matrix2x6<f64>)> {
        let point_in_camera = self.pose.transform_point(point);
        let (pixel, jacobian) = self.camera.project_with_jacobian(&point_in_camera)?;
        Some((pixel, pose_jacobian(&jacobian, &point_in_camera)))
    }
}

/// The chain rule through a left step of the pose: ∂pixel/∂(X, Y, Z) to ∂pixel/∂(ω, t), as `y` moves by `ω × y + t`.
pub fn pose_jacobian(point: &Matrix2x3<f64>, point_in_camera: &Point3<f64>) -> Matrix2x6<f64> {
    let y = point_in_camera.coords;
    let mut jacobian = Matrix2x6::zeros();
    for row in 0..2 {
        let g = point.row(row).transpose();
        jacobian.fixed_view_mut::<1, 3>(row, 0).copy_from(&y.cross(&g).transpose());
        jacobian.fixed_view_mut::<1, 3>(row, 3).copy_from(&g.transpose());
    }
    jacobian
}
