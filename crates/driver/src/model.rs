//! A model made ready for registration.

use crate::Error;
use nalgebra::{Point3, Vector3};
use texreg_camera::View;
use texreg_surface::{Both, Components, Frame, Mesh, Normals, Ranked, Signal, SignalName, Viewpoint, joint_signal};

/// A mesh, what it predicts, and a coarse copy of it for small pictures: made once, for any number of photos.
pub struct Model<'a> {
    pub(crate) mesh: &'a Mesh,
    pub(crate) coarse: Mesh,
    signals: Vec<SignalName>,
    pub(crate) signal: Box<dyn Signal>,
    /// What it predicts of pictures in which little is told apart: in few bins.
    pub(crate) rough: Box<dyn Signal>,
    /// A few vertices, to measure how far apart two views are.
    probes: Vec<Point3<f64>>,
    /// The centre of the bounding box, in the model's frame.
    pub(crate) centre: Vector3<f64>,
}

/// Triangles of the coarse copy: enough for pictures of 200 pixels. With 8,000 paint is lost, and some views with it.
const COARSE: usize = 20_000;

impl<'a> Model<'a> {
    /// Makes a mesh ready. Several signals make a joint one; with none, the model predicts its normals and, where the
    /// scanner measured it, its reflectance.
    ///
    /// # Errors
    /// If the mesh does not carry a signal that is asked for.
    pub fn new(mesh: &'a Mesh, signals: &[SignalName]) -> Result<Self, Error> {
        let signals = if signals.is_empty() { measured(mesh) } else { signals };
        let signal = joint_signal(mesh, signals)?;
        let probes = mesh.positions.iter().step_by(mesh.positions.len() / 200 + 1);
        let coarse = mesh.simplified(COARSE);
        Ok(Self {
            mesh,
            rough: rough_signal(&coarse),
            coarse,
            signals: signals.to_vec(),
            signal,
            probes: probes.map(|p| p.map(f64::from).into()).collect(),
            centre: mesh.centre().coords - mesh.origin,
        })
    }

    /// The names of what is predicted.
    pub fn signals(&self) -> &[SignalName] {
        &self.signals
    }

    /// A view of the world as one of the model's own frame, whose origin is near its middle: coordinates are small there, and
    /// the model turns about itself.
    pub(crate) fn inward(&self, view: &View) -> View {
        self.shifted(view, self.mesh.origin)
    }

    /// The inverse of [`inward`](Self::inward).
    pub(crate) fn outward(&self, view: &View) -> View {
        self.shifted(view, -self.mesh.origin)
    }

    fn shifted(&self, view: &View, by: Vector3<f64>) -> View {
        let mut view = *view;
        view.pose.translation += view.pose.rotation * by;
        view
    }

    /// Whether a point of the model's frame lies within the photo.
    pub(crate) fn shows(&self, view: &View, point: &Point3<f64>) -> bool {
        let (width, height) = (f64::from(view.camera.width), f64::from(view.camera.height));
        view.project(point).is_some_and(|p| p.x > -0.5 && p.y > -0.5 && p.x < width - 0.5 && p.y < height - 0.5)
    }

    /// The share of the model's points that lie within the photo.
    pub(crate) fn inside(&self, view: &View) -> f64 {
        self.probes.iter().filter(|point| self.shows(view, point)).count() as f64 / self.probes.len() as f64
    }

    /// The mean distance between the pictures of the model's points in two views of its frame, in pixels of the photo;
    /// infinite where they have no point in common.
    pub(crate) fn distance(&self, a: &View, b: &View) -> f64 {
        let distances = self.probes.iter().filter_map(|p| Some((a.project(p)? - b.project(p)?).norm()));
        let (count, sum) = distances.fold((0, 0.0), |(count, sum), d| (count + 1, sum + d));
        if count == 0 { f64::INFINITY } else { sum / f64::from(count) }
    }
}

/// What a model predicts if nothing else is asked for: all that the scanner measured.
fn measured(mesh: &Mesh) -> &'static [SignalName] {
    if mesh.reflectance.is_some() { &[SignalName::Reflectance, SignalName::Normals] } else { &[SignalName::Normals] }
}

/// Normals in three steps along each axis and, where it was measured, reflectance in three ranks.
fn rough_signal(mesh: &Mesh) -> Box<dyn Signal> {
    let normals = Normals { components: Components::Two, frame: Frame::Camera, steps: 3 };
    match Ranked::reflectance(mesh, 3) {
        Some(reflectance) => Box::new(Both(reflectance, normals)),
        None => Box::new(normals),
    }
}

/// Whether a mesh is a scan from inside: a cloud whose bounding box holds the camera of a view of its frame.
pub(crate) fn surrounds(mesh: &Mesh, view: &View) -> bool {
    let (low, high) = mesh.bounds();
    let eye = view.pose.center() + mesh.origin;
    mesh.is_cloud && (0..3).all(|k| (low[k]..=high[k]).contains(&eye[k]))
}

/// The viewpoint of a view of the model's frame.
pub(crate) fn viewpoint(view: &View) -> Viewpoint {
    Viewpoint::new(view.pose.rotation.matrix(), &view.pose.translation)
}
