//! What is refined: the pose always, and parts of the camera when asked.
//!
//! The tangent space has the pose's six components first, rotation then translation, and then those of the camera: `log f`
//! (both focal lengths by the same factor), the principal point in pixels, and `k1, k2, p1, p2, k3`. The rotation turns the
//! model about the origin of its frame.

use crate::bounds::Limits;
use nalgebra::{DMatrix, DVector, Matrix2x5, Rotation3, Vector2, Vector3};
use texreg_camera::{Camera, Projection, View};
use texreg_lie::{Chart, Pose};
use texreg_optim::{Manifold, Region};

/// Which parts of the camera are refined with the pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Refine {
    /// The focal length, one factor for both axes.
    pub focal: bool,
    /// The principal point.
    pub principal: bool,
    /// The five distortion coefficients.
    pub distortion: bool,
}

/// Where the focal length that a registration starts with comes from, and so how well it is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FocalSource {
    /// A calibration, or EXIF, which rounds it and does not know at what distance the lens was focused: to 3 %.
    #[default]
    Stated,
    /// A rough camera: to 20 %.
    Guessed,
}

impl FocalSource {
    /// The relative standard deviation.
    fn deviation(self) -> f64 {
        match self {
            Self::Stated => 0.03,
            Self::Guessed => 0.2,
        }
    }
}

/// The components of the pose in the tangent space.
pub(crate) const POSE: usize = 6;

/// How far log f goes by one step.
const FOCAL_STEP: f64 = 0.22;

/// The most components the tangent space can have.
pub(crate) const MOST: usize = POSE + 8;

impl Refine {
    /// The standard deviations of the camera's components before the photo was looked at.
    pub(crate) fn deviations(self, camera: &Camera, source: FocalSource) -> Vec<f64> {
        let principal = 0.01 * f64::from(camera.width.max(camera.height));
        let focal = self.focal.then_some(source.deviation());
        let principal = self.principal.then_some([principal; 2]);
        let distortion = self.distortion.then_some([0.1, 0.1, 0.002, 0.002, 0.05]);
        let rest = principal.into_iter().flatten().chain(distortion.into_iter().flatten());
        focal.into_iter().chain(rest).collect()
    }

    /// How far a camera is from another in the camera's components of a step.
    pub(crate) fn offset(self, from: &Camera, to: &Camera) -> Vec<f64> {
        let (a, b) = (&from.intrinsics, &to.intrinsics);
        let focal = self.focal.then(|| (b.fx / a.fx).ln());
        let principal = self.principal.then_some([b.cx - a.cx, b.cy - a.cy]);
        let (c, d) = (from.distortion.to_array(), to.distortion.to_array());
        let distortion = self.distortion.then(|| std::array::from_fn::<_, 5, _>(|i| d[i] - c[i]));
        let rest = principal.into_iter().flatten().chain(distortion.into_iter().flatten());
        focal.into_iter().chain(rest).collect()
    }

    /// The number of components of the tangent space.
    pub(crate) fn dimension(self) -> usize {
        POSE + self.camera()
    }

    /// The number of the camera's components.
    pub(crate) fn camera(self) -> usize {
        usize::from(self.focal) + 2 * usize::from(self.principal) + 5 * usize::from(self.distortion)
    }

    /// Writes the derivatives of `gradientᵀ · pixel` by the camera's components to `out`. The camera, its projection and the
    /// gradient are those of a level of `scale` pixels per pixel of the photo.
    #[inline]
    pub(crate) fn chain(
        self,
        camera: &Camera,
        scale: f64,
        projection: &Projection,
        gradient: &Vector2<f64>,
        out: &mut [f64],
    ) {
        let mut next = 0;
        let mut push = |value: f64| {
            out[next] = value;
            next += 1;
        };
        let by = |jacobian: &Matrix2x5<f64>, k: usize| jacobian.column(k).dot(gradient);
        if self.focal {
            let k = &camera.intrinsics;
            push(k.fx * by(&projection.intrinsics, 0) + k.fy * by(&projection.intrinsics, 1));
        }
        if self.principal {
            push(scale * by(&projection.intrinsics, 2));
            push(scale * by(&projection.intrinsics, 3));
        }
        if self.distortion {
            (0..5).for_each(|k| push(by(&projection.distortion, k)));
        }
    }
}

