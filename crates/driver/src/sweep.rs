//! Many samples through one camera: what every evaluation of a metric spends its time on.
//!
//! Loops go over blocks of points, and are compiled for wide vectors.

use crate::Refine;
use crate::parameters::{Dense, MOST, POSE};
use crate::pyramid::Level;
use fearless_simd::dispatch;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Point3, Vector2, Vector3};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_mi::Real;

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 2048;

/// Points that are projected together.
pub(crate) const BLOCK: usize = 64;

/// Sums that go on side by side.
pub(crate) const LANES: usize = 8;

/// What a view sees of points in a level of the photo: the values, NaN outside it, and their slopes.
pub(crate) fn look<T: Real>(points: &[Point3<f64>], level: &Level, view: &View) -> (Vec<T>, Vec<[T; 2]>) {
    let projector = Projector::new(level, view);
    let features = fearless_simd::Level::new();
    let mut values = vec![T::of(f64::NAN); points.len()];
    let mut slopes = vec![[T::default(); 2]; points.len()];
    (points.par_chunks(CHUNK), values.par_chunks_mut(CHUNK), slopes.par_chunks_mut(CHUNK)).into_par_iter().for_each(
        |(points, values, slopes)| dispatch!(features, _simd => projector.look(level, points, values, slopes)),
    );
    (values, slopes)
}

/// The sums of the rows `score · ∂value/∂ξ`, and of their outer products, for points whose values have such slopes.
pub(crate) fn weigh<T: Real>(
    points: &[Point3<f64>],
    slopes: &[[T; 2]],
    scores: &[T],
    level: &Level,
    view: &View,
    refine: Refine,
) -> Sums<MOST> {
    let projector = Projector::new(level, view);
    let features = fearless_simd::Level::new();
    let parts: Vec<Sums<MOST>> = (points.par_chunks(CHUNK), slopes.par_chunks(CHUNK), scores.par_chunks(CHUNK))
        .into_par_iter()
        .map(|(points, slopes, scores)| {
            if refine == Refine::default() {
                return dispatch!(features, _simd => projector.weigh(points, slopes, scores)).sums();
            }
            let mut sums = Sums::default();
            for ((point, slope), &score) in points.iter().zip(slopes).zip(scores) {
                let score: f64 = score.into();
                if score != 0.0 {
                    let gradient = score * Vector2::new(slope[0].into(), slope[1].into());
                    if let Some(row) = chain(view, &projector.camera, refine, level.scale, point, &gradient) {
                        sums.add(&row[..refine.dimension()]);
                    }
                }
            }
            sums
        })
        .collect();
    let mut total = Sums::default();
    parts.iter().for_each(|part| total.merge(part));
    total
}

/// The derivatives of points' values by the tangent, for values that have such slopes; zero for a point without a pixel.
pub(crate) fn rows<T: Real>(
    points: &[Point3<f64>],
    slopes: &[[T; 2]],
    level: &Level,
    view: &View,
    refine: Refine,
) -> Vec<[f64; MOST]> {
    let camera = level.camera(&view.camera);
    let row = |(point, slope): (&Point3<f64>, &[T; 2])| {
        let slope = Vector2::new(slope[0].into(), slope[1].into());
        chain(view, &camera, refine, level.scale, point, &slope).unwrap_or_default()
    };
    (points, slopes).into_par_iter().with_min_len(CHUNK).map(row).collect()
}

/// A view with what is the same for all points.
pub(crate) struct Projector {
    camera: Camera,
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    is_distorted: bool,
    /// The squared radius up to which the distortion is one to one.
    domain: f64,
}

impl Projector {
    pub(crate) fn new(level: &Level, view: &View) -> Self {
        let camera = level.camera(&view.camera);
        Self {
            camera,
            rotation: *view.pose.rotation.matrix(),
            translation: view.pose.translation,
            is_distorted: !camera.distortion.is_none(),
            domain: camera.distortion.domain(),
        }
    }

    #[inline(always)]
    fn look<T: Real>(&self, level: &Level, points: &[Point3<f64>], values: &mut [T], slopes: &mut [[T; 2]]) {
        let (mut x, mut y) = ([0.0; BLOCK], [0.0; BLOCK]);
        let blocks = values.chunks_mut(BLOCK).zip(slopes.chunks_mut(BLOCK));
        for (points, (values, slopes)) in points.chunks(BLOCK).zip(blocks) {
            self.project(points, &mut x, &mut y);
            for (i, (value, slope)) in values.iter_mut().zip(slopes).enumerate() {
                if let Some([v, dx, dy]) = level.sample(x[i], y[i]) {
                    *value = v;
                    *slope = [dx, dy];
                }
            }
        }
    }

