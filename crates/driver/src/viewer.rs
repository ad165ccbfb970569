//! Pictures of a model for people who turn it in their hands: drawn again and again, in the colours they like.

use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

use nalgebra::{Point2, Point3, Rotation3, Vector3};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_lie::Pose;
use texreg_raster::{GBuffer, NO_FACE, Options, Raycaster, Renderer, render};
use texreg_surface::Mesh;

use crate::Photo;

/// How the surface is coloured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shading {
    /// Grey, lit from above the camera's left shoulder.
    Shaded,
    /// By the normal in the camera frame: x (right), −y (up) and −z (towards the camera) as red, green and blue.
    Normals,
    /// By the scanner's reflectance.
    Reflectance,
    /// By the share of the sky that is seen.
    Occlusion,
    /// In the model's own colours.
    Colours,
    /// By a photo, laid on the model by its camera.
    Textured,
}

impl Shading {
    /// Every shading.
    pub const ALL: &[Self] =
        &[Self::Shaded, Self::Normals, Self::Reflectance, Self::Occlusion, Self::Colours, Self::Textured];

    /// The shadings a model has by itself.
    pub fn of(mesh: &Mesh) -> Vec<Self> {
        let has = |shading: &Self| match shading {
            Self::Reflectance => mesh.reflectance.is_some(),
            Self::Colours => mesh.colours.is_some(),
            Self::Shaded | Self::Normals | Self::Occlusion => true,
            Self::Textured => false,
        };
        Self::ALL.iter().copied().filter(has).collect()
    }
}

impl fmt::Display for Shading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Shaded => "shaded",
            Self::Normals => "normals",
            Self::Reflectance => "reflectance",
            Self::Occlusion => "occlusion",
            Self::Colours => "colours",
            Self::Textured => "textured",
        })
    }
}

impl FromStr for Shading {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|shading| shading.to_string() == text);
        found.copied().ok_or_else(|| format!("'{text}' is no shading"))
    }
}

/// What a surface is painted with, made once for many pictures.
#[derive(Clone, Debug)]
pub enum Skin {
    /// [`Shading::Shaded`].
    Shaded,
    /// [`Shading::Normals`].
    Normals,
    /// A colour for each vertex.
    Vertices(Vec<[u8; 3]>),
    /// A photo; what it does not show is [`Shading::Shaded`].
    Photo(Box<Projected>),
}

impl Skin {
    /// The skin of a shading; `None` if the model does not have it by itself.
    pub fn new(mesh: &Mesh, shading: Shading) -> Option<Self> {
        let grey = |values: &[f32]| values.iter().map(|v| [(255.0 * v.clamp(0.0, 1.0)).round() as u8; 3]).collect();
        Some(match shading {
            Shading::Shaded => Self::Shaded,
            Shading::Normals => Self::Normals,
            Shading::Reflectance => Self::Vertices(grey(&spread(mesh.reflectance.as_deref()?))),
            Shading::Occlusion => Self::Vertices(grey(mesh.ambient_occlusion())),
            Shading::Colours => Self::Vertices(mesh.colours.clone()?),
            Shading::Textured => return None,
        })
    }
}

/// Values spread over 0.08 … 1, the outermost hundredths at either end clamped.
fn spread(values: &[f32]) -> Vec<f32> {
    let mut sorted: Vec<f32> = values.iter().step_by(values.len() / 50_000 + 1).copied().collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let quantile = |share: f64| sorted.get(((sorted.len().max(1) - 1) as f64 * share) as usize).copied().unwrap_or(0.0);
    let (low, high) = (quantile(0.01), quantile(0.99));
    let span = (high - low).max(f32::MIN_POSITIVE);
    values.iter().map(|v| 0.08 + 0.92 * ((v - low) / span).clamp(0.0, 1.0)).collect()
}

/// A photo laid on a model by its camera.
#[derive(Clone, Debug)]
pub struct Projected {
    photo: Arc<Photo>,
    view: View,
    /// The model as the photo sees it, at no more than a few megapixels, to tell what is hidden.
    seen: GBuffer,
    /// That picture's pixels a pixel of the photo.
    scale: f64,
    slack: f64,
}

/// Pixels along the longer side of the picture that tells what a photo does not see.
const SEEN: f64 = 2048.0;

/// A point is hidden if it lies behind the surface by more than this share of the model's diagonal.
const SLACK: f64 = 0.004;

impl Projected {
    /// Lays a photo on a model.
    pub fn new(mesh: &Mesh, photo: Arc<Photo>, view: &View) -> Self {
        let scale = (SEEN / f64::from(photo.width.max(photo.height))).min(1.0);
        let seen = render(&mesh.shape(), &view.camera.scaled(scale), &from_mesh(view, mesh), &Options::default());
        Self { photo, view: *view, seen, scale, slack: SLACK * mesh.diagonal() }
    }

    /// The photo's colour at a point of the world; `None` where it does not show it.
    fn colour(&self, point: &Point3<f64>) -> Option<[u8; 3]> {
        let in_camera = self.view.pose.transform_point(point);
        let pixel = self.view.camera.project(&in_camera)?;
        self.view.camera.contains(&pixel).then_some(())?;
        let at = (pixel.coords.add_scalar(0.5) * self.scale).map(|x| x.max(0.0) as u32);
        let (x, y) = (at.x.min(self.seen.width - 1), at.y.min(self.seen.height - 1));
        let depth = f64::from(self.seen.depth[(y * self.seen.width + x) as usize]);
        (in_camera.z <= depth + self.slack).then_some(())?;
        let (u, v) = (pixel.x.round().max(0.0) as usize, pixel.y.round().max(0.0) as usize);
        self.photo.rgb.get(v * self.photo.width as usize + u).copied()
    }
}

