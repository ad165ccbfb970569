//! Where a surface point is, and that it is there at all.
use nalgebra::Vector3;

use super::{Signal, Surfel, equal_step, grey};
use crate::mesh::Mesh;

/// The distance from the camera, in equal steps over what the model's bounding box spans: haze, and light that falls off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Depth {
    /// The box's centre and half its sides.
    centre: Vector3<f32>,
    half: Vector3<f32>,
    steps: usize,
}

impl Depth {
    /// The distance in so many bins.
    pub fn new(mesh: &Mesh, steps: usize) -> Self {
        let (low, high) = mesh.bounds();
        let centre = mesh.centre().coords - mesh.origin;
        Self { centre: centre.cast(), half: (0.5 * (high - low)).cast(), steps }
    }

    /// The distance on a scale where the box, or what of it lies before the camera, spans 0..=1.
    #[inline]
    fn relative(&self, point: &Surfel) -> f32 {
        let to_centre = point.viewpoint.centre - self.centre;
        let distance = to_centre.norm();
        // Half of what the box spans along the line to its centre.
        let reach = to_centre.abs().dot(&self.half) / distance.max(f32::MIN_POSITIVE);
        let nearest = (distance - reach).max(0.0);
        (point.towards_camera().norm() - nearest) / (distance + reach - nearest)
    }
}

impl Signal for Depth {
    fn bins(&self) -> usize {
        self.steps
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        equal_step(self.relative(point), self.steps)
    }

    /// Nearer is brighter.
    fn colour(&self, point: &Surfel) -> [f32; 3] {
        grey(1.0 - self.relative(point))
    }

    fn is_relative(&self) -> bool {
        true
    }
}

/// The model as against its background: one bin for all of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Silhouette;

impl Signal for Silhouette {
    fn bins(&self) -> usize {
        1
    }

    #[inline]
    fn bin(&self, _: &Surfel) -> usize {
        0
    }

    fn colour(&self, _: &Surfel) -> [f32; 3] {
        [1.0; 3]
    }
}