    /// The pixels of at most a block of points; x is NaN where there is none.
    #[inline(always)]
    pub(crate) fn project(&self, points: &[Point3<f64>], x: &mut [f64; BLOCK], y: &mut [f64; BLOCK]) {
        for ((point, x), y) in points.iter().zip(&mut *x).zip(&mut *y) {
            let p = self.rotation * point.coords + self.translation;
            let inverse = 1.0 / p.z;
            *x = if p.z > 0.0 { p.x * inverse } else { f64::NAN };
            *y = p.y * inverse;
        }
        if self.is_distorted {
            for (x, y) in x.iter_mut().zip(&mut *y) {
                let p = Vector2::new(*x, *y);
                let (distorted, slope) = self.camera.distortion.evaluate(&p);
                let is_inside = p.norm_squared() < self.domain && slope.determinant() > 0.0;
                *x = if is_inside { distorted.x } else { f64::NAN };
                *y = distorted.y;
            }
        }
        for (x, y) in x.iter_mut().zip(y) {
            let pixel = self.camera.intrinsics.apply(&Vector2::new(*x, *y));
            (*x, *y) = (pixel.x, pixel.y);
        }
    }

    /// The sums of one task, by the pose alone.
    #[inline(always)]
    fn weigh<T: Real>(&self, points: &[Point3<f64>], slopes: &[[T; 2]], scores: &[T]) -> LaneSums {
        let mut sums = LaneSums::default();
        let samples = points.chunks(LANES).zip(slopes.chunks(LANES)).zip(scores.chunks(LANES));
        for ((points, slopes), scores) in samples {
            let mut gradients = [[0.0; LANES]; 2];
            for (lane, (slope, &score)) in slopes.iter().zip(scores).enumerate() {
                let score: f64 = score.into();
                (0..2).for_each(|k| gradients[k][lane] = score * slope[k].into());
            }
            sums.add(&self.rows(&across(points.iter().copied()), &gradients));
        }
        sums
    }

    /// [`chain`] for the pose, of points with such gradients by the level's pixels; zero where these are zero.
    #[inline(always)]
    pub(crate) fn rows(&self, points: &[[f64; LANES]; 3], gradients: &[[f64; LANES]; 2]) -> [[f64; LANES]; POSE] {
        let linear = self.camera.intrinsics.linear();
        let mut rows = [[0.0; LANES]; POSE];
        for lane in 0..LANES {
            let turned = self.rotation * Vector3::new(points[0][lane], points[1][lane], points[2][lane]);
            let p = turned + self.translation;
            let inverse = 1.0 / p.z;
            let (x, y) = (p.x * inverse, p.y * inverse);
            let gradient = Vector2::new(gradients[0][lane], gradients[1][lane]);
            let bend = if self.is_distorted {
                self.camera.distortion.evaluate(&Vector2::new(x, y)).1
            } else {
                Matrix2::identity()
            };
            let plane = (linear * bend).tr_mul(&gradient) * inverse;
            let by_point = Vector3::new(plane.x, plane.y, -(plane.x * x + plane.y * y));
            let by_turn = turned.cross(&by_point);
            let row = [by_turn.x, by_turn.y, by_turn.z, by_point.x, by_point.y, by_point.z];
            let is_none = (gradient.x == 0.0) & (gradient.y == 0.0);
            for k in 0..POSE {
                rows[k][lane] = if is_none { 0.0 } else { row[k] };
            }
        }
        rows
    }
}

/// The coordinates of at most so many points side by side; zero where there is none.
#[inline(always)]
pub(crate) fn across(points: impl Iterator<Item = Point3<f64>>) -> [[f64; LANES]; 3] {
    let mut coordinates = [[0.0; LANES]; 3];
    for (lane, point) in points.take(LANES).enumerate() {
        (0..3).for_each(|k| coordinates[k][lane] = point[k]);
    }
    coordinates
}

/// Sums of rows by the pose, and of the lower triangles of their outer products, several side by side.
#[derive(Default)]
pub(crate) struct LaneSums {
    first: [[f64; LANES]; POSE],
    second: [[[f64; LANES]; POSE]; POSE],
}

impl LaneSums {
    #[inline(always)]
    pub(crate) fn add(&mut self, rows: &[[f64; LANES]; POSE]) {
        for (i, row) in rows.iter().enumerate() {
            self.first[i].iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
            for (sums, other) in self.second[i].iter_mut().zip(&rows[..=i]) {
                for (sum, (x, y)) in sums.iter_mut().zip(row.iter().zip(other)) {
                    *sum += x * y;
                }
            }
        }
    }

