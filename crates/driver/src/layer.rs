//! What the metric sees of a model, as pictures.

use crate::model::viewpoint;
use image::RgbImage;
use nalgebra::Rotation3;
use rayon::prelude::*;
use texreg_camera::View;
use texreg_lie::Pose;
use texreg_raster::{NO_FACE, Options, render};
use texreg_surface::{Mesh, Signal, Surfel};

/// Draws a signal of the model as a view of the world sees it; the background is black.
pub fn layer(mesh: &Mesh, signal: &dyn Signal, view: &View) -> RgbImage {
    let triangles = mesh.shape();
    let camera_from_mesh = view.pose * Pose::new(Rotation3::identity(), mesh.origin);
    let options = Options { barycentric: true, ..Options::default() };
    let buffer = render(&triangles, &view.camera, &camera_from_mesh, &options);
    let viewpoint = viewpoint(&View { camera: view.camera, pose: camera_from_mesh });
    let mut picture = RgbImage::new(buffer.width, buffer.height);
    let seen = buffer.face.par_iter().zip(&buffer.barycentric);
    picture.par_chunks_mut(3).zip(seen).for_each(|(pixel, (&face, &[v, w]))| {
        if face != NO_FACE {
            let corners = mesh.triangles[face as usize];
            let surfel = Surfel { mesh, corners, weights: [1.0 - v - w, v, w], viewpoint: &viewpoint };
            pixel.copy_from_slice(&signal.colour(&surfel).map(|x| (255.0 * x).round() as u8));
        }
    });
    picture
}
