//! What is known of one photo at one moment: what undo brings back.

use nalgebra::{Point2, Point3};
use serde_json::Value;
use texreg_camera::View;
use texreg_driver::Status;
use texreg_posit::Correspondence;

/// A point of the model and the pixel that shows it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pair {
    /// Its number, never given twice within a photo.
    pub(crate) id: u32,
    /// What it is called, empty for nothing.
    pub(crate) name: String,
    /// The two ends.
    pub(crate) ends: Correspondence,
}

/// A pair of which one end is clicked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Half {
    /// A pixel of the photo.
    Photo(Point2<f64>),
    /// A point of the model, in the world.
    Model(Point3<f64>),
}

/// Where a camera comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Source {
    /// A file that was there before.
    File,
    /// The pairs.
    Pairs,
    /// A person's keys.
    Hand,
    /// A registration.
    Registration,
}

impl Source {
    /// Every source.
    pub(crate) const ALL: [Self; 4] = [Self::File, Self::Pairs, Self::Hand, Self::Registration];

    /// Its name in `cameras.json`.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::File => "file",
            Self::Pairs => "pairs",
            Self::Hand => "hand",
            Self::Registration => "registration",
        }
    }
}

/// What a registration said of its result.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Verdict {
    pub(crate) status: Status,
    pub(crate) reasons: Vec<String>,
    /// The metric at the start and at the end.
    pub(crate) similarity: (f64, f64),
    /// How sure the camera is, as `cameras.json` has it; null where that cannot be said.
    pub(crate) uncertainty: Value,
}

/// A photo's camera.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Placed {
    pub(crate) view: View,
    pub(crate) source: Source,
    pub(crate) verdict: Option<Verdict>,
    /// Whether a person looked at it and found it right.
    pub(crate) accepted: bool,
}

impl Placed {
    /// A camera nobody has judged.
    pub(crate) fn new(view: View, source: Source) -> Self {
        Self { view, source, verdict: None, accepted: false }
    }
}

/// What is known of a photo.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Moment {
    pub(crate) pairs: Vec<Pair>,
    pub(crate) pending: Option<Half>,
    pub(crate) camera: Option<Placed>,
}

impl Moment {
    /// The pairs' ends.
    pub(crate) fn correspondences(&self) -> Vec<Correspondence> {
        self.pairs.iter().map(|pair| pair.ends).collect()
    }

    /// How far along the photo is, in one word.
    pub(crate) fn status(&self) -> &'static str {
        match &self.camera {
            None => "todo",
            Some(camera) if camera.accepted => "accepted",
            Some(Placed { verdict: None, .. }) => "picked",
            Some(Placed { verdict: Some(verdict), .. }) => word(verdict.status),
        }
    }
}

/// A verdict in one word, as in `cameras.json`.
pub(crate) fn word(status: Status) -> &'static str {
    match status {
        Status::Registered => "registered",
        Status::Uncertain => "uncertain",
        Status::Failed => "failed",
    }
}
