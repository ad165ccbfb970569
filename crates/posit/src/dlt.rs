//! Resectioning: the 3×4 projection matrix from six or more points that span space, nothing known about the camera.
//!
//! The direct linear transformation stacks two equations a point, `u P₃X − P₁X = 0` and `v P₃X − P₂X = 0`, and takes the
//! right singular vector of the smallest singular value, in normalized coordinates; the geometric error is then minimized
//! over the twelve entries of P by Levenberg–Marquardt, their common scale left to the damping (R. Hartley &
//! A. Zisserman, *Multiple View Geometry in Computer Vision*, 2004, algorithm 7.1, the Gold Standard).
//!
//! Fails for points in a plane, and on a twisted cubic through the camera centre.

use crate::normal::Normal;
use crate::{Correspondence, NoSolution};
use nalgebra::{DMatrix, Matrix3, Matrix3x4, Matrix4, Point3};
use texreg_camera::{ProjectionMatrix, normalize_plane, normalize_space};

/// Points needed.
const NEEDED: usize = 6;

/// The projection matrix with the least algebraic error, of unit norm; exact for exact data.
pub fn dlt(correspondences: &[Correspondence]) -> Result<ProjectionMatrix, NoSolution> {
    let normalized = Normalized::new(correspondences)?;
    let p = normalized.linear()?;
    normalized.leave(&p)
}

/// The projection matrix with the least reprojection error, of unit norm, from that of [`dlt`].
pub fn resection(correspondences: &[Correspondence]) -> Result<ProjectionMatrix, NoSolution> {
    let normalized = Normalized::new(correspondences)?;
    let p = normalized.refine(&normalized.linear()?)?;
    normalized.leave(&p)
}

/// Correspondences in coordinates of order one.
struct Normalized {
    correspondences: Vec<Correspondence>,
    plane: Matrix3<f64>,
    space: Matrix4<f64>,
}

impl Normalized {
    fn new(correspondences: &[Correspondence]) -> Result<Self, NoSolution> {
        let usable = correspondences.len();
        if usable < NEEDED {
            return Err(NoSolution::TooFew { usable, needed: NEEDED });
        }
        if correspondences.iter().any(|c| c.point.iter().chain(c.pixel.iter()).any(|x| !x.is_finite())) {
            return Err(NoSolution::NotFinite);
        }
        if correspondences.iter().all(|c| c.pixel == correspondences[0].pixel) {
            return Err(NoSolution::OnePixel);
        }
        let points: Vec<Point3<f64>> = correspondences.iter().map(|c| c.point).collect();
        let pixels: Vec<_> = correspondences.iter().map(|c| c.pixel).collect();
        let (plane, space) = (normalize_plane(&pixels), normalize_space(&points));
        let inner =
            |c: &Correspondence| Correspondence::new(space.transform_point(&c.point), plane.transform_point(&c.pixel));
        Ok(Self { correspondences: correspondences.iter().map(inner).collect(), plane, space })
    }

    fn linear(&self) -> Result<ProjectionMatrix, NoSolution> {
        let mut a = DMatrix::zeros(2 * self.correspondences.len(), 12);
        for (i, c) in self.correspondences.iter().enumerate() {
            let x = c.point.to_homogeneous();
            for k in 0..4 {
                // Columns are the entries of P column by column.
                a[(2 * i, 3 * k)] = -x[k];
                a[(2 * i, 3 * k + 2)] = c.pixel.x * x[k];
                a[(2 * i + 1, 3 * k + 1)] = -x[k];
                a[(2 * i + 1, 3 * k + 2)] = c.pixel.y * x[k];
            }
        }
        let svd = a.svd(false, true);
        let (values, v_t) = (svd.singular_values, svd.v_t.ok_or(NoSolution::Coplanar)?);
        // A second null vector means that P is not determined.
        if values[10] <= 1e-10 * values[0] {
            return Err(NoSolution::Coplanar);
        }
        let p = ProjectionMatrix(Matrix3x4::from_iterator(v_t.row(11).iter().copied()));
        let in_front = self.correspondences.iter().all(|c| p.project(&c.point).is_some());
        if in_front { Ok(p) } else { Err(NoSolution::BehindCamera) }
    }

    fn refine(&self, start: &ProjectionMatrix) -> Result<ProjectionMatrix, NoSolution> {
        let mut p = *start;
        let (mut cost, mut normal) = self.linearize(&p).ok_or(NoSolution::BehindCamera)?;
        let mut damping = 1e-4;
        for _ in 0..50 {
            let Some(step) = normal.step(damping) else {
                damping *= 10.0;
                continue;
            };
            let moved = p.0 + Matrix3x4::from_column_slice(step.as_slice());
            let next = ProjectionMatrix(moved / moved.norm());
            match self.linearize(&next) {
                Some((next_cost, next_normal)) if next_cost <= cost => {
                    let settled = cost - next_cost <= 1e-14 * cost;
                    (p, cost, normal) = (next, next_cost, next_normal);
                    damping = (0.1 * damping).max(1e-9);
                    if settled {
                        break;
                    }
                }
                _ if step.norm() < 1e-12 => break,
                _ => damping *= 10.0,
            }
        }
        Ok(p)
    }

    fn linearize(&self, p: &ProjectionMatrix) -> Option<(f64, Normal<12>)> {
        let mut normal = Normal::new();
        let mut cost = 0.0;
        for c in &self.correspondences {
            let (pixel, jacobian) = p.project_with_jacobian(&c.point)?;
            let residual = pixel - c.pixel;
            let row = |r: usize| std::array::from_fn(|k| jacobian[(r, k)]);
            normal.add([&row(0), &row(1)], [residual.x, residual.y]);
            cost += residual.norm_squared();
        }
        cost.is_finite().then_some((cost, normal))
    }

    fn leave(&self, p: &ProjectionMatrix) -> Result<ProjectionMatrix, NoSolution> {
        let inverse = self.plane.try_inverse().ok_or(NoSolution::OnePixel)?;
        let p = inverse * p.0 * self.space;
        Ok(ProjectionMatrix(p / p.norm()))
    }
}
