//! What a model predicts at a surface point, as one of a few bins.

use nalgebra::{Matrix3, Vector3};
use texreg_surface::Mesh;

/// A visible surface point: a place in a triangle, seen from a camera.
#[derive(Clone, Copy, Debug)]
pub struct Surfel<'a> {
    /// The model.
    pub mesh: &'a Mesh,
    /// The corners of the triangle.
    pub corners: [u32; 3],
    /// The barycentric coordinates of the point, one for each corner; they sum to one.
    pub weights: [f32; 3],
    /// The rotation from the model to the camera frame.
    pub camera_from_mesh: &'a Matrix3<f32>,
}

impl Surfel<'_> {
    /// The interpolated, unnormalized normal in the model's frame.
    #[inline]
    fn normal(&self) -> Vector3<f32> {
        let mut sum = [0.0; 3];
        for (corner, weight) in self.corners.into_iter().zip(self.weights) {
            let normal = &self.mesh.normals[corner as usize];
            for k in 0..3 {
                sum[k] += weight * normal[k];
            }
        }
        sum.into()
    }

    /// The interpolated value of a vertex attribute.
    fn scalar(&self, values: &[f32]) -> f32 {
        self.corners.iter().zip(self.weights).map(|(&i, weight)| weight * values[i as usize]).sum()
    }
}

/// A prediction of the photo's values, coarse enough for a density: each surface point falls into one bin.
pub trait Signal: Sync {
    /// The number of bins.
    fn bins(&self) -> usize;

    /// The bin of a point, below [`bins`](Self::bins).
    fn bin(&self, point: &Surfel) -> usize;
}

/// The normal in the camera frame: its x and y components, each in equal steps over −1..=1.
#[derive(Clone, Copy, Debug)]
pub struct Normals {
    /// Bins of each component.
    pub steps: usize,
}

impl Signal for Normals {
    fn bins(&self) -> usize {
        self.steps * self.steps
    }

    fn bin(&self, point: &Surfel) -> usize {
        let normal = point.normal();
        let half = 0.5 / normal.norm();
        let step = |row: usize| {
            let component = (0..3).map(|k| point.camera_from_mesh[(row, k)] * normal[k]).sum::<f32>();
            equal_step(half * component + 0.5, self.steps)
        };
        step(1) * self.steps + step(0)
    }
}

/// A vertex attribute, in bins that hold the same number of vertices each.
#[derive(Clone, Debug)]
pub struct Ranked {
    attribute: fn(&Mesh) -> Option<&[f32]>,
    /// The upper bounds of all bins but the last, rising.
    bounds: Vec<f32>,
}

impl Ranked {
    /// The scanner's reflectance in so many bins (fewer where many vertices share a value); `None` if the model has none.
    pub fn reflectance(mesh: &Mesh, bins: usize) -> Option<Self> {
        Self::new(mesh, |mesh| mesh.reflectance.as_deref(), bins)
    }

    fn new(mesh: &Mesh, attribute: fn(&Mesh) -> Option<&[f32]>, bins: usize) -> Option<Self> {
        let values = attribute(mesh)?;
        let mut sorted: Vec<f32> = values.iter().step_by(values.len() / 50_000 + 1).copied().collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let mut bounds: Vec<f32> = (1..bins).map(|k| sorted[k * sorted.len() / bins]).collect();
        bounds.dedup();
        Some(Self { attribute, bounds })
    }
}

impl Signal for Ranked {
    fn bins(&self) -> usize {
        self.bounds.len() + 1
    }

    fn bin(&self, point: &Surfel) -> usize {
        let value = (self.attribute)(point.mesh).map_or(0.0, |values| point.scalar(values));
        self.bounds.partition_point(|&bound| bound <= value)
    }
}

/// Two predictions at once: a bin for each pair of their bins.
pub struct Both<A, B>(
    /// The first.
    pub A,
    /// The second.
    pub B,
);

impl<A: Signal, B: Signal> Signal for Both<A, B> {
    fn bins(&self) -> usize {
        self.0.bins() * self.1.bins()
    }

    fn bin(&self, point: &Surfel) -> usize {
        self.0.bin(point) * self.1.bins() + self.1.bin(point)
    }
}

impl<S: Signal + ?Sized> Signal for Box<S> {
    fn bins(&self) -> usize {
        (**self).bins()
    }

    fn bin(&self, point: &Surfel) -> usize {
        (**self).bin(point)
    }
}

/// The step of a value of `0..=1` in equal steps.
fn equal_step(value: f32, steps: usize) -> usize {
    ((value * steps as f32) as usize).min(steps - 1)
}
