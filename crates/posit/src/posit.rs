//! POS and POSIT: pose from orthography and scaling, iterated (D. F. DeMenthon & L. S. Davis, *Model-Based Object Pose in
//! 25 Lines of Code*, IJCV 15, 1995), and its form for plane point sets (D. Oberkampf, D. F. DeMenthon & L. S. Davis,
//! *Iterative Pose Estimation Using Coplanar Feature Points*, CVIU 63, 1996).
//!
//! With the first point M₀ as reference, i, j, k the rows of R, Z₀ the depth of M₀ and (x, y) normalized image coordinates,
//!
//! ```text
//! M₀Mᵢ · I = xᵢ (1 + εᵢ) − x₀     I = i / Z₀
//! M₀Mᵢ · J = yᵢ (1 + εᵢ) − y₀     J = j / Z₀     εᵢ = M₀Mᵢ · k / Z₀
//! ```
//!
//! POS solves this for I and J with the ε given; with ε = 0 the image is taken for a scaled orthographic one. POSIT takes the
//! ε of one solution for the next. For points in a plane, I and J are known up to a component along the plane's normal u,
//! `I = I₀ + λ u`, `J = J₀ + μ u`; that I and J are perpendicular and of equal length leaves two solutions, ±(λ, μ),
//! which look alike under weak perspective.
//!
//! Precondition: distances between the points small beside their distance from the camera, more than some three to one; near
//! objects converge slowly or not at all. It needs no start, and all it does is multiply small matrices.

use crate::{Bearing, NoSolution};
use nalgebra::{Matrix3, Rotation3, Vector3};
use texreg_lie::{Pose, so3};

/// When POSIT stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Iteration {
    /// When no ε changes by more than this.
    pub tolerance: f64,
    /// When this many poses have been computed.
    pub most: usize,
}

impl Default for Iteration {
    fn default() -> Self {
        Self { tolerance: 1e-10, most: 100 }
    }
}

/// What POSIT came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posit {
    /// `camera_from_world`.
    pub pose: Pose,
    /// Applications of POS.
    pub iterations: usize,
    /// Whether the tolerance was reached.
    pub converged: bool,
}

/// A rotation and the depth of the reference point.
type Scaled = (Rotation3<f64>, f64);

/// POS: the pose under scaled orthography, of four or more points that span space.
pub fn pos(bearings: &[Bearing]) -> Result<Pose, NoSolution> {
    posit(bearings, &Iteration { tolerance: 0.0, most: 1 }).map(|found| found.pose)
}

/// POSIT for four or more points that span space.
pub fn posit(bearings: &[Bearing], iteration: &Iteration) -> Result<Posit, NoSolution> {
    let object = Object::new(bearings)?;
    if object.is_flat() {
        return Err(NoSolution::Coplanar);
    }
    let mut epsilon = vec![0.0; bearings.len()];
    for iterations in 1..=iteration.most {
        let (i, j) = object.solve(bearings, &epsilon, 3);
        let (rotation, depth) = orthonormal(&i, &j)?;
        let change = advance(&mut epsilon, bearings, &rotation, depth);
        let converged = change <= iteration.tolerance;
        if converged || iterations == iteration.most {
            return finish(bearings, rotation, depth, iterations, converged);
        }
    }
    Err(NoSolution::NoConsensus)
}

