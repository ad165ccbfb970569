//! Pinhole cameras with Brown–Conrady distortion: projection with analytic Jacobians, and the 3×4 projection matrix.
//!
//! The camera frame is x right, y down, z forward. Pixel coordinates are continuous with the centre of the top-left
//! pixel at (0, 0), so an image of width W spans −0.5 … W − 0.5. Tangents of a pose are (ω, t) on the left, as in
//! `texreg-lie`.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod camera;
mod distortion;
mod epipolar;
mod formulation;
mod intrinsics;
mod matrix;
mod normalization;
mod undistortion;
mod view;

pub use camera::{Camera, Projection};
pub use distortion::Distortion;
pub use epipolar::{epipolar_distance, epipolar_line, essential, fundamental, sampson_distance};
pub use formulation::Formulation;
pub use intrinsics::Intrinsics;
pub use matrix::ProjectionMatrix;
pub use normalization::{normalize_plane, normalize_space};
pub use undistortion::{Samples, rectify};
pub use view::{View, pose_jacobian};
