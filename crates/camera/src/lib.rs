//! Pinhole cameras with Brown–Conrady distortion: projection with analytic Jacobians, and the 3×4 projection matrix.
//!
//! The camera frame is x right, y down, z forward. Pixel coordinates are continuous with the centre of the top-left
//! pixel at (0, 0), so an image of width W spans −0.5 … W − 0.5.

mod camera;
mod distortion;
mod intrinsics;
mod view;

pub use camera::{Camera, Projection};
pub use distortion::Distortion;
pub use intrinsics::Intrinsics;
pub use view::{View, pose_jacobian};
