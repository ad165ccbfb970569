//! What depends on the direction to the camera as well as on the normal: highlights.
use nalgebra::Vector3;

use super::{Signal, Surfel, direction_colour, equal_step, grey, sphere_cell};

/// The direction that a glossy surface shows the camera: the one to the camera, mirrored at the normal, in the camera frame. Points that
/// mirror the same direction show the same light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Specular {
    /// Cells along each side of the unfolded sphere.
    pub steps: usize,
}

impl Specular {
    /// r = 2 (n·v) n − v, of any length.
    #[inline]
    fn direction(point: &Surfel) -> Vector3<f32> {
        let (normal, view) = (point.normal(), point.towards_camera());
        // Times n·n, for the normal is no unit vector between vertices.
        let mirrored = normal * (2.0 * normal.dot(&view)) - view * normal.norm_squared();
        point.viewpoint.camera_from_mesh * mirrored
    }
}

impl Signal for Specular {
    fn bins(&self) -> usize {
        self.steps * self.steps
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        sphere_cell(&Self::direction(point), self.steps)
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        direction_colour(&Self::direction(point))
    }
}

/// The cosine between the normal and the direction to the camera, in equal steps over 0..=1: how a lamp at the camera lights the
/// surface. The half vector of such a lamp is the direction to the camera itself, so its highlight follows the same cosine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Headlight {
    /// The number of bins.
    pub steps: usize,
}

impl Headlight {
    #[inline]
    fn cosine(point: &Surfel) -> f32 {
        let (normal, view) = (point.normal(), point.towards_camera());
        normal.dot(&view) / (normal.norm_squared() * view.norm_squared()).sqrt()
    }
}

impl Signal for Headlight {
    fn bins(&self) -> usize {
        self.steps
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        equal_step(Self::cosine(point), self.steps)
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        grey(Self::cosine(point))
    }
}
