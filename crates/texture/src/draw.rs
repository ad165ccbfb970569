//! Pictures of a textured model.

use crate::Texture;
use image::RgbImage;
use nalgebra::Rotation3;
use rayon::prelude::*;
use texreg_camera::View;
use texreg_lie::Pose;
use texreg_raster::{NO_FACE, Options, render};
use texreg_surface::Mesh;

/// Draws a textured mesh as a view sees it, lens distortion included: the texture as it is, without shading, on black. Each
/// pixel is the mean of `samples` × `samples` points in it that see the surface.
///
/// Also the share of these points that do, 0 to 1, by pixel.
pub fn draw(mesh: &Mesh, texture: &Texture, view: &View, samples: u32) -> (RgbImage, Vec<f32>) {
    let samples = samples.max(1);
    let (width, height) = (view.camera.width, view.camera.height);
    let camera = view.camera.scaled(f64::from(samples));
    let camera_from_mesh = view.pose * Pose::new(Rotation3::identity(), mesh.origin);
    let triangles = mesh.shape();
    let options = Options { barycentric: true, ..Options::default() };
    let fine = render(&triangles, &camera, &camera_from_mesh, &options);
    let colour = |at: usize| {
        let (face, [v, w]) = (fine.face[at], fine.barycentric[at]);
        let corners = (face != NO_FACE).then(|| texture.uvs.get(face as usize)).flatten()?;
        let uv: [f32; 2] =
            std::array::from_fn(|k| (1.0 - v - w) * corners[0][k] + v * corners[1][k] + w * corners[2][k]);
        Some(texture.sample(uv))
    };
    let pixel = |i: usize| {
        let (x, y) = (i % width as usize, i / width as usize);
        let (mut sum, mut count) = ([0.0f32; 3], 0.0f32);
        for j in 0..samples as usize {
            for k in 0..samples as usize {
                let at = (y * samples as usize + j) * fine.width as usize + x * samples as usize + k;
                if let Some(colour) = colour(at) {
                    (0..3).for_each(|c| sum[c] += colour[c]);
                    count += 1.0;
                }
            }
        }
        let mean = sum.map(|x| (x / count.max(1.0)).round() as u8);
        (mean, count / (samples * samples) as f32)
    };
    let (pixels, shares): (Vec<[u8; 3]>, Vec<f32>) =
        (0..width as usize * height as usize).into_par_iter().with_min_len(1 << 10).map(pixel).unzip();
    let mut image = RgbImage::new(width, height);
    image.as_chunks_mut::<3>().0.copy_from_slice(&pixels);
    (image, shares)
}

impl Texture {
    /// The colour at texture coordinates, bilinearly interpolated, 0 to 255.
    pub fn sample(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let (width, height) = (self.image.width() as usize, self.image.height() as usize);
        let texels = self.image.as_chunks::<3>().0;
        let at = |t: f32, n: usize| (t * n as f32 - 0.5).clamp(0.0, (n.max(1) - 1) as f32);
        let (x, y) = (at(u, width), at(v, height));
        let (left, top) = (x as usize, y as usize);
        let (right, below) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let (fx, fy) = (x - left as f32, y - top as f32);
        let value = |x: usize, y: usize| texels[y * width + x].map(f32::from);
        let (a, b, c, d) = (value(left, top), value(right, top), value(left, below), value(right, below));
        std::array::from_fn(|k| (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy)
    }
}
