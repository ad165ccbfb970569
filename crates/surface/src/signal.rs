//! Signals: what a model predicts of a photo at a surface point, as one of a few bins.
//!
//! A signal takes what it needs from the mesh's attributes and from the view; the mesh computes an attribute that no file
//! brought when it is first needed, and keeps it. Everything here is called for each sample of each rendering.
mod colours;
mod depth;
mod name;
mod normals;
mod ranked;
mod reflection;

use nalgebra::{Matrix3, Vector3};

use crate::mesh::Mesh;
pub use colours::Colours;
pub use depth::{Depth, Silhouette};
pub use name::{NoSuchSignal, SignalName, joint_signal};
pub use normals::{Components, Frame, Normals};
pub use ranked::Ranked;
pub use reflection::{Headlight, Specular};

/// A camera as signals see it: its axes, and where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewpoint {
    /// The rotation from the model to the camera frame (x right, y down, z forward).
    pub camera_from_mesh: Matrix3<f32>,
    /// The camera's centre in the model's frame, relative to its origin.
    pub centre: Vector3<f32>,
}

impl Viewpoint {
    /// The viewpoint of a pose relative to the mesh's origin: `X_cam = R position + t`.
    pub fn new(rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        Self { camera_from_mesh: rotation.cast(), centre: -(rotation.transpose() * translation).cast::<f32>() }
    }
}

/// A visible surface point: a place in a triangle, seen from a camera.
#[derive(Clone, Copy, Debug)]
pub struct Surfel<'a> {
    /// The model.
    pub mesh: &'a Mesh,
    /// The corners of the triangle.
    pub corners: [u32; 3],
    /// The barycentric coordinates of the point, one for each corner; they sum to one.
    pub weights: [f32; 3],
    /// Where it is seen from.
    pub viewpoint: &'a Viewpoint,
}

impl Surfel<'_> {
    /// The interpolated, unnormalized normal in the model's frame.
    #[inline]
    fn normal(&self) -> Vector3<f32> {
        self.vector(&self.mesh.normals)
    }

    /// From the point to the camera's centre, in the model's frame.
    #[inline]
    fn towards_camera(&self) -> Vector3<f32> {
        self.viewpoint.centre - self.vector(&self.mesh.positions)
    }

    /// The interpolated value of a vertex attribute of three numbers.
    #[inline]
    fn vector(&self, values: &[[f32; 3]]) -> Vector3<f32> {
        let mut sum = [0.0; 3];
        for (corner, weight) in self.corners.into_iter().zip(self.weights) {
            let value = &values[corner as usize];
            for k in 0..3 {
                sum[k] += weight * value[k];
            }
        }
        sum.into()
    }

    /// The interpolated value of a vertex attribute.
    #[inline]
    fn scalar(&self, values: &[f32]) -> f32 {
        self.corners.iter().zip(self.weights).map(|(&i, weight)| weight * values[i as usize]).sum()
    }
}

/// A prediction of the photo's values, coarse enough for a density: each surface point falls into one bin.
pub trait Signal: Send + Sync {
    /// The number of bins.
    fn bins(&self) -> usize;

    /// The bin of a point, below [`bins`](Self::bins).
    fn bin(&self, point: &Surfel) -> usize;

    /// Red, green and blue of the point in a picture of the signal, 0 to 1 each. It varies smoothly, where bins have steps.
    fn colour(&self, point: &Surfel) -> [f32; 3];

    /// Whether colours mean something beside one another only, so that a picture may take all the contrast there is.
    fn is_relative(&self) -> bool {
        false
    }
}

/// Two predictions at once: a bin for each pair of their bins.
pub struct Both<A, B>(
    /// The first.
    pub A,
    /// The second.
    pub B,
);

impl<A: Signal, B: Signal> Signal for Both<A, B> {
    fn bins(&self) -> usize {
        self.0.bins() * self.1.bins()
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        self.0.bin(point) * self.1.bins() + self.1.bin(point)
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        let (a, b) = (self.0.colour(point), self.1.colour(point));
        std::array::from_fn(|k| a[k] * b[k])
    }
}

impl<S: Signal + ?Sized> Signal for Box<S> {
    fn bins(&self) -> usize {
        (**self).bins()
    }

    #[inline]
    fn bin(&self, point: &Surfel) -> usize {
        (**self).bin(point)
    }

    fn colour(&self, point: &Surfel) -> [f32; 3] {
        (**self).colour(point)
    }

    fn is_relative(&self) -> bool {
        (**self).is_relative()
    }
}

/// The step of a value of `0..=1` in equal steps; what lies outside counts to the first or the last.
#[inline]
fn equal_step(value: f32, steps: usize) -> usize {
    ((value * steps as f32) as i32).clamp(0, steps as i32 - 1) as usize
}

/// The cell of a direction, of any length, among steps² cells that cover the sphere: the octahedron's faces folded out into a square,
/// with −z in its middle (Z. Cigolle et al., *A survey of efficient representations for independent unit vectors*, 2014).
#[inline]
fn sphere_cell(direction: &Vector3<f32>, steps: usize) -> usize {
    let [x, y, z] = (*direction).into();
    let scale = 1.0 / (x.abs() + y.abs() + z.abs());
    let (mut u, mut v) = (x * scale, y * scale);
    if z > 0.0 {
        (u, v) = ((1.0 - v.abs()).copysign(x), (1.0 - u.abs()).copysign(y));
    }
    equal_step(0.5 * v + 0.5, steps) * steps + equal_step(0.5 * u + 0.5, steps)
}

/// A grey for a value of `0..=1` that differs from the background's black.
fn grey(value: f32) -> [f32; 3] {
    [0.1 + 0.9 * value.clamp(0.0, 1.0); 3]
}

/// A direction as a colour: x (right), −y (up) and −z (towards the camera) as red, green and blue; black where there is none.
fn direction_colour(direction: &Vector3<f32>) -> [f32; 3] {
    direction.try_normalize(0.0).map_or([0.0; 3], |d| [d.x, -d.y, -d.z].map(|x| 0.5 + 0.5 * x))
}
