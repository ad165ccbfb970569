//! Rotations and rigid motions: exponential and logarithm, Jacobians, and the charts optimizers step through.
//!
//! Conventions, stated once and used by every crate above:
//! - A tangent of SO(3) is a rotation vector ω in radians, `exp(ω) = I + sin θ/θ [ω]× + (1 − cos θ)/θ² [ω]×²`, θ = ‖ω‖.
//! - A tangent of SE(3) is `(ω, t)`, rotation first.
//! - Tangents live on the **left**: the perturbed rotation is `exp(ω) R`, the perturbed pose `exp(ω, t) · pose`. For a
//!   `camera_from_world` pose that is a motion of the world seen from the camera frame, and a point `y` in the camera
//!   frame moves by `ω × y + t` to first order.
//!
//! Formulas follow T. D. Barfoot, *State Estimation for Robotics*, 2017, chapter 7; every coefficient that loses digits
//! near θ = 0 has its power series up to θ = 1.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod axis_angle;
mod chart;
pub mod check;
mod coefficients;
mod embedded;
mod euler;
mod left;
mod pose;
pub mod se3;
pub mod so3;

pub use axis_angle::AxisAngle;
pub use chart::{Around, Chart};
pub use embedded::{InMatrices, InQuaternions};
pub use euler::Euler;
pub use left::Left;
pub use pose::Pose;
