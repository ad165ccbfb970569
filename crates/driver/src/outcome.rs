//! What a registration hands back, and what it tells on the way.

use crate::Uncertainty;
use texreg_camera::View;
use texreg_optim::Stop;

/// The verdict on a registration, the best first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Status {
    /// The view explains the photo.
    Registered,
    /// There are reasons for doubt.
    Uncertain,
    /// No view better than the start was found; the start is handed back.
    Failed,
}

/// What one stage of a registration did.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// What the stage did, and at which size of the photo: `search 1/8`, `climb 1/2`.
    pub name: String,
    /// How often the metric was evaluated.
    pub evaluations: usize,
    /// How often the model was rendered.
    pub renderings: usize,
    /// The metric before and after for the view that came out best, over the stage's own samples; for the search, its evidence.
    pub similarity: (f64, f64),
    /// Wall-clock time.
    pub milliseconds: f64,
}

/// The result of a registration.
#[derive(Clone, Debug, PartialEq)]
pub struct Outcome {
    /// The camera that was found; its pose takes the world to the camera frame.
    pub view: View,
    /// The verdict.
    pub status: Status,
    /// The verdict's reasons, in words; none where nothing speaks against the view.
    pub reasons: Vec<String>,
    /// The metric at full size at the start and for the view, each over what it shows itself.
    pub similarity: (f64, f64),
    /// Why the last climb to the view stopped.
    pub stop: Stop,
    /// How sure the view is; `None` where it is the start handed back.
    pub uncertainty: Option<Uncertainty>,
    /// The stages, in order.
    pub stages: Vec<Stage>,
}

impl Outcome {
    /// How often the metric was evaluated.
    pub fn evaluations(&self) -> usize {
        self.stages.iter().map(|stage| stage.evaluations).sum()
    }
}

/// What a registration tells while it runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Event {
    /// Stages done.
    pub done: usize,
    /// All stages.
    pub of: usize,
    /// The stage that is done.
    pub stage: Stage,
    /// The best view so far.
    pub view: View,
}
