//! Homographies between a plane and an image: `λ (u, v, 1) = H (x, y, 1)`.
//!
//! Normalized DLT, then Gauss–Newton on the error in the image: R. Hartley & A. Zisserman, *Multiple View Geometry*,
//! 2004, algorithms 4.2 and 4.3.

use nalgebra::{Matrix3, Point2, SMatrix, SVector, SymmetricEigen, Vector3};
use texreg_camera::normalize_plane;

/// The homography of four or more pairs (in the plane, in the image) that minimizes the algebraic error; `None` if it is
/// not determined.
pub(crate) fn dlt(pairs: &[(Point2<f64>, Point2<f64>)]) -> Option<Matrix3<f64>> {
    if pairs.len() < 4 {
        return None;
    }
    let (plane, image): (Vec<_>, Vec<_>) = pairs.iter().copied().unzip();
    let (from_plane, from_image) = (normalize_plane(&plane), normalize_plane(&image));
    let mut normal = SMatrix::<f64, 9, 9>::zeros();
    for (p, q) in pairs {
        let p = from_plane * p.to_homogeneous();
        let q = from_image * q.to_homogeneous();
        let row = |a: f64, b: f64, c: f64| {
            SVector::<f64, 9>::from_iterator((p * a).iter().chain((p * b).iter()).chain((p * c).iter()).copied())
        };
        for row in [row(1.0, 0.0, -q.x), row(0.0, 1.0, -q.y)] {
            normal += row * row.transpose();
        }
    }
    let eigen = SymmetricEigen::new(normal);
    let mut order: Vec<usize> = (0..9).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    if eigen.eigenvalues[order[1]] <= 1e-10 * eigen.eigenvalues[order[8]] {
        return None;
    }
    let inner = Matrix3::from_row_slice(eigen.eigenvectors.column(order[0]).into_owned().as_slice());
    let h = from_image.try_inverse()? * inner * from_plane;
    finished(h)
}

/// Where the homography of some pairs takes the plane's origin: linear least squares with H's last entry 1, which is
/// sound as the origin is seen where λ > 0. For plane coordinates of order one around it.
pub(crate) fn at_origin(pairs: &[(Point2<f64>, Point2<f64>)]) -> Option<Point2<f64>> {
    let near = pairs.first()?.1;
    let scale = pairs.iter().map(|(_, q)| (q - near).amax()).fold(0.0, f64::max);
    let mut normal = SMatrix::<f64, 8, 8>::zeros();
    let mut right = SVector::<f64, 8>::zeros();
    for (p, q) in pairs {
        let (x, y, q) = (p.x, p.y, (q - near) / scale);
        let a = SVector::from([x, y, 1.0, 0.0, 0.0, 0.0, -q.x * x, -q.x * y]);
        let b = SVector::from([0.0, 0.0, 0.0, x, y, 1.0, -q.y * x, -q.y * y]);
        normal.ger(1.0, &a, &a, 1.0);
        normal.ger(1.0, &b, &b, 1.0);
        right += a * q.x + b * q.y;
    }
    let h = normal.cholesky()?.solve(&right);
    let point = near + nalgebra::Vector2::new(h[2], h[5]) * scale;
    (pairs.len() >= 4 && point.x.is_finite() && point.y.is_finite()).then_some(point)
}

/// The homography that minimizes the error in the image.
pub(crate) fn fit(pairs: &[(Point2<f64>, Point2<f64>)]) -> Option<Matrix3<f64>> {
    let mut h = dlt(pairs)?;
    for _ in 0..5 {
        let mut normal = SMatrix::<f64, 8, 8>::zeros();
        let mut gradient = SVector::<f64, 8>::zeros();
        for (p, q) in pairs {
            let image = h * p.to_homogeneous();
            let (u, v, w) = (image.x / image.z, image.y / image.z, 1.0 / image.z);
            let a = SVector::from([p.x * w, p.y * w, w, 0.0, 0.0, 0.0, -u * p.x * w, -u * p.y * w]);
            let b = SVector::from([0.0, 0.0, 0.0, p.x * w, p.y * w, w, -v * p.x * w, -v * p.y * w]);
            normal += a * a.transpose() + b * b.transpose();
            gradient += a * (q.x - u) + b * (q.y - v);
        }
        let scale = normal.diagonal().map(|d| 1.0 / d.sqrt());
        let scaled = SMatrix::<f64, 8, 8>::from_fn(|i, j| normal[(i, j)] * scale[i] * scale[j]);
        let step = scaled.cholesky()?.solve(&gradient.component_mul(&scale)).component_mul(&scale);
        let before = h;
        for (i, step) in step.iter().enumerate() {
            h[(i / 3, i % 3)] += step;
        }
        if (h - before).norm() <= 1e-10 * h.norm() {
            break;
        }
    }
    finished(h)
}

/// Where a homography takes a point.
pub(crate) fn apply(h: &Matrix3<f64>, p: &Point2<f64>) -> Option<Point2<f64>> {
    let q: Vector3<f64> = h * p.to_homogeneous();
    let point = Point2::new(q.x / q.z, q.y / q.z);
    (point.x.is_finite() && point.y.is_finite()).then_some(point)
}

fn finished(h: Matrix3<f64>) -> Option<Matrix3<f64>> {
    let h = h / h[(2, 2)];
    h.iter().all(|x| x.is_finite()).then_some(h)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_homography_is_recovered_from_exact_pairs() {
        let truth = Matrix3::new(900.0, 80.0, 300.0, -40.0, 850.0, 250.0, 0.2, -0.1, 1.0);
        let points = (0..12).map(|i| Point2::new(f64::from(i % 4) * 0.3, f64::from(i / 4) * 0.2));
        let pairs: Vec<_> = points.map(|p| (p, apply(&truth, &p).unwrap())).collect();
        for h in [dlt(&pairs), fit(&pairs)] {
            assert!((h.unwrap() - truth).norm() < 1e-8 * truth.norm());
        }
        assert!((at_origin(&pairs).unwrap() - Point2::new(300.0, 250.0)).norm() < 1e-6);
    }

    #[test]
    fn points_on_a_line_have_none() {
        let line: Vec<_> = (0..8).map(|i| (Point2::new(f64::from(i), 0.0), Point2::new(f64::from(i), 1.0))).collect();
        assert_eq!((dlt(&line), at_origin(&line)), (None, None));
    }
}
