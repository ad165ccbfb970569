//! The minimal problem: poses from three points.
//!
//! The depths λ of the points along their unit bearings y satisfy `λᵢ² + λⱼ² − 2 bᵢⱼ λᵢλⱼ = aᵢⱼ` with `bᵢⱼ = yᵢ·yⱼ` and
//! `aᵢⱼ = ‖xᵢ − xⱼ‖²`. Two homogeneous combinations are conics D₁, D₂ in λ; a degenerate member of their pencil is a pair of
//! lines, each of which meets a conic in at most two solutions (M. Persson & K. Nordberg, *Lambda Twist*, ECCV 2018;
//! Y. Ding, J. Yang, V. Larsson, C. Olsson & K. Åström, *Revisiting the P3P Problem*, CVPR 2023). The line pair is split by
//! its adjugate (J. Richter-Gebert, *Perspectives on Projective Geometry*, 2011, section 11.1).
//!
//! Precondition: three points not on a line, three bearings not in a plane with the camera. Otherwise nothing or an
//! arbitrary part of the solutions is returned.

use crate::Bearing;
use nalgebra::{Matrix2x3, Matrix3, Rotation3, Vector3};
use texreg_lie::{Pose, so3};

/// The poses, at most four, that put three points on their bearings and in front of the camera.
pub fn p3p(bearings: &[Bearing; 3]) -> impl Iterator<Item = Pose> + use<> {
    solve(bearings).into_iter().flatten()
}

fn solve(bearings: &[Bearing; 3]) -> [Option<Pose>; 4] {
    let mut poses = [None; 4];
    let x = bearings.map(|b| b.point);
    let y = bearings.map(|b| b.image.push(1.0).normalize());
    let (d12, d13, d23) = (x[0] - x[1], x[0] - x[2], x[1] - x[2]);
    let (a12, a13, a23) = (d12.norm_squared(), d13.norm_squared(), d23.norm_squared());
    let normal = d12.cross(&d13);
    let area = normal.norm_squared();
    if area.is_nan() || area <= 1e-16 * a12.max(a13).max(a23).powi(2) {
        return poses;
    }
    let (b12, b13, b23) = (y[0].dot(&y[1]), y[0].dot(&y[2]), y[1].dot(&y[2]));

    let unit = 1.0 / (a12 + a13 + a23);
    let (s12, s13, s23) = (a12 * unit, a13 * unit, a23 * unit);
    let m12 = Matrix3::new(1.0, -b12, 0.0, -b12, 1.0, 0.0, 0.0, 0.0, 0.0);
    let m13 = Matrix3::new(1.0, 0.0, -b13, 0.0, 0.0, 0.0, -b13, 0.0, 1.0);
    let m23 = Matrix3::new(0.0, 0.0, 0.0, 0.0, 1.0, -b23, 0.0, -b23, 1.0);
    let d1 = m12 * s23 - m23 * s12;
    let d2 = m13 * s23 - m23 * s13;

    // det(D₁ + γ D₂) = 0.
    let (adjugate1, adjugate2) = (adjugate(&d1), adjugate(&d2));
    let cubic = [
        d1.row(0).dot(&adjugate1.column(0).transpose()),
        adjugate1.dot(&d2),
        adjugate2.dot(&d1),
        d2.row(0).dot(&adjugate2.column(0).transpose()),
    ];
    // γ = ∞ is D₂ itself, as when two sides look alike.
    let (lines, conic) = if cubic[3].abs() <= 1e-12 * cubic[2].abs().max(cubic[1].abs()).max(cubic[0].abs()) {
        (d2, d1)
    } else {
        match cubic_root(cubic) {
            Some(gamma) => (d1 + d2 * gamma, if gamma.abs() > 1.0 { d1 } else { d2 }),
            None => return poses,
        }
    };
    let Some((l, m)) = split(&lines) else { return poses };

    // R = Y X⁻¹ with the columns d12, d13, d12 × d13; X⁻¹ in closed form.
    let inverse = Matrix3::from_rows(&[
        (d13.cross(&normal) / area).transpose(),
        (normal.cross(&d12) / area).transpose(),
        (normal / area).transpose(),
    ]);
    let mut count = 0;
    for line in [l, m] {
        for direction in meet(&line, &conic).into_iter().flatten() {
            let direction = if direction.sum() < 0.0 { -direction } else { direction };
            let quadric = (m12 + m13 + m23) * direction;
            let length = direction.dot(&quadric);
            if direction.min() <= 0.0 || length <= 0.0 || count == 4 {
                continue;
            }
            let mut depth = direction * (1.0 / (length * unit)).sqrt();
            polish(&mut depth, [a12, a13, a23], [b12, b13, b23]);
            if depth.iter().any(|d| d.is_nan() || *d <= 0.0) {
                continue;
            }
            let seen = [y[0] * depth[0], y[1] * depth[1], y[2] * depth[2]];
            let (e12, e13) = (seen[0] - seen[1], seen[0] - seen[2]);
            let rotation = Matrix3::from_columns(&[e12, e13, e12.cross(&e13)]) * inverse;
            let translation = seen[0] - rotation * x[0];
            poses[count] = Some(Pose::new(Rotation3::from_matrix_unchecked(rotation), translation));
            count += 1;
        }
    }
    poses
}