/// Coplanar POSIT for four or more points of a plane: one or two poses, the one that fits better first. Points a little out
/// of the plane are taken as they are.
pub fn coplanar_posit(bearings: &[Bearing], iteration: &Iteration) -> Result<Vec<Posit>, NoSolution> {
    let object = Object::new(bearings)?;
    // Both poses are kept at the first step; from then on each branch follows its better child.
    let epsilon = vec![0.0; bearings.len()];
    let mut found: Vec<(f64, Posit)> = Vec::new();
    for start in object.pair(bearings, &epsilon)?.into_iter().flatten() {
        if let Some(end) = object.follow(bearings, start, iteration) {
            let distinct =
                |(_, other): &(f64, Posit)| (other.pose.rotation.matrix() - end.1.pose.rotation.matrix()).norm() > 1e-6;
            if found.iter().all(distinct) {
                found.push(end);
            }
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    if found.is_empty() {
        return Err(NoSolution::BehindCamera);
    }
    Ok(found.into_iter().map(|(_, posit)| posit).collect())
}

/// Takes the ε of a pose; returns their largest change.
fn advance(epsilon: &mut [f64], bearings: &[Bearing], rotation: &Rotation3<f64>, depth: f64) -> f64 {
    let k = rotation.matrix().row(2).transpose() / depth;
    let mut change: f64 = 0.0;
    for (epsilon, bearing) in epsilon.iter_mut().zip(bearings) {
        let new = (bearing.point - bearings[0].point).dot(&k);
        change = change.max((new - *epsilon).abs());
        *epsilon = new;
    }
    change
}

/// The object matrix A of the M₀Mᵢ, decomposed.
struct Object {
    /// Principal axes of AᵀA, widest first.
    axes: Matrix3<f64>,
    /// Its eigenvalues.
    squares: Vector3<f64>,
}

impl Object {
    /// Relative extent below which an axis is no axis.
    const FLAT: f64 = 1e-6;

    fn new(bearings: &[Bearing]) -> Result<Self, NoSolution> {
        if bearings.len() < 4 {
            return Err(NoSolution::TooFew { usable: bearings.len(), needed: 4 });
        }
        let finite = |b: &Bearing| b.point.iter().chain(b.image.iter()).all(|x| x.is_finite());
        if !bearings.iter().all(finite) {
            return Err(NoSolution::NotFinite);
        }
        if bearings.iter().all(|b| b.image == bearings[0].image) {
            return Err(NoSolution::OnePixel);
        }
        let origin = bearings[0].point;
        let gram = bearings.iter().map(|b| b.point - origin).fold(Matrix3::zeros(), |sum, d| sum + d * d.transpose());
        let eigen = gram.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let squares = Vector3::from(order.map(|i| eigen.eigenvalues[i].max(0.0)));
        if squares[1] <= Self::FLAT * Self::FLAT * squares[0] {
            return Err(NoSolution::Collinear);
        }
        let axes = Matrix3::from_columns(&order.map(|i| eigen.eigenvectors.column(i).into_owned()));
        Ok(Self { axes, squares })
    }

    fn is_flat(&self) -> bool {
        self.squares[2] <= Self::FLAT * Self::FLAT * self.squares[0]
    }

    /// The least-squares I and J in the span of the widest axes.
    fn solve(&self, bearings: &[Bearing], epsilon: &[f64], axes: usize) -> (Vector3<f64>, Vector3<f64>) {
        let first = bearings[0];
        let (mut x, mut y) = (Vector3::zeros(), Vector3::zeros());
        for (bearing, epsilon) in bearings.iter().zip(epsilon) {
            let arm = bearing.point - first.point;
            let offset = bearing.image * (1.0 + epsilon) - first.image;
            x += arm * offset.x;
            y += arm * offset.y;
        }
        let invert = |v: Vector3<f64>| {
            (0..axes).map(|a| self.axes.column(a) * (self.axes.column(a).dot(&v) / self.squares[a])).sum()
        };
        (invert(x), invert(y))
    }

    /// The two poses of a plane set for given ε; those with points behind the camera are missing.
    fn pair(&self, bearings: &[Bearing], epsilon: &[f64]) -> Result<[Option<Scaled>; 2], NoSolution> {
        let (i, j) = self.solve(bearings, epsilon, 2);
        let u = self.axes.column(2).into_owned();
        // λ μ = −I₀·J₀ and λ² − μ² = J₀² − I₀²: (λ + iμ)² = J₀² − I₀² − 2i I₀·J₀.
        let (real, imaginary) = (j.norm_squared() - i.norm_squared(), -2.0 * i.dot(&j));
        let modulus = real.hypot(imaginary);
        let lambda = (0.5 * (modulus + real)).max(0.0).sqrt();
        let mu = (0.5 * (modulus - real)).max(0.0).sqrt().copysign(imaginary);
        let mut poses = [None; 2];
        for (pose, sign) in poses.iter_mut().zip([1.0, -1.0]) {
            let (rotation, depth) = orthonormal(&(i + u * (sign * lambda)), &(j + u * (sign * mu)))?;
            let k = rotation.matrix().row(2).transpose();
            let in_front = bearings.iter().all(|b| (b.point - bearings[0].point).dot(&k) + depth > 0.0);
            *pose = in_front.then_some((rotation, depth));
        }
        Ok(poses)
    }

    /// Iterates from one pose of the first pair, keeping the better of the two poses of every next pair.
    fn follow(&self, bearings: &[Bearing], start: Scaled, iteration: &Iteration) -> Option<(f64, Posit)> {
        let mut epsilon = vec![0.0; bearings.len()];
        let (mut rotation, mut depth) = start;
        advance(&mut epsilon, bearings, &rotation, depth);
        let (mut iterations, mut converged) = (1, false);
        while iterations < iteration.most && !converged {
            iterations += 1;
            let error = |p: &Scaled| misfit(bearings, &place(bearings, p.0, p.1));
            let next = self.pair(bearings, &epsilon).ok()?.into_iter().flatten();
            (rotation, depth) = next.min_by(|a, b| error(a).total_cmp(&error(b)))?;
            converged = advance(&mut epsilon, bearings, &rotation, depth) <= iteration.tolerance;
        }
        let posit = finish(bearings, rotation, depth, iterations, converged).ok()?;
        Some((misfit(bearings, &posit.pose), posit))
    }
}

/// The rotation with rows nearest to I, J (of one length, perpendicular), and the depth 1/√(‖I‖ ‖J‖).
fn orthonormal(i: &Vector3<f64>, j: &Vector3<f64>) -> Result<Scaled, NoSolution> {
    let (a, b) = (i.norm(), j.norm());
    let depth = 1.0 / (a * b).sqrt();
    if !depth.is_finite() {
        return Err(NoSolution::OnePixel);
    }
    let (i, j) = (i / a, j / b);
    let rows = Matrix3::from_rows(&[i.transpose(), j.transpose(), i.cross(&j).transpose()]);
    Ok((so3::nearest(&rows).ok_or(NoSolution::OnePixel)?, depth))
}

/// The pose that puts the reference point at its pixel and depth.
fn place(bearings: &[Bearing], rotation: Rotation3<f64>, depth: f64) -> Pose {
    Pose::new(rotation, bearings[0].image.push(1.0) * depth - rotation * bearings[0].point)
}

fn finish(
    bearings: &[Bearing],
    rotation: Rotation3<f64>,
    depth: f64,
    iterations: usize,
    converged: bool,
) -> Result<Posit, NoSolution> {
    let pose = place(bearings, rotation, depth);
    let in_front = bearings.iter().all(|b| pose.transform_point(&b.point.into()).z > 0.0);
    if in_front { Ok(Posit { pose, iterations, converged }) } else { Err(NoSolution::BehindCamera) }
}

/// The sum of squared image errors.
fn misfit(bearings: &[Bearing], pose: &Pose) -> f64 {
    let error = |b: &Bearing| {
        let p = pose.transform_point(&b.point.into());
        (p.xy().coords / p.z - b.image).norm_squared()
    };
    bearings.iter().map(error).sum()
}
