//! What the metric sees of a model, as pictures.

use crate::model::viewpoint;
use image::RgbImage;
use nalgebra::Rotation3;
use rayon::prelude::*;
use texreg_camera::View;
use texreg_lie::Pose;
use texreg_raster::{Options, render};
use texreg_surface::{Mesh, Signal, Surfel};

/// Draws a signal of the model as a view of the world sees it; the background is black.
pub fn layer(mesh: &Mesh, signal: &dyn Signal, view: &View) -> RgbImage {
    let triangles = mesh.shape();
    let camera_from_mesh = view.pose * Pose::new(Rotation3::identity(), mesh.origin);
    let options = Options { barycentric: true, ..Options::default() };
    let buffer = render(&triangles, &view.camera, &camera_from_mesh, &options);
    let viewpoint = viewpoint(&View { camera: view.camera, pose: camera_from_mesh });
    let colour = |(&face, &[v, w]): (&u32, &[f32; 2])| {
        let corners = *mesh.triangles.get(face as usize)?;
        Some(signal.colour(&Surfel { mesh, corners, weights: [1.0 - v - w, v, w], viewpoint: &viewpoint }))
    };
    let pixels = buffer.face.par_iter().zip(&buffer.barycentric);
    let stretch =
        signal.is_relative().then(|| Stretch::over(pixels.clone().filter_map(colour).map(|[grey, ..]| grey).collect()));
    let mut picture = RgbImage::new(buffer.width, buffer.height);
    picture.par_chunks_mut(3).zip(pixels).for_each(|(out, pixel)| {
        if let Some(colour) = colour(pixel) {
            let colour = colour.map(|x| stretch.as_ref().map_or(x, |stretch| stretch.apply(x)));
            out.copy_from_slice(&colour.map(|x| (255.0 * x).round() as u8));
        }
    });
    picture
}

/// Values stretched so that all but the least and the greatest hundredth span the greys.
struct Stretch {
    low: f32,
    high: f32,
}

impl Stretch {
    fn over(mut values: Vec<f32>) -> Self {
        let last = values.len().saturating_sub(1);
        values.par_sort_unstable_by(f32::total_cmp);
        let at = |k: usize| values.get(k).copied().unwrap_or_default();
        Self { low: at(last / 100), high: at(last - last / 100) }
    }

    /// A grey that differs from the background's black.
    fn apply(&self, value: f32) -> f32 {
        0.1 + 0.9 * ((value - self.low) / (self.high - self.low).max(f32::MIN_POSITIVE)).clamp(0.0, 1.0)
    }
}
