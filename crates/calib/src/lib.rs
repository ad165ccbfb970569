//! Camera calibration from photographs of a checkerboard.
//!
//! [`detect`] finds a board's corners in a picture, [`calibrate`] makes a camera of several pictures' corners, and
//! [`weaknesses`] says what they leave open. Pixels have their centres at integers; poses are `camera_from_board`, the
//! board's frame being x along its rows, y along its columns and z into it.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod board;
mod bundle;
mod calibrate;
mod corner;
mod detect;
mod error;
mod grid;
mod homography;
mod image;
mod model;
mod other_size;
mod refine;
mod response;
mod weakness;
mod zhang;

pub use board::{Board, BoardCorner};
pub use calibrate::{Calibration, Options, PhotoFit, Trial, calibrate};
pub use detect::{Sighting, detect};
pub use error::Error;
pub use image::Image;
pub use model::{Model, PARAMETER_NAMES};
pub use other_size::other_size;
pub use weakness::{Coverage, NINTHS, Weakness, weaknesses};
