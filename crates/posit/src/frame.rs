//! The frame in which a point set is best conditioned: origin at the centroid, principal axes, unit size.

use crate::NoSolution;
use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use texreg_lie::Pose;

/// How a point set extends, which decides what its image tells of the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shape {
    /// On a line, or all in one place: no pose.
    Collinear,
    /// In a plane, to the rounding of the coordinates: [`coplanar_posit`](crate::coplanar_posit), no resectioning.
    Coplanar,
    /// Thinner than a twentieth of its width: poses mirrored in depth look alike, and solvers that need depth get little.
    NearlyCoplanar,
    /// With depth.
    Solid,
}

/// The shape of a point set by its standard deviations along the principal axes; `None` if it is empty or a number is not
/// finite.
pub fn shape(points: &[Point3<f64>]) -> Option<Shape> {
    match Frame::new(points.iter().map(|p| p.coords)) {
        Err(NoSolution::Collinear) => Some(Shape::Collinear),
        Err(_) => None,
        Ok(frame) if frame.flatness <= Frame::DEGENERATE => Some(Shape::Coplanar),
        Ok(frame) if frame.flatness <= 0.05 => Some(Shape::NearlyCoplanar),
        Ok(_) => Some(Shape::Solid),
    }
}

/// Principal axes, widest first, of a point set.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    centroid: Vector3<f64>,
    axes: Rotation3<f64>,
    scale: f64,
    /// The least of the three extents over the largest.
    flatness: f64,
}

impl Frame {
    /// Sets narrower than this part of their length are lines, flatter ones planes.
    const DEGENERATE: f64 = 1e-6;

    /// The frame of points that do not lie on a line.
    pub(crate) fn new(points: impl Iterator<Item = Vector3<f64>> + Clone) -> Result<Self, NoSolution> {
        let (count, sum) = points.clone().fold((0.0, Vector3::zeros()), |(n, sum), p| (n + 1.0, sum + p));
        let centroid = sum / count;
        let scatter = points.map(|p| p - centroid).fold(Matrix3::zeros(), |sum, d| sum + d * d.transpose()) / count;
        if !scatter.iter().all(|x| x.is_finite()) {
            return Err(NoSolution::NotFinite);
        }
        let eigen = scatter.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let spread = Vector3::from(order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt()));
        // Coordinates far from the origin carry rounding of their own.
        let floor = 8.0 * f64::EPSILON * centroid.amax();
        if !(spread[1] > Self::DEGENERATE * spread[0] && spread[1] > floor) {
            return Err(NoSolution::Collinear);
        }
        let [x, y] = [order[0], order[1]].map(|i| eigen.eigenvectors.column(i).into_owned());
        let axes = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
        Ok(Self { centroid, axes, scale: spread[0], flatness: spread[2] / spread[0] })
    }

    /// World units per unit of the frame.
    pub(crate) fn scale(&self) -> f64 {
        self.scale
    }

    /// World to frame.
    pub(crate) fn enter(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.axes.matrix().tr_mul(&(point - self.centroid)) * (1.0 / self.scale)
    }

    /// A `camera_from_frame` pose to `camera_from_world`.
    pub(crate) fn leave(&self, pose: &Pose) -> Pose {
        let rotation = pose.rotation * self.axes.inverse();
        Pose::new(rotation, pose.translation * self.scale - rotation * self.centroid)
    }

    /// A `camera_from_world` pose to `camera_from_frame`.
    pub(crate) fn adopt(&self, pose: &Pose) -> Pose {
        let translation = (pose.rotation * self.centroid + pose.translation) / self.scale;
        Pose::new(pose.rotation * self.axes, translation)
    }
}
