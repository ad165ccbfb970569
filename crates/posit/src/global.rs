//! Poses from n ≥ 3 points: every minimum of the depth-weighted reprojection error.
//!
//! With r the nine entries of R, row by row, the error `Σ (X − x Z)² + (Y − y Z)²` over the points (X, Y, Z) = R p + t is
//! quadratic in (r, t); eliminating t leaves `rᵀ Ω r` with a 9×9 matrix gathered in one pass, whatever n is
//! (G. Terzakis & M. Lourakis, *A Consistently Fast and Globally Optimal Solution to the Perspective-n-Point Problem*,
//! ECCV 2020, SQPnP). There its minima over SO(3) are sought by sequential quadratic programming in R⁹ from the eigenvectors
//! of Ω; here by Newton's method on SO(3) itself, whose Hessian is exact and 3×3, from the best of the 24 rotations of the
//! cube. No eigenvectors are needed, so four points (Ω of rank 5) and plane sets (rank 6) are no special cases.
//!
//! The points must not lie on a line. What comes back are local minima with the points' centroid in front of the camera,
//! the least error first: normally the pose, and for shallow sets its mirror image in depth.

use crate::frame::Frame;
use crate::{Bearing, NoSolution};
use nalgebra::{Matrix3, Matrix4, Rotation3, SMatrix, SVector, Vector2, Vector3};
use texreg_lie::{Pose, so3};

type Matrix9 = SMatrix<f64, 9, 9>;
type Vector9 = SVector<f64, 9>;
type Matrix9x3 = SMatrix<f64, 9, 3>;

/// How many starts are followed to their minimum: with few points there are more minima.
const FOLLOWED: usize = 8;
const FOLLOWED_OF_MANY: usize = 5;
const MANY: usize = 11;

/// The local minima of the depth-weighted reprojection error, best first, as `camera_from_world`.
pub fn global(bearings: &[Bearing]) -> Result<Vec<Pose>, NoSolution> {
    if bearings.len() < 3 {
        return Err(NoSolution::TooFew { usable: bearings.len(), needed: 3 });
    }
    let frame = Frame::new(bearings.iter().map(|b| b.point))?;
    let inner = bearings.iter().map(|b| Bearing { point: frame.enter(&b.point), image: b.image });
    let minima = minima(inner)?;
    let poses: Vec<Pose> = minima.into_iter().flatten().map(|m| frame.leave(&m.pose)).collect();
    if poses.is_empty() { Err(NoSolution::BehindCamera) } else { Ok(poses) }
}

/// A local minimum.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Minimum {
    pub(crate) pose: Pose,
    pub(crate) error: f64,
}

