//! What a person can do to a photo, as the page sends it.

use serde::Deserialize;

/// The longest name of a pair, in characters.
const LONGEST: usize = 60;

/// The most pairs of a photo.
pub(crate) const MOST_PAIRS: usize = 500;

/// A change of one photo.
#[derive(Clone, Debug, Deserialize)]
#[serde(tag = "do", rename_all = "lowercase", deny_unknown_fields)]
pub(crate) enum Action {
    /// A click into the photo: half a pair, or the other half.
    Photo { uv: [f64; 2] },
    /// A click onto the model.
    Model { xyz: [f64; 3] },
    /// Let go of half a pair.
    Drop,
    /// Move an end of a pair, or both. Moves of one gesture are undone together.
    Move { pair: u32, uv: Option<[f64; 2]>, xyz: Option<[f64; 3]>, gesture: u64 },
    /// Take a pair away.
    Delete { pair: u32 },
    /// Call a pair something.
    Rename { pair: u32, name: String },
    /// Move the camera by hand.
    Nudge { shift: [f64; 2], turn: [f64; 3], distance: f64, gesture: u64 },
    /// Go back to the pose of the pairs.
    Pairs,
    /// The camera is right.
    Accept,
    /// It is not, after all.
    Reopen,
    /// Go back by one step.
    Undo,
    /// Go forth again.
    Redo,
}

impl Action {
    /// Checks the numbers and the words.
    pub(crate) fn check(&self) -> Result<(), String> {
        let finite = |numbers: &[f64]| {
            let good = numbers.iter().all(|x| x.is_finite() && x.abs() < 1e12);
            if good { Ok(()) } else { Err("a coordinate is not a finite number".to_owned()) }
        };
        match self {
            Self::Photo { uv } => finite(uv),
            Self::Model { xyz } => finite(xyz),
            Self::Move { uv, xyz, .. } => finite(&uv.unwrap_or_default()).and(finite(&xyz.unwrap_or_default())),
            Self::Nudge { shift, turn, distance, .. } => {
                finite(shift).and(finite(turn))?;
                if (0.1..=10.0).contains(distance) { Ok(()) } else { Err("the step is too large".to_owned()) }
            }
            Self::Rename { name, .. } if name.chars().count() > LONGEST => {
                Err(format!("a name has at most {LONGEST} characters"))
            }
            _ => Ok(()),
        }
    }

    /// The gesture this is a part of.
    pub(crate) fn gesture(&self) -> Option<u64> {
        match self {
            Self::Move { gesture, .. } | Self::Nudge { gesture, .. } => Some(*gesture),
            _ => None,
        }
    }
}