/// A gradient, and a dense curvature.
#[derive(Clone)]
pub(crate) struct Dense {
    pub(crate) gradient: DVector<f64>,
    pub(crate) curvature: DMatrix<f64>,
}

impl Dense {
    /// The derivatives by what moves the components through a chain of derivatives.
    pub(crate) fn pulled_by(&self, chain: &DMatrix<f64>) -> Self {
        Self { gradient: chain.tr_mul(&self.gradient), curvature: chain.tr_mul(&(&self.curvature * chain)) }
    }
}

/// The space of views: a rotation chart, a translation, and the parts of the camera that are refined.
///
/// Objectives know the tangent space alone, whose first three components are the rotation vector ω of `exp(ω) R`;
/// [`pull_back`](Self::pull_back) takes their derivatives to the chart.
pub(crate) struct ViewSpace<'a> {
    pub(crate) rotation: &'a (dyn Chart<Rotation3<f64>> + Sync),
    pub(crate) refine: Refine,
    pub(crate) limits: Limits,
}

impl ViewSpace<'_> {
    /// Derivatives by the tangent space to derivatives by a step of the chart.
    pub(crate) fn pull_back(&self, at: &View, tangent: &Dense) -> Dense {
        tangent.pulled_by(&self.chain(at, tangent.gradient.len()))
    }

    /// The derivatives of a tangent space of `dimension` components by a step of the chart.
    pub(crate) fn chain(&self, at: &View, dimension: usize) -> DMatrix<f64> {
        let turn = self.rotation.derivative(&at.pose.rotation);
        let rest = dimension - 3;
        let mut chain = DMatrix::zeros(dimension, turn.ncols() + rest);
        chain.view_mut((0, 0), turn.shape()).copy_from(&turn);
        chain.view_mut((3, turn.ncols()), (rest, rest)).fill_with_identity();
        chain
    }
}

impl Manifold<View> for ViewSpace<'_> {
    fn dimension(&self) -> usize {
        self.rotation.dimension() + self.refine.dimension() - 3
    }

    /// Within the chart's radius and the bounds, and a focal length at most a quarter longer or shorter by one step.
    fn region(&self, at: &View) -> Region {
        let turn = self.rotation.dimension();
        let [least, most] = self.limits.distance_step(at);
        let mut region = Region::default().ball(0..turn, self.rotation.radius()).bound(turn + 2, least, most);
        let mut next = turn + 3;
        if self.refine.focal {
            let [least, most] = self.limits.focal_step(at);
            region = region.bound(next, least.max(-FOCAL_STEP), most.min(FOCAL_STEP));
            next += 1;
        }
        if self.refine.principal {
            for (k, [least, most]) in self.limits.principal_step(at).into_iter().enumerate() {
                region = region.bound(next + k, least, most);
            }
        }
        region
    }

    fn retract(&self, at: &View, step: &DVector<f64>) -> Option<View> {
        let (turn, rest) = step.as_slice().split_at(self.rotation.dimension());
        let (shift, rest) = rest.split_at(3);
        let rotation = self.rotation.retract(&at.pose.rotation, turn)?;
        let pose = Pose::new(rotation, at.pose.translation + Vector3::from_column_slice(shift));
        let mut camera = at.camera;
        let mut rest = rest.iter();
        let mut next = || *rest.next().expect("a step has as many components as the manifold has dimensions");
        if self.refine.focal {
            let factor = next().exp();
            camera.intrinsics.fx *= factor;
            camera.intrinsics.fy *= factor;
        }
        if self.refine.principal {
            camera.intrinsics.cx += next();
            camera.intrinsics.cy += next();
        }
        if self.refine.distortion {
            camera.distortion = camera.distortion.to_array().map(|c| c + next()).into();
        }
        Some(self.limits.held(&View { camera, pose }))
    }
}
