//! A multi-threaded CPU rasterizer that turns meshes into G-buffers.
//!
//! [`render`] draws a mesh as a [`Camera`](texreg_camera::Camera) sees it, lens distortion included, into a [`GBuffer`]:
//! depth, face and, if asked for, perspective-correct barycentrics of the surface point in every pixel's centre.
//! [`Renderer`] does the same again and again without allocating. [`outline`] finds the background around the silhouette.

mod band;
mod clip;
mod corner;
mod gbuffer;
mod options;
mod outline;
mod prefetch;
mod projector;
mod raycaster;
mod renderer;
mod sieve;
mod three;
mod triangles;

pub use gbuffer::{GBuffer, NO_FACE};
pub use options::Options;
pub use outline::{HaloPixel, outline};
pub use projector::DISTORTION_TOLERANCE;
pub use raycaster::Raycaster;
pub use renderer::{Renderer, render};
pub use triangles::Triangles;
