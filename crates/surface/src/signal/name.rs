//! The signals by name, and the joint signal of several.
use std::fmt;
use std::str::FromStr;

use super::{Both, Colours, Components, Depth, Frame, Headlight, Normals, Ranked, Signal, Silhouette, Specular};
use crate::mesh::Mesh;

/// What a model can predict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SignalName {
    /// The normal in the camera frame, its x and y.
    Normals,
    /// The normal's y in the camera frame.
    Normals1,
    /// The normal in the camera frame, on the whole sphere.
    Normals3,
    /// The normal in the model's frame, on the whole sphere.
    ModelNormals,
    /// The scanner's reflectance.
    Reflectance,
    /// The share of the sky that a point sees.
    AmbientOcclusion,
    /// The mean curvature.
    Curvature,
    /// The direction that a glossy surface mirrors.
    Specular,
    /// The cosine between the normal and the direction to the camera.
    Headlight,
    /// The model's own colours.
    Colours,
    /// The distance from the camera.
    Depth,
    /// The model as against its background.
    Silhouette,
}

/// A signal was asked for that the model does not carry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the model has no {0}; leave out the signal '{0}'")]
pub struct NoSuchSignal(pub SignalName);

/// The cells of a joint signal are about this many, shared evenly by its dimensions.
const CELLS: f64 = 200.0;

/// A dimension has at most so many steps: of a direction's component, and of a number.
const DIRECTION_STEPS: usize = 10;
const NUMBER_STEPS: usize = 16;

/// A palette has at most so many colours.
const PALETTE: usize = 64;

impl SignalName {
    /// Every name, in the order of their documentation.
    pub const ALL: &[Self] = &[
        Self::Normals,
        Self::Normals1,
        Self::Normals3,
        Self::ModelNormals,
        Self::Reflectance,
        Self::AmbientOcclusion,
        Self::Curvature,
        Self::Specular,
        Self::Headlight,
        Self::Colours,
        Self::Depth,
        Self::Silhouette,
    ];

    /// Whether a model can show the signal.
    pub fn is_in(self, mesh: &Mesh) -> bool {
        match self {
            Self::Reflectance => mesh.reflectance.is_some(),
            Self::Colours => mesh.colours.is_some(),
            _ => true,
        }
    }

    /// How many numbers it takes to say what the signal tells apart.
    fn dimensions(self) -> usize {
        match self {
            Self::Normals | Self::Normals3 | Self::ModelNormals | Self::Specular | Self::Colours => 2,
            Self::Silhouette => 0,
            _ => 1,
        }
    }

    /// The signal with about `steps` bins for each of its dimensions; `None` if the model does not carry it.
    fn signal(self, mesh: &Mesh, steps: f64) -> Option<Box<dyn Signal>> {
        let number = (steps as usize).clamp(2, NUMBER_STEPS);
        let component = (steps.round() as usize).clamp(2, DIRECTION_STEPS);
        // What is seen is about half of the sphere.
        let side = ((steps * 2f64.sqrt()).round() as usize).clamp(3, DIRECTION_STEPS * 3 / 2);
        let normals = |components, frame, steps| Box::new(Normals { components, frame, steps });
        Some(match self {
            Self::Normals => normals(Components::Two, Frame::Camera, component),
            Self::Normals1 => normals(Components::One, Frame::Camera, number),
            Self::Normals3 => normals(Components::Three, Frame::Camera, side),
            Self::ModelNormals => normals(Components::Three, Frame::Model, side),
            Self::Reflectance => Box::new(Ranked::reflectance(mesh, number)?),
            Self::AmbientOcclusion => Box::new(Ranked::ambient_occlusion(mesh, number)),
            Self::Curvature => Box::new(Ranked::curvature(mesh, number)),
            Self::Specular => Box::new(Specular { steps: side }),
            Self::Headlight => Box::new(Headlight { steps: number }),
            Self::Colours => Box::new(Colours::new(mesh, ((steps * steps) as usize).clamp(2, PALETTE))?),
            Self::Depth => Box::new(Depth::new(mesh, number)),
            Self::Silhouette => Box::new(Silhouette),
        })
    }
}

/// The joint signal of several: a bin for each combination of theirs, about 200 altogether that can be seen. Of a name that is there twice, the
/// second counts for nothing; without a name it is the silhouette.
///
/// # Errors
/// The first signal that the model does not carry.
pub fn joint_signal(mesh: &Mesh, names: &[SignalName]) -> Result<Box<dyn Signal>, NoSuchSignal> {
    let mut distinct: Vec<SignalName> = Vec::new();
    for &name in names {
        if !distinct.contains(&name) {
            distinct.push(name);
        }
    }
    let dimensions: usize = distinct.iter().map(|name| name.dimensions()).sum();
    let steps = CELLS.powf(1.0 / dimensions.max(1) as f64);
    let signals = distinct.iter().map(|&name| name.signal(mesh, steps).ok_or(NoSuchSignal(name)));
    let joint = signals.reduce(|joint, signal| Ok(Box::new(Both(joint?, signal?))));
    joint.unwrap_or_else(|| Ok(Box::new(Silhouette)))
}

impl fmt::Display for SignalName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.pad(match self {
            Self::Normals => "normals",
            Self::Normals1 => "normals1",
            Self::Normals3 => "normals3",
            Self::ModelNormals => "model-normals",
            Self::Reflectance => "reflectance",
            Self::AmbientOcclusion => "ambient-occlusion",
            Self::Curvature => "curvature",
            Self::Specular => "specular",
            Self::Headlight => "headlight",
            Self::Colours => "colours",
            Self::Depth => "depth",
            Self::Silhouette => "silhouette",
        })
    }
}

impl FromStr for SignalName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::ALL.iter().find(|name| name.to_string() == text).copied().ok_or_else(|| {
            let known: Vec<String> = Self::ALL.iter().map(ToString::to_string).collect();
            format!("'{text}' is none of {}", known.join(", "))
        })
    }
}
