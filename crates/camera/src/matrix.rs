//! The projection matrix, F(P): all that a camera without distortion does, linear in homogeneous coordinates.
//! R. Hartley & A. Zisserman, *Multiple View Geometry in Computer Vision*, 2004, chapters 6 and 7.

use crate::Intrinsics;
use nalgebra::{Matrix3, Matrix3x4, Point2, Point3, Rotation3, SMatrix, Vector3};
use texreg_lie::Pose;

/// P, 3×4 of rank 3: `w (u, v, 1) = P (X, Y, Z, 1)`. Its scale means nothing, so it has 11 degrees of freedom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProjectionMatrix(pub Matrix3x4<f64>);

impl ProjectionMatrix {
    /// `K [R | T]`.
    pub fn new(intrinsics: &Intrinsics, pose: &Pose) -> Self {
        Self(intrinsics.matrix() * pose.matrix())
    }

    /// The pixel of a world point; `None` for points not in front of the camera, or not finite.
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let p = self.0 * point.to_homogeneous();
        let pixel = Point2::new(p.x / p.z, p.y / p.z);
        // The sign of det M, M the left 3×3, says which sign of w is in front.
        let in_front = p.z * self.left().determinant() > 0.0;
        (in_front && pixel.iter().all(|x| x.is_finite())).then_some(pixel)
    }

    /// [`project`](Self::project), and ∂pixel/∂P with P column by column.
    pub fn project_with_jacobian(&self, point: &Point3<f64>) -> Option<(Point2<f64>, SMatrix<f64, 2, 12>)> {
        let pixel = self.project(point)?;
        let w = (self.0 * point.to_homogeneous()).z;
        let slope = point.to_homogeneous() / w;
        let mut jacobian = SMatrix::zeros();
        for column in 0..4 {
            jacobian[(0, 3 * column)] = slope[column];
            jacobian[(1, 3 * column + 1)] = slope[column];
            jacobian[(0, 3 * column + 2)] = -slope[column] * pixel.x;
            jacobian[(1, 3 * column + 2)] = -slope[column] * pixel.y;
        }
        Some((pixel, jacobian))
    }

    /// K and (R, T) with `P ∝ K [R | T]`, K upper triangular with positive diagonal and K₃₃ = 1 (RQ decomposition), R a
    /// rotation. `None` for an affine camera or a matrix of lower rank.
    pub fn decompose(&self) -> Option<(Intrinsics, Pose)> {
        // The sign of P that makes R a rotation rather than a reflection.
        let sign = self.left().determinant().signum();
        let p = self.0 * sign;
        let m = p.fixed_columns::<3>(0).into_owned();
        let (k, rotation) = rq(&m)?;
        let t = k.solve_upper_triangular(&p.column(3).into_owned())?;
        let k = k / k.m33;
        let intrinsics = Intrinsics { fx: k.m11, fy: k.m22, cx: k.m13, cy: k.m23, skew: k.m12 };
        let pose = Pose::new(rotation, t);
        let finite = intrinsics.to_array().iter().all(|x| x.is_finite()) && pose.is_finite();
        finite.then_some((intrinsics, pose))
    }

    /// The camera centre, `P (C, 1) = 0`; `None` if it lies at infinity.
    pub fn center(&self) -> Option<Point3<f64>> {
        let c = -(self.left().try_inverse()? * self.0.column(3));
        c.iter().all(|x| x.is_finite()).then(|| Point3::from(c))
    }

    fn left(&self) -> Matrix3<f64> {
        self.0.fixed_columns::<3>(0).into_owned()
    }
}

/// `m = K R`, K upper triangular with positive diagonal, by Gram–Schmidt from the last row up, each row orthogonalized
/// twice (W. Kahan's "twice is enough"). `m` has positive determinant.
fn rq(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, Rotation3<f64>)> {
    let mut k = Matrix3::zeros();
    let mut rows: [Vector3<f64>; 3] = [2, 1, 0].map(|i| m.row(i).transpose());
    let scale = m.norm();
    for i in 0..3 {
        let mut row = rows[i];
        for _ in 0..2 {
            for j in 0..i {
                let along = row.dot(&rows[j]);
                row -= rows[j] * along;
                k[(2 - i, 2 - j)] += along;
            }
        }
        let length = row.norm();
        if length.is_nan() || length <= 1e-14 * scale {
            return None;
        }
        k[(2 - i, 2 - i)] = length;
        rows[i] = row / length;
    }
    let [z, y, x] = rows;
    let rotation = Matrix3::from_rows(&[x.transpose(), y.transpose(), z.transpose()]);
    (rotation.determinant() > 0.0).then(|| (k, Rotation3::from_matrix_unchecked(rotation)))
}
