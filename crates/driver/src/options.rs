//! What a registration can be asked to do.

use crate::Refine;
use nalgebra::Rotation3;
use std::fmt;
use std::str::FromStr;
use texreg_lie::{AxisAngle, Chart, Euler, InMatrices, InQuaternions, Left};
use texreg_mi::{EntropyCorrelation, Metric, MutualInformation, NormalizedMutualInformation};

/// The options of a registration. `Default` is the choice for a photo of which nothing is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// The measure of agreement.
    pub metric: MetricName,
    /// The chart a rotation is stepped in.
    pub rotation: RotationName,
    /// The solver that climbs.
    pub solver: SolverName,
    /// The parts of the camera that are refined with the pose.
    pub refine: Refine,
    /// Whether one camera took all photos that are registered jointly: what is refined of it is the same for all.
    pub share_intrinsics: bool,
    /// The seed of everything random.
    pub seed: u64,
}

macro_rules! names {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $text:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name { $($(#[$variant_doc])* $variant),+ }

        impl $name {
            /// Every value, in the order of their documentation.
            pub const ALL: &[Self] = &[$(Self::$variant),+];
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.pad(match self { $(Self::$variant => $text),+ })
            }
        }

        impl FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                Self::ALL.iter().find(|value| value.to_string() == text).copied().ok_or_else(|| {
                    let known: Vec<String> = Self::ALL.iter().map(ToString::to_string).collect();
                    format!("'{text}' is none of {}", known.join(", "))
                })
            }
        }
    };
}

names! {
    /// The measures of agreement.
    #[derive(Default)]
    MetricName {
        #[default]
        /// Mutual information.
        MutualInformation = "mi",
        /// Normalized mutual information.
        Normalized = "nmi",
        /// The entropy correlation coefficient.
        EntropyCorrelation = "ecc",
    }
}

names! {
    /// The charts a rotation is stepped in.
    #[derive(Default)]
    RotationName {
        /// The Lie algebra around the current rotation.
        #[default]
        Lie = "lie",
        /// The rotation vector, rescaled to at most half a turn.
        AxisAngle = "axis-angle",
        /// Euler angles, rescaled around the gimbal lock.
        Euler = "euler",
        /// Quaternions in R⁴, normalized after each step.
        Quaternion = "quaternion",
        /// Matrices in R⁹, brought back to the nearest rotation after each step.
        Matrix = "matrix",
    }
}

names! {
    /// The solvers.
    #[derive(Default)]
    SolverName {
        /// Levenberg–Marquardt with the metric's curvature.
        #[default]
        LevenbergMarquardt = "lm",
        /// Steepest ascent with backtracking.
        Gradient = "gradient",
        /// Nonlinear conjugate gradients.
        ConjugateGradient = "cg",
        /// The quasi-Newton method of Broyden, Fletcher, Goldfarb and Shanno.
        Bfgs = "bfgs",
        /// The same with a memory of eight steps.
        LimitedBfgs = "lbfgs",
        /// Stochastic gradients on random batches of samples.
        StochasticGradient = "sgd",
        /// Powell's quadratic models, without derivatives.
        Bobyqa = "bobyqa",
        /// The simplex of Nelder and Mead, without derivatives.
        NelderMead = "nelder-mead",
    }
}

impl MetricName {
    /// The metric of this name.
    pub fn metric(self) -> &'static dyn Metric {
        match self {
            Self::MutualInformation => &MutualInformation,
            Self::Normalized => &NormalizedMutualInformation,
            Self::EntropyCorrelation => &EntropyCorrelation,
        }
    }
}

impl MetricName {
    /// The metric's value where the model tells nothing of the photo.
    pub(crate) fn independent(self) -> f64 {
        match self {
            Self::Normalized => 1.0,
            Self::MutualInformation | Self::EntropyCorrelation => 0.0,
        }
    }
}

impl RotationName {
    /// The chart of this name.
    pub fn chart(self) -> &'static (dyn Chart<Rotation3<f64>> + Sync) {
        match self {
            Self::Lie => &Left,
            Self::AxisAngle => &AxisAngle,
            Self::Euler => &Euler,
            Self::Quaternion => &InQuaternions,
            Self::Matrix => &InMatrices,
        }
    }
}
