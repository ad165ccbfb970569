//! Why there is no pose.

use std::fmt;

/// What keeps correspondences from having a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoSolution {
    /// Fewer usable correspondences than the solver needs.
    TooFew {
        /// With finite numbers and a pixel the lens can show.
        usable: usize,
        /// By this solver.
        needed: usize,
    },
    /// A coordinate is NaN or infinite.
    NotFinite,
    /// The model points lie on a line or coincide.
    Collinear,
    /// The model points lie in a plane, and this solver needs depth.
    Coplanar,
    /// The pixels coincide.
    OnePixel,
    /// The equations have no solution with every point in front of the camera.
    BehindCamera,
    /// No pose agrees with enough of the correspondences.
    NoConsensus,
}

impl fmt::Display for NoSolution {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::TooFew { usable, needed } => {
                write!(f, "{usable} usable correspondences, at least {needed} are needed")
            }
            Self::NotFinite => f.write_str("a coordinate is not a finite number"),
            Self::Collinear => f.write_str("the model points lie on a line or coincide"),
            Self::Coplanar => f.write_str("the model points lie in a plane"),
            Self::OnePixel => f.write_str("the pixels coincide"),
            Self::BehindCamera => f.write_str("no pose has every point in front of the camera"),
            Self::NoConsensus => f.write_str("no pose agrees with enough of the correspondences"),
        }
    }
}

impl std::error::Error for NoSolution {}
