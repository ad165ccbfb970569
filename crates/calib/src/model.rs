//! Which parameters of a camera a calibration solves for.

use std::fmt;
use std::str::FromStr;
use texreg_camera::Camera;

/// The lens models to choose from, each with fx, fy, cx and cy and no skew; every one but the last is part of a later one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Model {
    /// No distortion.
    Pinhole,
    /// k1.
    Radial1,
    /// k1, k2.
    Radial2,
    /// k1, k2, p1, p2: Bouguet's default.
    Brown4,
    /// k1, k2, p1, p2, k3: OpenCV's default.
    Brown5,
}

/// Parameters of a camera in the order fx, fy, cx, cy, skew, k1, k2, p1, p2, k3.
pub(crate) const PARAMETERS: usize = 10;

impl Model {
    /// All of them, simplest first.
    pub const ALL: &[Self] = &[Self::Pinhole, Self::Radial1, Self::Radial2, Self::Brown4, Self::Brown5];

    /// The indices of its parameters in the order fx, fy, cx, cy, skew, k1, k2, p1, p2, k3.
    pub fn parameters(self) -> &'static [usize] {
        match self {
            Self::Pinhole => &[0, 1, 2, 3],
            Self::Radial1 => &[0, 1, 2, 3, 5],
            Self::Radial2 => &[0, 1, 2, 3, 5, 6],
            Self::Brown4 => &[0, 1, 2, 3, 5, 6, 7, 8],
            Self::Brown5 => &[0, 1, 2, 3, 5, 6, 7, 8, 9],
        }
    }

    /// A camera without the terms the model lacks.
    pub(crate) fn restrict(self, camera: &Camera) -> Camera {
        let mut values = to_array(camera);
        for (i, value) in values.iter_mut().enumerate() {
            if !self.parameters().contains(&i) {
                *value = 0.0;
            }
        }
        from_array(camera, &values)
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinhole => "pinhole",
            Self::Radial1 => "radial1",
            Self::Radial2 => "radial2",
            Self::Brown4 => "brown4",
            Self::Brown5 => "brown5",
        }
    }
}

impl fmt::Display for Model {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Model {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let found = Self::ALL.iter().find(|model| model.name() == name);
        found.copied().ok_or_else(|| format!("no lens model is called {name}"))
    }
}

/// The names of a camera's parameters, in the order of [`Model::parameters`]' indices.
pub const PARAMETER_NAMES: [&str; PARAMETERS] = ["fx", "fy", "cx", "cy", "skew", "k1", "k2", "p1", "p2", "k3"];

/// A camera's parameters in that order.
pub(crate) fn to_array(camera: &Camera) -> [f64; PARAMETERS] {
    let [fx, fy, cx, cy, skew] = camera.intrinsics.to_array();
    let [k1, k2, p1, p2, k3] = camera.distortion.to_array();
    [fx, fy, cx, cy, skew, k1, k2, p1, p2, k3]
}

/// A camera with those parameters.
pub(crate) fn from_array(camera: &Camera, values: &[f64; PARAMETERS]) -> Camera {
    let [fx, fy, cx, cy, skew, k1, k2, p1, p2, k3] = *values;
    Camera { intrinsics: [fx, fy, cx, cy, skew].into(), distortion: [k1, k2, p1, p2, k3].into(), ..*camera }
}
