//! Registration of photographs to surfaces by mutual information.
//!
//! [`register`] takes a model, a photo and a rough view and hands back the view that maximizes the metric, with a verdict.
//! Around it stand the doors: [`Photo`], the camera files, and the score against known cameras.

mod climb;
mod error;
mod evaluate;
mod joint;
mod layer;
mod model;
mod objective;
mod options;
mod outcome;
mod overlay;
mod overview;
mod pair;
mod palette;
mod parameters;
mod photo;
mod pyramid;
mod register;
mod rig;
mod samples;
mod search;
mod survey;
mod uncertainty;
mod verdict;

pub use error::Error;
pub use evaluate::{Motion, Score, TruePhoto, Truth, motion, read_truth, score};
pub use joint::register_jointly;
pub use layer::layer;
pub use model::Model;
pub use options::{MetricName, Options, RotationName, SolverName};
pub use outcome::{Event, Outcome, Stage, Status};
pub use overlay::{Panel, overlay};
pub use parameters::Refine;
pub use photo::{Photo, PhotoError};
pub use register::{Registration, register, search};
// The files of cameras are the door of the same house.
pub use texreg_formats::{
    CameraEntry, CameraFile, FileError, Lens, LensFile, PairsEntry, base_name, read_cameras, read_lenses, read_pairs,
    write_atomic, write_cameras,
};
pub use uncertainty::{FocalUncertainty, Uncertainty};
