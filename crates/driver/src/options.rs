//! What a registration can be asked to do.

use crate::Refine;
use std::fmt;
use std::str::FromStr;
use texreg_mi::{ConditionalEntropy, EntropyCorrelation, Metric, MutualInformation, NormalizedMutualInformation};

/// The options of a registration. `Default` is the choice for a photo of which nothing is known.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// The measure of agreement.
    pub metric: MetricName,
    /// What the model predicts; several together make a joint signal, none lets the data decide.
    pub signal: Vec<SignalName>,
    /// The parts of the camera that are refined with the pose.
    pub refine: Refine,
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
        /// Minus the conditional entropy of the photo given the model.
        ConditionalEntropy = "ce",
    }
}

names! {
    /// What a model can predict.
    SignalName {
        /// The surface normal in the camera frame.
        Normals = "normals",
        /// The scanner's reflectance.
        Reflectance = "reflectance",
    }
}

names! {
    /// The charts a rotation is stepped in.
    RotationName {
        /// The Lie algebra around the current rotation.
        Lie = "lie",
    }
}

names! {
    /// The solvers.
    SolverName {
        /// Levenberg–Marquardt with the metric's curvature.
        LevenbergMarquardt = "lm",
    }
}

impl MetricName {
    /// The metric of this name.
    #[must_use]
    pub fn metric(self) -> &'static dyn Metric {
        match self {
            Self::MutualInformation => &MutualInformation,
            Self::Normalized => &NormalizedMutualInformation,
            Self::EntropyCorrelation => &EntropyCorrelation,
            Self::ConditionalEntropy => &ConditionalEntropy,
        }
    }
}
