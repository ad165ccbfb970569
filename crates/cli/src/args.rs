//! What can be typed after `texreg`.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Parser, Subcommand};

/// Lays photographs onto scanned 3D models.
#[derive(Debug, Parser)]
#[command(name = "texreg", version, max_term_width = 100)]
pub(crate) struct Args {
    /// Work with at most this many threads [default: one a core]
    #[arg(long, global = true, value_name = "N")]
    pub(crate) threads: Option<NonZeroUsize>,
    /// Print the result to standard output as one JSON object
    #[arg(long, global = true)]
    pub(crate) json: bool,
    /// What to do.
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// The subcommands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Score cameras against the true ones
    Evaluate(Evaluate),
}

/// `texreg evaluate`
#[derive(Debug, clap::Args)]
pub(crate) struct Evaluate {
    /// The cameras to score: a cameras.json
    pub(crate) cameras: PathBuf,
    /// The true cameras: a cameras.json with bbox_diagonal, and width, height and visible_points in each entry
    #[arg(long, value_name = "FILE")]
    pub(crate) truth: PathBuf,
}
