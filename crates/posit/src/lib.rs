//! Poses from correspondences between points of a model and pixels of a photo.
//!
//! [`pose`] is the way in: it takes four or more correspondences and a camera and returns the pose with the least
//! reprojection error, rejecting wrong correspondences and saying how sure it is. The solvers it is made of stand
//! alone beside it. All of them share one equation, `λ (x, y, 1) = R X + T`: X in the world, (x, y) the undistorted
//! normalized image coordinates, and λ > 0 the depth.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod correspondence;
mod dlt;
mod frame;
mod global;
mod no_solution;
mod normal;
mod p3p;
mod pose;
mod posit;
mod random;
mod refine;
mod robust;

pub use correspondence::{Bearing, Correspondence};
pub use dlt::{dlt, resection};
pub use frame::{Shape, shape};
pub use global::global;
pub use no_solution::NoSolution;
pub use p3p::p3p;
pub use pose::{Options, Solution, pose};
pub use posit::{Iteration, Posit, coplanar_posit, pos, posit};
pub use refine::{Refined, Refinement, refine};
pub use robust::{Consensus, Sampling, consensus};
