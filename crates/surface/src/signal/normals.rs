//! The normal, binned on the sphere: what decides shading under any distant light.
use nalgebra::Vector3;

use super::{Signal, Surfel, direction_colour, equal_step, grey, sphere_cell};

/// The surface normal. Points whose normals are alike are lit alike, whatever the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Normals {
    /// How much of the normal is told apart.
    pub components: Components,
    /// The axes it is taken along.
    pub frame: Frame,
    /// Bins of each component, or cells along each side of the unfolded sphere.
    pub steps: usize,
}

/// Components of a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Components {
    /// y alone, in equal steps over −1..=1: in the camera frame, how far a surface faces up, where light mostly comes from.
    One,
    /// x and y, each in equal steps over −1..=1: in the camera frame all there is to tell, as what is seen faces the camera.
    Two,
    /// The whole direction, in steps × steps cells of about the same size on the sphere.
    Three,
}

/// The axes of a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Frame {
    /// The camera's: x right, y down, z forward.
    Camera,
    /// The model's.
    Model,
}

impl Normals {
    /// The interpolated normal in the frame, of any length.
    #[inline]
    fn normal(&self, point: &Surfel) -> Vector3<f32> {
        let normal = point.normal();
        match self.frame {
            Frame::Camera => point.viewpoint.camera_from_mesh * normal,
            Frame::Model => normal,
        }
    }
}

impl Signal for Normals {
    fn bins(&self) -> usize {
        match self.components {
            Components::One => self.steps,
            Components::Two | Components::Three => self.steps * self.steps,
        }
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        let normal = self.normal(point);
        let step = |component: f32| equal_step(component * (0.5 / normal.norm()) + 0.5, self.steps);
        match self.components {
            Components::One => step(normal.y),
            Components::Two => step(normal.y) * self.steps + step(normal.x),
            Components::Three => sphere_cell(&normal, self.steps),
        }
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        let normal = self.normal(point);
        match self.components {
            Components::One => grey(0.5 - 0.5 * normal.y / normal.norm()),
            Components::Two | Components::Three => direction_colour(&normal),
        }
    }
}
