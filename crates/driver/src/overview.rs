//! How well a view explains the whole of a small picture: for comparing views that are far from each other.
//!
//! Every pixel of the level is a sample, whatever the view: pixels beside the model share the background's bin. The photo's
//! own density is then the same for all views, so that they are compared on equal terms.

use crate::pyramid::Level;
use crate::signal::{Signal, Surfel};
use nalgebra::Matrix3;
use texreg_camera::View;
use texreg_mi::{Density, Metric, Samples};
use texreg_raster::{GBuffer, NO_FACE, Options, Renderer, Triangles};
use texreg_surface::Mesh;

/// A level of the photo and the model in front of it.
pub(crate) struct Overview<'a> {
    mesh: &'a Mesh,
    signal: &'a dyn Signal,
    level: &'a Level,
    density: &'a dyn Density,
    metric: &'a dyn Metric,
    values: Vec<f32>,
}

/// The working memory of one thread.
#[derive(Default)]
pub(crate) struct Workspace {
    renderer: Renderer,
    picture: GBuffer,
    bins: Vec<u16>,
}

impl<'a> Overview<'a> {
    pub(crate) fn new(
        mesh: &'a Mesh,
        signal: &'a dyn Signal,
        level: &'a Level,
        density: &'a dyn Density,
        metric: &'a dyn Metric,
    ) -> Self {
        let values = (0..level.height).flat_map(|y| level.row(y)).copied().collect();
        Self { mesh, signal, level, density, metric, values }
    }

    /// The metric between the model as a view shows it and the level; `None` where the view shows nothing of the model.
    pub(crate) fn score(&self, workspace: &mut Workspace, view: &View) -> Option<f64> {
        let Workspace { renderer, picture, bins } = workspace;
        let camera = self.level.camera(&view.camera);
        let triangles = Triangles { positions: &self.mesh.positions, indices: &self.mesh.triangles };
        let options = Options { parallel: false, ..Options::default() };
        renderer.render(&triangles, &camera, &view.pose, &options, picture);
        let rotation: Matrix3<f32> = view.pose.rotation.matrix().cast();
        let background = self.signal.bins() as u16;
        bins.clear();
        bins.extend(picture.face.iter().map(|&face| {
            if face == NO_FACE {
                return background;
            }
            let corners = self.mesh.triangles[face as usize];
            let surfel = Surfel { mesh: self.mesh, corners, weights: [1.0 / 3.0; 3], camera_from_mesh: &rotation };
            self.signal.bin(&surfel) as u16
        }));
        if bins.iter().all(|&bin| bin == background) {
            return None;
        }
        Some(self.metric.value(&self.density.estimate(&Samples { model: bins, photo: &self.values })))
    }
}
