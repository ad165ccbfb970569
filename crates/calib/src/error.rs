//! Why there is no calibration.

use std::fmt;

/// What keeps photographs of a board from having a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Error {
    /// Fewer photographs of the board than it takes.
    TooFew {
        /// That show the board.
        found: usize,
        /// For a calibration.
        needed: usize,
    },
    /// The corners of a photograph are on a line, coincide or are not finite.
    Degenerate {
        /// Its index.
        photo: usize,
    },
    /// All boards face the camera, so that a longer lens farther away would see the same.
    ParallelToImage {
        /// The largest angle between a board and the image, degrees.
        tilt: f64,
    },
    /// All boards lie the same way, so that they are as good as one.
    ParallelBoards {
        /// The largest angle between two boards, degrees.
        spread: f64,
    },
    /// The photographs leave the focal length open.
    Undetermined {
        /// Its standard deviation over its value.
        deviation: f64,
    },
    /// No camera explains the corners: no start made sense, or the fit left the lens model's domain.
    NoFit,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        const TILT: &str = "tilt the board by 20° to 45°, differently in each photo";
        match self {
            Self::TooFew { found, needed } => {
                let s = if *found == 1 { "" } else { "s" };
                write!(f, "{found} photo{s} with a usable board, at least {needed} are needed")
            }
            Self::Degenerate { photo } => write!(f, "photo number {}: its corners span no plane", photo + 1),
            Self::ParallelToImage { tilt } => {
                write!(
                    f,
                    "all boards are parallel to the image (within {tilt:.1}°), which leaves the focal length open; {TILT}"
                )
            }
            Self::ParallelBoards { spread } => {
                write!(
                    f,
                    "all boards are parallel to each other (within {spread:.1}°), which leaves the camera open; {TILT}"
                )
            }
            Self::Undetermined { deviation } => {
                let percent = 100.0 * deviation;
                write!(
                    f,
                    "the photos leave the focal length open (standard deviation {percent:.0} %); {TILT}, and take more"
                )
            }
            Self::NoFit => {
                write!(f, "no camera explains the corners; check that all photos are of one camera and one zoom")
            }
        }
    }
}

impl std::error::Error for Error {}