/// The minima for points whose coordinates are centred on the origin and of order one.
pub(crate) fn minima(bearings: impl Iterator<Item = Bearing>) -> Result<[Option<Minimum>; FOLLOWED], NoSolution> {
    let form = Form::new(bearings)?;
    let mut starts = [(f64::INFINITY, Matrix3::zeros()); FOLLOWED];
    for rotation in cube_rotations() {
        let error = form.error(&rotation).0;
        if error < starts[FOLLOWED - 1].0 {
            starts[FOLLOWED - 1] = (error, rotation);
            starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
    }
    let mut found = [None; FOLLOWED];
    let followed = if form.count < MANY { FOLLOWED } else { FOLLOWED_OF_MANY };
    for (_, start) in starts.into_iter().take(followed).filter(|s| s.0.is_finite()) {
        insert(&mut found, form.descend_in_front(start));
    }
    // A shallow set looks much the same mirrored in depth: reflect about the image plane, and the thin axis back.
    if let Some(best) = found[0] {
        let v = best.pose.translation.normalize();
        let mirror = Matrix3::identity() - v * v.transpose() * 2.0;
        let start = mirror * best.pose.rotation.matrix() * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        insert(&mut found, form.descend_in_front(start));
    }
    Ok(found)
}

/// Keeps the list sorted and free of doubles.
fn insert(found: &mut [Option<Minimum>; FOLLOWED], new: Option<Minimum>) {
    let Some(new) = new else { return };
    let same = |m: &Minimum| (m.pose.rotation.matrix() - new.pose.rotation.matrix()).norm() < 1e-3;
    if found.iter().flatten().any(same) {
        return;
    }
    let Some(i) = found.iter().position(|m| m.is_none_or(|m| new.error < m.error)) else { return };
    found[i..].rotate_right(1);
    found[i] = Some(new);
}

/// The 24 rotations of the cube: the signed permutation matrices of determinant 1.
fn cube_rotations() -> impl Iterator<Item = Matrix3<f64>> {
    (0..24).map(|i| {
        let (x, y) = (i / 8, (i / 8 + 1 + (i / 4) % 2) % 3);
        let sign = |bit: i32| if (i & bit) != 0 { -1.0 } else { 1.0 };
        let (mut a, mut b) = (Vector3::zeros(), Vector3::zeros());
        a[x as usize] = sign(1);
        b[y as usize] = sign(2);
        Matrix3::from_columns(&[a, b, a.cross(&b)])
    })
}

/// The error as a quadratic form, `rᵀ Ω r`, and the translation that goes with r.
struct Form {
    omega: Matrix9,
    translation: SMatrix<f64, 3, 9>,
    /// Of points.
    count: usize,
}

impl Form {
    fn new(bearings: impl Iterator<Item = Bearing>) -> Result<Self, NoSolution> {
        // Moments Σ w p̃ p̃ᵀ of p̃ = (p, 1) for the weights w = 1, x, y, x² + y², lower triangles row by row.
        let mut triangles = [[0.0; 10]; 4];
        let (mut mean, mut square) = (Vector2::zeros(), 0.0);
        for Bearing { point: p, image } in bearings {
            let s = image.norm_squared();
            mean += image;
            square += s;
            let products = [p.x * p.x, p.y * p.x, p.y * p.y, p.z * p.x, p.z * p.y, p.z * p.z, p.x, p.y, p.z, 1.0];
            for (triangle, weight) in triangles.iter_mut().zip([1.0, image.x, image.y, s]) {
                for (sum, product) in triangle.iter_mut().zip(products) {
                    *sum += weight * product;
                }
            }
        }
        let moments = triangles.map(|t| {
            Matrix4::from_fn(|i, j| {
                let (row, column) = (i.max(j), i.min(j));
                t[row * (row + 1) / 2 + column]
            })
        });
        let [one, mx, my, ms] = moments;
        let count = one.m44;
        // The normal matrix of t is singular when all pixels coincide.
        let scatter = square - mean.norm_squared() / count;
        if !scatter.is_finite() || !one.iter().all(|x| x.is_finite()) {
            return Err(NoSolution::NotFinite);
        }
        if scatter <= 1e-20 * square {
            return Err(NoSolution::OnePixel);
        }
        // Blocks of the form over the rows of [R | t]: (1, 0, −x; 0, 1, −y; −x, −y, s).
        let zero = Matrix4::zeros();
        let blocks = [[one, zero, -mx], [zero, one, -my], [-mx, -my, ms]];
        let tt = Matrix3::from_fn(|i, j| blocks[i][j].m44);
        let tr = SMatrix::<f64, 3, 9>::from_fn(|i, k| blocks[i][k / 3][(3, k % 3)]);
        let rr = Matrix9::from_fn(|k, l| blocks[k / 3][l / 3][(k % 3, l % 3)]);
        let inverse = tt.try_inverse().ok_or(NoSolution::OnePixel)?;
        let translation = -(inverse * tr);
        Ok(Self { omega: rr + tr.transpose() * translation, translation, count: count as usize })
    }

    /// f = rᵀ Ω r, and Ω r.
    fn error(&self, rotation: &Matrix3<f64>) -> (f64, Vector9) {
        let r = rows(rotation);
        let slope = self.omega * r;
        (r.dot(&slope), slope)
    }

    fn translation(&self, rotation: &Matrix3<f64>) -> Vector3<f64> {
        self.translation * rows(rotation)
    }

    /// A minimum with the centroid in front. One behind is turned by half a turn about the optical axis, which is where
    /// its image would come from.
    fn descend_in_front(&self, start: Matrix3<f64>) -> Option<Minimum> {
        let mut minimum = self.descend(start);
        if minimum.pose.translation.z <= 0.0 {
            minimum =
                self.descend(Matrix3::from_diagonal(&Vector3::new(-1.0, -1.0, 1.0)) * minimum.pose.rotation.matrix());
        }
        (minimum.pose.translation.z > 0.0 && minimum.pose.is_finite()).then_some(minimum)
    }

    /// Newton's method with the step `ω` in `cayley(ω) R`, damped until the error falls.
    fn descend(&self, start: Matrix3<f64>) -> Minimum {
        let mut rotation = start;
        let (mut error, mut slope) = self.error(&rotation);
        let mut damping = 0.0;
        for _ in 0..30 {
            let Some(step) = self.step(&rotation, &slope, damping) else {
                damping = (4.0 * damping).max(1e-3);
                continue;
            };
            let size = step.norm_squared();
            let next = cayley(&step) * rotation;
            let (next_error, next_slope) = self.error(&next);
            if next_error < error {
                (rotation, error, slope) = (next, next_error, next_slope);
                damping = if damping < 1e-3 { 0.0 } else { 0.1 * damping };
                // Convergence is quadratic: what is left is of the order of this step's square.
                if size < 1e-11 {
                    break;
                }
            } else if size < 1e-12 {
                break;
            } else {
                damping = (8.0 * damping).max(1e-3);
            }
        }
        let translation = self.translation(&rotation);
        Minimum { pose: Pose::new(Rotation3::from_matrix_unchecked(rotation), translation), error }
    }

    /// The minimum of the second-order model `f + gᵀω + ωᵀHω`, H damped relative to its Gauss–Newton part; `None` if that
    /// is not convex.
    fn step(&self, rotation: &Matrix3<f64>, slope: &Vector9, damping: f64) -> Option<Vector3<f64>> {
        // G = ∂f/∂R / 2, Ω r as a matrix, and M = R Gᵀ: f(exp(ω) R) has the gradient −4 vee(M) and, from the curvature of SO(3), the
        // second-order term ωᵀ(sym M − tr M)ω.
        let m = rotation * Matrix3::from_column_slice(slope.as_slice());
        let gradient = so3::vee(&m) * -4.0;
        let r = |i: usize| rotation.row(i).transpose();
        let (r1, r2, r3) = (r(0), r(1), r(2));
        let mut tangents = Matrix9x3::zeros();
        for (column, row, value) in [(0, 1, -r3), (0, 2, r2), (1, 0, r3), (1, 2, -r1), (2, 0, -r2), (2, 1, r1)] {
            tangents.fixed_view_mut::<3, 1>(3 * row, column).copy_from(&value);
        }
        let linear = tangents.transpose() * (self.omega * tangents);
        let scale = linear.trace();
        let curved = linear + (m + m.transpose()) * 0.5 + Matrix3::from_diagonal_element(damping * scale - m.trace());
        let factor = curved.cholesky()?;
        Some(factor.solve(&gradient) * -0.5)
    }
}

/// The rotation `(1 − [ω]×/2)⁻¹ (1 + [ω]×/2)`: exp(ω) to second order, which is what Newton's method needs of it.
fn cayley(omega: &Vector3<f64>) -> Matrix3<f64> {
    let scale = 1.0 / (1.0 + 0.25 * omega.norm_squared());
    let hat = so3::hat(omega);
    Matrix3::identity() + (hat + hat * hat * 0.5) * scale
}

/// The entries of a matrix row by row.
fn rows(m: &Matrix3<f64>) -> Vector9 {
    Vector9::from_row_slice(m.transpose().as_slice())
}