    pub(crate) fn sums(&self) -> Sums<MOST> {
        let mut sums = Sums::default();
        for i in 0..POSE {
            sums.first[i] = self.first[i].iter().sum();
            (0..=i).for_each(|j| sums.second[i][j] = self.second[i][j].iter().sum());
        }
        sums
    }
}

/// `gradientᵀ · ∂pixel/∂ξ` for one point and the tangent ξ; `gradient` is by the level's pixels.
#[inline]
pub(crate) fn chain(
    view: &View,
    camera: &Camera,
    refine: Refine,
    scale: f64,
    point: &Point3<f64>,
    gradient: &Vector2<f64>,
) -> Option<[f64; MOST]> {
    let turned: Vector3<f64> = view.pose.rotation * point.coords;
    let in_camera = Point3::from(turned + view.pose.translation);
    let mut row = [0.0; MOST];
    let by_point = if refine == Refine::default() {
        camera.project_with_jacobian(&in_camera)?.1.tr_mul(gradient)
    } else {
        let projection = camera.project_with_jacobians(&in_camera)?;
        refine.chain(camera, scale, &projection, gradient, &mut row[POSE..]);
        projection.point.tr_mul(gradient)
    };
    // A step ω turns the point about the model's origin: d(exp(ω) R X)/dω = −[R X]×.
    row[..3].copy_from_slice(turned.cross(&by_point).as_slice());
    row[3..6].copy_from_slice(by_point.as_slice());
    Some(row)
}

/// Sums of rows of at most `N` numbers, and of the lower triangles of their outer products.
pub(crate) struct Sums<const N: usize> {
    first: [f64; N],
    second: [[f64; N]; N],
}

impl<const N: usize> Default for Sums<N> {
    fn default() -> Self {
        Self { first: [0.0; N], second: [[0.0; N]; N] }
    }
}

impl<const N: usize> Sums<N> {
    #[inline]
    pub(crate) fn add(&mut self, row: &[f64]) {
        for (i, x) in row.iter().enumerate() {
            self.first[i] += x;
            for (sum, y) in self.second[i][..=i].iter_mut().zip(row) {
                *sum += x * y;
            }
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        for i in 0..N {
            self.first[i] += other.first[i];
            for j in 0..=i {
                self.second[i][j] += other.second[i][j];
            }
        }
    }

    /// Gradient and curvature of the first components, scaled.
    pub(crate) fn derivatives(&self, dimension: usize, scale: f64) -> Dense {
        Dense {
            gradient: DVector::from_fn(dimension, |i, _| scale * self.first[i]),
            curvature: DMatrix::from_fn(dimension, dimension, |i, j| scale * self.second[i.max(j)][i.min(j)]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objective::tests::scene;

    /// Of a lens with and without distortion, where some points have no pixel.
    #[test]
    fn many_together_are_what_they_are_one_by_one() {
        let (mut view, level, mut samples) = scene();
        samples.points.truncate(3_001);
        samples.points[7].z = -10.0;
        samples.points[8] = Point3::new(90.0, 60.0, 0.0);
        for distortion in [view.camera.distortion, Default::default()] {
            view.camera.distortion = distortion;
            let (values, slopes) = look::<f64>(&samples.points, &level, &view);
            let (mut one_by_one, mut seen) = (Sums::<MOST>::default(), 0);
            let mut scores = Vec::new();
            for (i, point) in samples.points.iter().enumerate() {
                let pixel = view.camera.project(&view.pose.transform_point(point));
                let sample = pixel.and_then(|p| level.sample::<f64>(p.x, p.y));
                assert_eq!(sample.is_none(), values[i].is_nan(), "{i}");
                scores.push(sample.map_or(0.0, |_| (i as f64).sin()));
                let Some([value, dx, dy]) = sample else { continue };
                assert!((value - values[i]).abs() < 1e-12);
                let gradient = scores[i] * Vector2::new(dx, dy);
                let row = chain(&view, &view.camera, Refine::default(), 1.0, point, &gradient).unwrap();
                one_by_one.add(&row[..POSE]);
                seen += 1;
            }
            assert!((2_000..3_000).contains(&seen), "{seen}");
            let of = |sums: &Sums<MOST>| sums.derivatives(POSE, 1.0);
            let together = of(&weigh(&samples.points, &slopes, &scores, &level, &view, Refine::default()));
            let one_by_one = of(&one_by_one);
            assert!((&together.gradient - &one_by_one.gradient).amax() < 1e-10 * one_by_one.gradient.amax());
            assert!((&together.curvature - &one_by_one.curvature).amax() < 1e-10 * one_by_one.curvature.amax());
        }
    }
}
