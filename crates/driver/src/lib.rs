//! Registration of photographs to surfaces by mutual information.
//!
//! [`register`] takes a model, a photo and a rough view and hands back the view that maximizes the metric, with a verdict.
//! Around it stand the doors: [`Photo`], the camera files, and the score against known cameras.

mod bounds;
mod channel;
mod climb;
mod contour;
mod counts;
mod error;
mod evaluate;
mod grid;
mod joint;
mod layer;
mod mask;
mod model;
mod needles;
mod nudge;
mod objective;
mod options;
mod outcome;
mod outlines;
mod overlay;
mod overview;
mod pair;
mod pairs;
mod palette;
mod parameters;
mod photo;
mod pyramid;
mod register;
mod rig;
mod samples;
mod search;
mod survey;
mod sweep;
mod uncertainty;
mod verdict;
mod viewer;
mod window;

pub use bounds::Bounds;
pub use error::Error;
pub use evaluate::{Motion, Score, TruePhoto, Truth, motion, read_truth, score};
pub use joint::register_jointly;
pub use layer::layer;
pub use model::Model;
pub use nudge::Nudge;
pub use options::{BinsName, ChannelName, MetricName, Options, RotationName, SolverName};
pub use outcome::{Event, Outcome, Stage, Status};
pub use overlay::{Panel, outline_picture, overlay};
pub use pairs::{FEWEST_PAIRS, PairFit, fit_of_pairs, pose_and_focal_from_pairs, pose_from_pairs};
pub use parameters::{FocalSource, Refine};
pub use photo::{Photo, PhotoError};
pub use register::{Registration, register, search};
pub use texreg_optim::Stop;
pub use uncertainty::{FocalUncertainty, Uncertainty};
pub use viewer::{Projected, Shading, Skin, Viewer, pick};
pub use window::Window;
