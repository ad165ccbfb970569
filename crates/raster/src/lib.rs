#![doc = include_str!("../README.md")]

mod band;
mod batch;
mod clip;
mod corner;
mod gbuffer;
mod large;
mod meshlets;
mod options;
mod outline;
mod projector;
mod raycaster;
mod renderer;
mod sieve;
mod sight;
mod three;
mod triangles;

pub use gbuffer::{GBuffer, NO_FACE};
pub use meshlets::Meshlets;
pub use options::Options;
pub use outline::{HaloPixel, outline};
pub use projector::DISTORTION_TOLERANCE;
pub use raycaster::Raycaster;
pub use renderer::{Renderer, render};
pub use triangles::Triangles;