/// Draws a model, keeping its working memory from one picture to the next.
#[derive(Debug, Default)]
pub struct Viewer {
    renderer: Renderer,
    seen: GBuffer,
    pixels: Vec<[u8; 4]>,
}

impl Viewer {
    /// Draws the model as a view of the world sees it: red, green, blue and opacity, row by row. The background is
    /// `background`, the model opaque.
    pub fn draw(&mut self, mesh: &Mesh, view: &View, skin: &Skin, background: [u8; 4]) -> &[[u8; 4]] {
        let Self { renderer, seen, pixels } = self;
        let options = Options { barycentric: true, ..Options::default() };
        renderer.render(&mesh.shape(), &view.camera, &from_mesh(view, mesh), &options, seen);
        pixels.resize(seen.face.len(), background);
        let painter = Painter { mesh, rotation: view.pose.rotation.cast(), skin };
        let width = (seen.width as usize).max(1);
        let rows =
            pixels.par_chunks_mut(width).zip(seen.face.par_chunks(width).zip(seen.barycentric.par_chunks(width)));
        rows.for_each(|(row, (faces, weights))| {
            for ((pixel, &face), &weights) in row.iter_mut().zip(faces).zip(weights) {
                *pixel = if face == NO_FACE { background } else { opaque(painter.colour(face, weights)) };
            }
        });
        pixels
    }

    /// Whether the picture drawn last, by this view of this model, shows a point of the surface, rather than what is before it.
    pub fn shows(&self, mesh: &Mesh, view: &View, point: &Point3<f64>) -> bool {
        let in_camera = view.pose.transform_point(point);
        let visible = || {
            let pixel = view.camera.project(&in_camera).filter(|pixel| view.camera.contains(pixel))?;
            let at = pixel.y.round() as usize * self.seen.width as usize + pixel.x.round() as usize;
            Some(in_camera.z <= f64::from(*self.seen.depth.get(at)?) + SLACK * mesh.diagonal())
        };
        visible().unwrap_or(false)
    }
}

/// Colours the points of a picture.
struct Painter<'a> {
    mesh: &'a Mesh,
    rotation: Rotation3<f32>,
    skin: &'a Skin,
}

impl Painter<'_> {
    fn colour(&self, face: u32, weights: [f32; 2]) -> [u8; 3] {
        let corners = self.mesh.triangles[face as usize].map(|i| i as usize);
        let weights = [1.0 - weights[0] - weights[1], weights[0], weights[1]];
        match self.skin {
            Skin::Shaded => lit(&self.normal(corners, weights)),
            Skin::Normals => {
                let n = self.normal(corners, weights);
                [n.x, -n.y, -n.z].map(|x| (127.5 + 127.5 * x).round() as u8)
            }
            Skin::Vertices(colours) => {
                mean(corners.map(|i| colours[i].map(f32::from)), weights).map(|c| c.round() as u8)
            }
            Skin::Photo(photo) => {
                let point = mean(corners.map(|i| self.mesh.positions[i]), weights);
                let point = Point3::from(self.mesh.origin + Vector3::from(point.map(f64::from)));
                photo.colour(&point).unwrap_or_else(|| lit(&self.normal(corners, weights)).map(|c| c / 2))
            }
        }
    }

    /// The unit normal in the camera frame.
    fn normal(&self, corners: [usize; 3], weights: [f32; 3]) -> Vector3<f32> {
        let normal = Vector3::from(mean(corners.map(|i| self.mesh.normals[i]), weights));
        (self.rotation * normal).try_normalize(0.0).unwrap_or(-Vector3::z())
    }
}

/// Grey under a light above the camera's left shoulder; both sides of the surface are lit.
fn lit(normal: &Vector3<f32>) -> [u8; 3] {
    let normal = if normal.z > 0.0 { -normal } else { *normal };
    let light = Vector3::new(-0.36, -0.48, -0.80).dot(&normal).max(0.0);
    let shade = 0.16 + 0.80 * light;
    [0.97, 0.96, 0.93].map(|tint| (255.0 * tint * shade) as u8)
}

#[inline]
fn mean([a, b, c]: [[f32; 3]; 3], [u, v, w]: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| u * a[k] + v * b[k] + w * c[k])
}

fn opaque([r, g, b]: [u8; 3]) -> [u8; 4] {
    [r, g, b, 255]
}

/// The point of the model, in the world, that a view sees at a pixel, exactly on its surface; `None` on the background.
///
/// The pixel becomes the only one of a rendering, its centre where the pixel is, so places between centres are as exact.
pub fn pick(mesh: &Mesh, view: &View, pixel: &Point2<f64>) -> Option<Point3<f64>> {
    let mut camera = Camera { width: 1, height: 1, ..view.camera };
    camera.intrinsics.cx -= pixel.x;
    camera.intrinsics.cy -= pixel.y;
    let (triangles, camera_from_mesh) = (mesh.shape(), from_mesh(view, mesh));
    let seen = render(&triangles, &camera, &camera_from_mesh, &Options::default());
    let face = seen.face.first().copied().filter(|&face| face != NO_FACE)?;
    let point = Raycaster::new(&camera, &camera_from_mesh).point(&triangles, face, Point2::origin())?;
    Some(point + mesh.origin)
}

/// The pose of a view for the mesh's own frame.
fn from_mesh(view: &View, mesh: &Mesh) -> Pose {
    view.pose * Pose::new(Rotation3::identity(), mesh.origin)
}