/// The transposed cofactors of a symmetric matrix: `m adj(m) = det(m) I`.
fn adjugate(m: &Matrix3<f64>) -> Matrix3<f64> {
    let row = |i: usize| m.row(i).transpose();
    let (a, b, c) = (row(0), row(1), row(2));
    Matrix3::from_columns(&[b.cross(&c), c.cross(&a), a.cross(&b)])
}

/// A real root of c₀ + c₁ x + c₂ x² + c₃ x³, the best separated one, refined by Newton's method.
fn cubic_root(c: [f64; 4]) -> Option<f64> {
    let value = |x: f64| c[0] + x * (c[1] + x * (c[2] + x * c[3]));
    let slope = |x: f64| c[1] + x * (2.0 * c[2] + x * 3.0 * c[3]);
    // Depressed form t³ + p t + q, x = t − b/3.
    let (a, b, d) = (c[2] / c[3], c[1] / c[3], c[0] / c[3]);
    let shift = a / 3.0;
    let p = b - a * shift;
    let q = d + shift * (2.0 * shift * shift - b);
    let discriminant = 0.25 * q * q + p * p * p / 27.0;
    let start = if discriminant >= 0.0 {
        let u = (-0.5 * q - discriminant.sqrt().copysign(q)).cbrt();
        u - if u == 0.0 { 0.0 } else { p / (3.0 * u) }
    } else {
        // Three real roots 2 r cos(φ + 2πk/3); an outer one is farthest from the others.
        let r = (-p / 3.0).sqrt();
        let angle = (-0.5 * q / (r * r * r)).clamp(-1.0, 1.0).acos() / 3.0;
        let high = 2.0 * r * angle.cos();
        let low = 2.0 * r * (angle + 2.0 * std::f64::consts::FRAC_PI_3).cos();
        if q > 0.0 { low } else { high }
    };
    let mut x = start - shift;
    for _ in 0..3 {
        let step = value(x) / slope(x);
        if !step.is_finite() {
            break;
        }
        x -= step;
        if step.abs() <= 1e-15 * x.abs() {
            break;
        }
    }
    x.is_finite().then_some(x)
}

/// The two lines of a degenerate conic `l mᵀ + m lᵀ`; `None` if they are not real.
fn split(conic: &Matrix3<f64>) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let adjugate = -adjugate(conic);
    let i = adjugate.diagonal().imax();
    let square = adjugate[(i, i)];
    if square <= 0.0 {
        return None;
    }
    let meeting = adjugate.column(i) / square.sqrt();
    let product = conic + so3::hat(&meeting);
    let (row, column) = product.iamax_full();
    Some((product.row(row).transpose(), product.column(column).into_owned()))
}

/// Where a line meets a conic, as homogeneous points.
fn meet(line: &Vector3<f64>, conic: &Matrix3<f64>) -> [Option<Vector3<f64>>; 2] {
    let i = line.iamax();
    let (j, k) = ((i + 1) % 3, (i + 2) % 3);
    // The line's points: component i is w·(components j, k).
    let w = Matrix2x3::from_fn(|r, c| match (r, c) {
        (0, c) if c == j => 1.0,
        (1, c) if c == k => 1.0,
        (0, c) if c == i => -line[j] / line[i],
        (1, c) if c == i => -line[k] / line[i],
        _ => 0.0,
    });
    let form = w * conic * w.transpose();
    let (a, b, c) = (form.m11, form.m12, form.m22);
    let discriminant = b * b - a * c;
    if discriminant.is_nan() || discriminant < 0.0 {
        return [None; 2];
    }
    // Roots (s, t) of a s² + 2 b s t + c t² = 0, without cancellation.
    let q = -(b + discriminant.sqrt().copysign(b));
    let point = |s: f64, t: f64| w.row(0).transpose() * s + w.row(1).transpose() * t;
    [Some(point(q, a)), Some(point(c, q))]
}

/// Newton's method on the three distance equations.
fn polish(depth: &mut Vector3<f64>, a: [f64; 3], b: [f64; 3]) {
    const PAIRS: [(usize, usize); 3] = [(0, 1), (0, 2), (1, 2)];
    for _ in 0..2 {
        let mut error = Vector3::zeros();
        let mut slope = Matrix3::zeros();
        for (row, (i, j)) in PAIRS.into_iter().enumerate() {
            let (x, y) = (depth[i], depth[j]);
            error[row] = x * x + y * y - 2.0 * b[row] * x * y - a[row];
            slope[(row, i)] = 2.0 * (x - b[row] * y);
            slope[(row, j)] = 2.0 * (y - b[row] * x);
        }
        let Some(inverse) = slope.try_inverse() else { return };
        *depth -= inverse * error;
    }
}
