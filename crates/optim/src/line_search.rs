//! How far to go in a direction: backtracking (L. Armijo, *Minimization of functions having Lipschitz continuous first partial
//! derivatives*, 1966), and the strong Wolfe conditions by bracketing and zooming (J. Nocedal & S. Wright, *Numerical
//! Optimization*, 2006, algorithms 3.5 and 3.6), for maximization: with φ(t) the value a step t along the direction,
//!
//! ```text
//! φ(t) ≥ φ(0) + c₁ t φ'(0)   and   |φ'(t)| ≤ c₂ φ'(0).
//! ```

/// A rule for the length of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineSearch {
    /// Halves the step until the value grows enough.
    Backtracking,
    /// Looks for a step where the value grows enough and the slope has become small.
    StrongWolfe,
}

/// The share of the slope's promise that a step must gain, c₁.
pub(crate) const SUFFICIENT: f64 = 1e-4;

/// The share of the slope that may be left, c₂.
pub(crate) const LEFT: f64 = 0.9;

/// The most evaluations of a search.
const TRIALS: usize = 25;

/// What a search found at a step: the value, and the slope where it was asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Probe {
    pub(crate) step: f64,
    pub(crate) value: f64,
    pub(crate) slope: f64,
}

impl LineSearch {
    /// The step to take, at most `longest`, starting with `first`. `evaluate(t)` gives the value and, if asked, the slope:
    /// `None` where the value is not defined. `None` if no step gains.
    pub(crate) fn search(
        self,
        start: Probe,
        first: f64,
        longest: f64,
        evaluate: &mut dyn FnMut(f64, bool) -> Option<Probe>,
    ) -> Option<Probe> {
        match self {
            Self::Backtracking => backtrack(start, first.min(longest), evaluate),
            Self::StrongWolfe => bracket(start, first.min(longest), longest, evaluate),
        }
    }
}

fn enough(start: &Probe, at: &Probe) -> bool {
    at.value >= start.value + SUFFICIENT * at.step * start.slope
}

fn backtrack(start: Probe, first: f64, evaluate: &mut dyn FnMut(f64, bool) -> Option<Probe>) -> Option<Probe> {
    let mut step = first;
    for _ in 0..TRIALS {
        let probe = evaluate(step, false);
        if let Some(probe) = probe.filter(|probe| enough(&start, probe) && probe.value > start.value) {
            return Some(probe);
        }
        step *= 0.5;
    }
    None
}

/// Goes on until the maximum is between two steps.
fn bracket(
    start: Probe,
    first: f64,
    longest: f64,
    evaluate: &mut dyn FnMut(f64, bool) -> Option<Probe>,
) -> Option<Probe> {
    let mut last = start;
    let mut step = first;
    for trial in 0..TRIALS {
        let Some(probe) = evaluate(step, true) else {
            return zoom(start, last, step, None, TRIALS - trial, evaluate);
        };
        if !enough(&start, &probe) || (trial > 0 && probe.value <= last.value) {
            return zoom(start, last, probe.step, Some(probe), TRIALS - trial, evaluate);
        }
        if probe.slope.abs() <= LEFT * start.slope {
            return Some(probe);
        }
        if probe.slope <= 0.0 {
            return zoom(start, probe, last.step, Some(last), TRIALS - trial, evaluate);
        }
        if step >= longest {
            return Some(probe);
        }
        last = probe;
        step = (2.5 * step).min(longest);
    }
    Some(last).filter(|last| last.value > start.value)
}

/// Narrows the bracket between `low`, the best step that gains enough, and the step `high` (and what is known of it).
fn zoom(
    start: Probe,
    mut low: Probe,
    mut high: f64,
    mut known: Option<Probe>,
    trials: usize,
    evaluate: &mut dyn FnMut(f64, bool) -> Option<Probe>,
) -> Option<Probe> {
    for _ in 0..trials {
        let width = high - low.step;
        // The maximum of the parabola through value and slope at `low` and the value at `high`, kept off the ends.
        let bend = known.map(|high| (high.value - low.value - low.slope * width) / (width * width));
        let share = bend.filter(|bend| *bend < 0.0).map_or(0.5, |bend| -0.5 * low.slope / (bend * width));
        let step = low.step + share.clamp(0.1, 0.9) * width;
        if (width * start.slope).abs() < f64::EPSILON * start.value.abs().max(f64::MIN_POSITIVE) {
            break;
        }
        let probe = evaluate(step, true);
        match probe.filter(|probe| enough(&start, probe) && probe.value > low.value) {
            None => (high, known) = (step, probe),
            Some(probe) => {
                if probe.slope.abs() <= LEFT * start.slope {
                    return Some(probe);
                }
                if probe.slope * width <= 0.0 {
                    (high, known) = (low.step, Some(low));
                }
                low = probe;
            }
        }
    }
    Some(low).filter(|low| low.step > 0.0 && low.value > start.value)
}
