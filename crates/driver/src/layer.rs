//! What the metric sees of a model, as pictures.

use std::fmt;
use std::str::FromStr;

use image::{DynamicImage, GrayImage, RgbImage};
use nalgebra::{Rotation3, Vector3};
use texreg_camera::View;
use texreg_lie::Pose;
use texreg_raster::{GBuffer, Options, Triangles, render};
use texreg_surface::Mesh;

/// A picture of one property of the visible surface; the background is black.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layer {
    /// The normal in the camera frame: x (right), −y (up) and −z (towards the camera) as red, green and blue.
    Normals,
    /// The scanner's reflectance, white where it is greatest.
    Reflectance,
    /// The model's own colours.
    Colours,
    /// The depth, white where it is least.
    Depth,
    /// The outline's inside, white.
    Silhouette,
}

impl Layer {
    /// Every layer.
    pub const ALL: &[Self] = &[Self::Normals, Self::Reflectance, Self::Colours, Self::Depth, Self::Silhouette];

    /// The layers a model has.
    pub fn of(mesh: &Mesh) -> Vec<Self> {
        let has = |layer: &Self| match layer {
            Self::Reflectance => mesh.reflectance.is_some(),
            Self::Colours => mesh.colours.is_some(),
            Self::Normals | Self::Depth | Self::Silhouette => true,
        };
        Self::ALL.iter().copied().filter(has).collect()
    }
}

impl fmt::Display for Layer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Normals => "normals",
            Self::Reflectance => "reflectance",
            Self::Colours => "colours",
            Self::Depth => "depth",
            Self::Silhouette => "silhouette",
        })
    }
}

impl FromStr for Layer {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|layer| layer.to_string() == text);
        found.copied().ok_or_else(|| format!("'{text}' is no layer"))
    }
}

/// Draws a layer of the model as a view sees it; `None` if the model does not have it.
pub fn layer(mesh: &Mesh, view: &View, layer: Layer) -> Option<DynamicImage> {
    let triangles = Triangles { positions: &mesh.positions, indices: &mesh.triangles };
    let camera_from_mesh = view.pose * Pose::new(Rotation3::identity(), mesh.origin);
    let options = Options { barycentric: true, ..Options::default() };
    let buffer = render(&triangles, &view.camera, &camera_from_mesh, &options);
    let (width, height) = (buffer.width, buffer.height);
    let grey = |pixels| GrayImage::from_raw(width, height, pixels).map(DynamicImage::from);
    let colour = |pixels| RgbImage::from_raw(width, height, pixels).map(DynamicImage::from);
    match layer {
        Layer::Silhouette => grey(buffer.silhouette()),
        Layer::Depth => {
            // Nearer is brighter, and the farthest point still differs from the background.
            grey(stretched(&buffer.depth.iter().map(|depth| -depth).collect::<Vec<_>>(), &buffer))
        }
        Layer::Reflectance => {
            let values: Vec<[f32; 1]> = mesh.reflectance.as_ref()?.iter().map(|&value| [value]).collect();
            let values = buffer.interpolate(&mesh.triangles, &values, [0.0]);
            grey(stretched(&values.concat(), &buffer))
        }
        Layer::Colours => {
            let colours: Vec<[f32; 3]> = mesh.colours.as_ref()?.iter().map(|c| c.map(f32::from)).collect();
            let colours = buffer.interpolate(&mesh.triangles, &colours, [0.0; 3]);
            colour(colours.iter().flatten().map(|c| c.round() as u8).collect())
        }
        Layer::Normals => {
            let rotation = view.pose.rotation.cast::<f32>();
            let normals = buffer.interpolate(&mesh.triangles, &mesh.normals, [0.0; 3]);
            let code = |normal: &[f32; 3]| {
                let n = (rotation * Vector3::from(*normal)).try_normalize(0.0).unwrap_or_default();
                let code = |x: f32| (127.5 + 127.5 * x).round() as u8;
                if *normal == [0.0; 3] { [0; 3] } else { [code(n.x), code(-n.y), code(-n.z)] }
            };
            colour(normals.iter().flat_map(code).collect())
        }
    }
}

/// Values of the visible surface spread over 25 … 255; 0 on the background.
fn stretched(values: &[f32], buffer: &GBuffer) -> Vec<u8> {
    let seen = |i: &usize| buffer.depth[*i].is_finite();
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for i in (0..values.len()).filter(seen) {
        (low, high) = (low.min(values[i]), high.max(values[i]));
    }
    let span = (high - low).max(f32::MIN_POSITIVE);
    let code = |i: usize| if seen(&i) { (25.0 + 230.0 * (values[i] - low) / span).round() as u8 } else { 0 };
    (0..values.len()).map(code).collect()
}
