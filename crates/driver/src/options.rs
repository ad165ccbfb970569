//! What a registration can be asked to do.

use crate::samples::SurfaceSamples;
use crate::{Bounds, FocalSource, Refine};
use nalgebra::Rotation3;
use std::fmt;
use std::str::FromStr;
use texreg_lie::{AxisAngle, Chart, Euler, InMatrices, InQuaternions, Left};
use texreg_mi::{
    ConditionalEntropy, Correlation, CorrelationRatio, EntropyCorrelation, Metric, MutualInformation,
    NormalizedMutualInformation, Parzen, SquaredDifference,
};

/// The options of a registration. `Default` is the choice for a photo of which nothing is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// The measure of agreement.
    pub metric: MetricName,
    /// What of the photo is compared.
    pub channel: ChannelName,
    /// How the photo's values are divided into bins.
    pub bins: BinsName,
    /// The chart a rotation is stepped in.
    pub rotation: RotationName,
    /// The solver that climbs.
    pub solver: SolverName,
    /// The parts of the camera that are refined with the pose.
    pub refine: Refine,
    /// How well the focal length is known before.
    pub focal_from: FocalSource,
    /// What the camera is kept to.
    pub bounds: Bounds,
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
        /// Mutual information, and `mi+gradient` on all levels of the photo but the coarsest.
        InformationThenGradient = "mi-then-gradient",
        /// Mutual information.
        MutualInformation = "mi",
        /// Normalized mutual information.
        Normalized = "nmi",
        /// The entropy correlation coefficient.
        EntropyCorrelation = "ecc",
        /// Minus the conditional entropy of the photo given the model.
        ConditionalEntropy = "ce",
        /// The correlation ratio.
        CorrelationRatio = "cr",
        /// The correlation with the shading of a light at the camera.
        Correlation = "ncc",
        /// Minus the mean squared difference from that shading.
        SquaredDifference = "ssd",
        /// The agreement of the model's edges with the photo's gradients.
        Gradient = "gradient",
        /// Mutual information times that agreement.
        InformationGradient = "mi-gradient",
        /// Mutual information and several times the log-likelihood of that agreement, in nats.
        InformationAndGradient = "mi+gradient",
        /// Minus the conditional entropy of the photo's silhouette given the model's.
        Silhouette = "silhouette",
        /// Mutual information and the silhouettes' entropy.
        InformationSilhouette = "mi-silhouette",
    }
}

names! {
    /// What of a photo is compared with the model.
    #[derive(Default)]
    ChannelName {
        #[default]
        /// Luma.
        Luma = "luma",
        /// Red, the nearest to the wavelength of most scanners.
        Red = "red",
        /// Green.
        Green = "green",
        /// Blue.
        Blue = "blue",
        /// The first principal component of the colours.
        Principal = "principal",
        /// Luma by its mean and deviation around each pixel.
        Contrast = "contrast",
        /// The magnitude of luma's gradient.
        Gradient = "gradient",
    }
}

names! {
    /// How the photo's values are divided into bins.
    #[derive(Default)]
    BinsName {
        #[default]
        /// Bins of equal width.
        Width = "width",
        /// Bins of equal frequency.
        Rank = "rank",
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

/// What is climbed: terms that are summed or multiplied. Edges and silhouettes are terms if the samples have them.
pub(crate) struct Terms {
    /// A metric over the joint density.
    pub(crate) density: Option<Box<dyn Metric>>,
    pub(crate) composition: Composition,
}

/// How terms make a whole.
#[derive(Clone, Copy)]
pub(crate) enum Composition {
    Sum,
    Product,
    /// The sum of a metric in nats and of several times the log-likelihood −ln(1 − G) of edges that agree by G: misaligned ones as
    /// normal in two numbers, the photo's gradient.
    Nats,
}

impl MetricName {
    /// The terms, for samples and the density that they are counted in.
    pub(crate) fn terms(self, samples: &SurfaceSamples, density: &Parzen) -> Terms {
        let shading = || samples.shading_by_bin(density.model_bins);
        let density: Option<Box<dyn Metric>> = match self {
            Self::MutualInformation
            | Self::InformationThenGradient
            | Self::InformationGradient
            | Self::InformationAndGradient
            | Self::InformationSilhouette => Some(Box::new(MutualInformation)),
            Self::Normalized => Some(Box::new(NormalizedMutualInformation)),
            Self::EntropyCorrelation => Some(Box::new(EntropyCorrelation)),
            Self::ConditionalEntropy => Some(Box::new(ConditionalEntropy)),
            Self::CorrelationRatio => Some(Box::new(CorrelationRatio)),
            Self::Correlation => Some(Box::new(Correlation { model: shading() })),
            Self::SquaredDifference => {
                Some(Box::new(SquaredDifference { model: shading(), photo: density.photo_values() }))
            }
            Self::Gradient | Self::Silhouette => None,
        };
        let composition = match self {
            Self::InformationGradient => Composition::Product,
            Self::InformationAndGradient => Composition::Nats,
            _ => Composition::Sum,
        };
        Terms { density, composition }
    }

    /// What is climbed on all levels but the coarsest, where that is another metric.
    pub(crate) fn finer(self) -> Option<Self> {
        (self == Self::InformationThenGradient).then_some(Self::InformationAndGradient)
    }

    /// The unit of its values, as a suffix to a number; empty where they have none.
    pub(crate) fn unit(self) -> &'static str {
        match self {
            Self::InformationThenGradient
            | Self::MutualInformation
            | Self::ConditionalEntropy
            | Self::InformationAndGradient
            | Self::Silhouette
            | Self::InformationSilhouette => " nats",
            Self::Normalized
            | Self::EntropyCorrelation
            | Self::CorrelationRatio
            | Self::Correlation
            | Self::SquaredDifference
            | Self::Gradient
            | Self::InformationGradient => "",
        }
    }

    /// Whether the model's edges are a term.
    pub(crate) fn has_edges(self) -> bool {
        matches!(self, Self::Gradient | Self::InformationGradient | Self::InformationAndGradient)
    }

    /// Whether the silhouettes are a term.
    pub(crate) fn has_silhouettes(self) -> bool {
        matches!(self, Self::Silhouette | Self::InformationSilhouette)
    }

    /// Whether the model's shading is compared.
    pub(crate) fn has_shading(self) -> bool {
        matches!(self, Self::Correlation | Self::SquaredDifference)
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
