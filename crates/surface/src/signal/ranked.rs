//! Vertex attributes of one number, in bins of equal frequency: the scale of the values does not matter.
use super::{Signal, Surfel, grey};
use crate::mesh::Mesh;

/// About how many vertices the distribution of an attribute is estimated from.
const SAMPLE: usize = 50_000;

/// The share of vertices at each end of an attribute's range that is not told apart in pictures.
const TAIL: f64 = 0.05;

/// A vertex attribute, in bins that hold the same number of vertices each.
#[derive(Clone, Debug)]
pub struct Ranked {
    attribute: fn(&Mesh) -> Option<&[f32]>,
    /// The upper bounds of all bins but the last, rising.
    bounds: Vec<f32>,
    /// What is black and what is white.
    range: [f32; 2],
}

impl Ranked {
    /// The scanner's reflectance in so many bins (fewer where many vertices share a value); `None` if the model has none.
    pub fn reflectance(mesh: &Mesh, bins: usize) -> Option<Self> {
        Some(Self::new(|mesh| mesh.reflectance.as_deref(), mesh.reflectance.as_deref()?, bins))
    }

    /// The share of the sky that is seen: creases and hollows are darker.
    pub fn ambient_occlusion(mesh: &Mesh, bins: usize) -> Self {
        Self::new(|mesh| Some(mesh.ambient_occlusion()), mesh.ambient_occlusion(), bins)
    }

    /// The mean curvature: edges are worn and catch light, dirt gathers in grooves.
    pub fn curvature(mesh: &Mesh, bins: usize) -> Self {
        Self::new(|mesh| Some(mesh.mean_curvature()), mesh.mean_curvature(), bins)
    }

    fn new(attribute: fn(&Mesh) -> Option<&[f32]>, values: &[f32], bins: usize) -> Self {
        let mut sorted: Vec<f32> = values.iter().step_by(values.len() / SAMPLE + 1).copied().collect();
        sorted.sort_unstable_by(f32::total_cmp);
        let mut bounds: Vec<f32> = (1..bins).map(|k| sorted[k * sorted.len() / bins]).collect();
        bounds.dedup();
        let quantile = |share: f64| sorted[(share * (sorted.len() - 1) as f64).round() as usize];
        Self { attribute, bounds, range: [quantile(TAIL), quantile(1.0 - TAIL)] }
    }

    #[inline]
    fn value(&self, point: &Surfel) -> f32 {
        (self.attribute)(point.mesh).map_or(0.0, |values| point.scalar(values))
    }
}

impl Signal for Ranked {
    fn bins(&self) -> usize {
        self.bounds.len() + 1
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        let value = self.value(point);
        // They are few: to count them takes no branch that cannot be foreseen.
        self.bounds.iter().map(|&bound| usize::from(bound <= value)).sum()
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        let [low, high] = self.range;
        grey((self.value(point) - low) / (high - low).max(f32::MIN_POSITIVE))
    }
}
