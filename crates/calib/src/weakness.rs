//! What photographs of a board leave poorly determined, in words.

use crate::model::PARAMETER_NAMES;
use crate::{BoardCorner, Calibration, model};
use std::fmt;

/// The image in ninths, and how many photos show the board in each.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Coverage {
    /// Photos with a corner there, by row from the top, then by column from the left.
    pub photos: [[usize; 3]; 3],
}

/// What the ninths are called.
pub const NINTHS: [[&str; 3]; 3] = [
    ["top-left corner", "top", "top-right corner"],
    ["left", "middle", "right"],
    ["bottom-left corner", "bottom", "bottom-right corner"],
];

impl Coverage {
    /// The coverage of an image of `size` pixels by the corners of photos.
    pub fn new<'a>(size: [u32; 2], photos: impl Iterator<Item = &'a [BoardCorner]>) -> Self {
        let mut counts = [[0; 3]; 3];
        let ninth = |x: f64, size: u32| (3.0 * (x + 0.5) / f64::from(size)).clamp(0.0, 2.0) as usize;
        for corners in photos {
            let mut seen = [[false; 3]; 3];
            for c in corners {
                seen[ninth(c.pixel.y, size[1])][ninth(c.pixel.x, size[0])] = true;
            }
            for (counts, seen) in counts.iter_mut().flatten().zip(seen.iter().flatten()) {
                *counts += usize::from(*seen);
            }
        }
        Self { photos: counts }
    }
}

/// Something that more or other photos would determine better.
#[derive(Clone, Debug, PartialEq)]
pub enum Weakness {
    /// Few photos show the board in a part of the image, so that the lens is guessed there.
    Uncovered {
        /// Which part.
        part: &'static str,
        /// How many do.
        photos: usize,
    },
    /// A distortion term that may as well be zero.
    Insignificant {
        /// Its name.
        parameter: &'static str,
        /// Its value.
        value: f64,
        /// Its standard deviation.
        deviation: f64,
    },
    /// A focal length or principal point with a large standard deviation.
    Loose {
        /// Its name.
        parameter: &'static str,
        /// Its standard deviation, pixels.
        deviation: f64,
    },
    /// The boards are hardly tilted.
    Flat {
        /// The largest angle between a board and the image, degrees.
        tilt: f64,
    },
    /// Few photos.
    Few {
        /// How many.
        photos: usize,
    },
}

/// A part of the image that fewer photos show is poorly covered.
const COVERED: usize = 3;

/// Fewer photos than this are few.
const MANY: usize = 8;

/// Boards should be tilted this far, degrees.
const TILTED: f64 = 15.0;

/// A focal length or principal point should be known to this share of the image's longer side.
const TIGHT: f64 = 0.003;

/// What a calibration leaves poorly determined, from the corners it was made of.
pub fn weaknesses(calibration: &Calibration, photos: &[Vec<BoardCorner>]) -> Vec<Weakness> {
    let size = [calibration.camera.width, calibration.camera.height];
    let used = || calibration.photos.iter().filter(|photo| !photo.is_outlier);
    let shown = calibration.photos.iter().zip(photos).filter(|(fit, _)| !fit.is_outlier).map(|(_, c)| c.as_slice());
    let mut found = Vec::new();
    let count = used().count();
    if count < MANY {
        found.push(Weakness::Few { photos: count });
    }
    let tilt = used().map(|photo| photo.tilt().to_degrees()).fold(0.0, f64::max);
    if tilt < TILTED {
        found.push(Weakness::Flat { tilt });
    }
    let coverage = Coverage::new(size, shown);
    for (part, &photos) in NINTHS.iter().flatten().zip(coverage.photos.iter().flatten()) {
        if photos < COVERED {
            found.push(Weakness::Uncovered { part, photos });
        }
    }
    let values = model::to_array(&calibration.camera);
    let longer = f64::from(size[0].max(size[1]));
    for &i in calibration.model.parameters() {
        let (parameter, value, deviation) = (PARAMETER_NAMES[i], values[i], calibration.deviations[i]);
        if i < 4 && deviation > TIGHT * longer {
            found.push(Weakness::Loose { parameter, deviation });
        } else if i > 4 && value.abs() < 2.0 * deviation {
            found.push(Weakness::Insignificant { parameter, value, deviation });
        }
    }
    found
}

impl fmt::Display for Weakness {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let shows = |n: usize| match n {
            0 => "no photo shows".to_owned(),
            1 => "only 1 photo shows".to_owned(),
            n => format!("only {n} photos show"),
        };
        match self {
            Self::Uncovered { part, photos } => {
                write!(f, "{} the board in the {part} of the image: the lens is guessed there", shows(*photos))
            }
            Self::Insignificant { parameter, value, deviation } => {
                write!(f, "{parameter} = {value:.5} ± {deviation:.5} may as well be zero")
            }
            Self::Loose { parameter, deviation } => write!(f, "{parameter} is known to ± {deviation:.1} px only"),
            Self::Flat { tilt } => {
                write!(f, "no board is tilted by more than {tilt:.0}°: the focal length rests on little")
            }
            Self::Few { photos } => write!(f, "{photos} photos are few: take {MANY} or more"),
        }
    }
}
