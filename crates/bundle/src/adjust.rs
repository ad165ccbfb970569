//! Bundle adjustment: cameras and points jointly, by Levenberg–Marquardt through Schur's complement.
//!
//! The points see each other only through the cameras. With U of the cameras, V of the points (blocks of 3 × 3) and W between
//! them, the normal equations reduce to those of the cameras (B. Triggs, P. McLauchlan, R. Hartley, A. Fitzgibbon, *Bundle
//! adjustment: a modern synthesis*, 1999):
//!
//! ```text
//! | U   W | c   g        S = U − W V⁻¹ Wᵀ,   S c = g − W V⁻¹ h
//! | Wᵀ  V | p = h        p = V⁻¹ (h − Wᵀ c)
//! ```
//!
//! With the Jacobians `A` (2 × C, by camera) and `B` (2 × 3, by point) of each observation, the block of S of cameras i and j
//! is the sum of `Aᵢᵀ (Bᵢ V⁻¹ Bⱼᵀ) Aⱼ` over the points both see: W itself is never stored. S has a block only where two
//! cameras see a common point, and is factored by sparse Cholesky where few do.
//!
//! Each camera's row of S is summed by one task from that camera's observations, in their order, so that nothing depends on
//! the number of threads. The damping follows Nielsen, as in [`LevenbergMarquardt`](texreg_optim::LevenbergMarquardt).

use crate::Columns;
use crate::reduced::Reduced;
use fearless_simd::{Level, dispatch, f64x4, prelude::*};
use nalgebra::{DMatrix, Matrix2x3, Matrix3, Point3, SMatrix, SVector, Vector2, Vector3};
use rayon::prelude::*;
use std::time::Instant;
use texreg_optim::{Iteration, Loss, Report, Stop};

/// How far from where it was seen a camera of C parameters sees a point.
pub trait ReprojectionError<const C: usize>: Sync {
    /// A camera.
    type Camera: Clone + Send + Sync;

    /// Predicted minus seen, pixels; `None` where the camera sees the point nowhere.
    fn residual(&self, camera: &Self::Camera, point: &Point3<f64>, pixel: &Vector2<f64>) -> Option<Vector2<f64>>;

    /// The residual with its Jacobians by a step of the camera and of the point.
    fn linearize(
        &self,
        camera: &Self::Camera,
        point: &Point3<f64>,
        pixel: &Vector2<f64>,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, C>, Matrix2x3<f64>)>;

    /// The camera that a step leads to.
    fn retract(&self, camera: &Self::Camera, step: &SVector<f64, C>) -> Self::Camera;
}

/// Cameras, points, and where the one saw the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Bundle<K> {
    /// The cameras.
    pub cameras: Vec<K>,
    /// The points.
    pub points: Vec<Point3<f64>>,
    /// The observations, in any order.
    pub observations: Vec<Observation>,
}

/// Where a camera saw a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// The index of the camera.
    pub camera: u32,
    /// The index of the point.
    pub point: u32,
    /// The pixel.
    pub pixel: Vector2<f64>,
}

/// How bundles are adjusted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BundleAdjustment {
    /// The most trial steps.
    pub iterations: usize,
    /// The damping of the first step, relative to the diagonals.
    pub damping: f64,
    /// Stops when a step lowers the cost by less than this share of it.
    pub cost_tolerance: f64,
    /// What an observation counts.
    pub loss: Loss,
}

impl Default for BundleAdjustment {
    fn default() -> Self {
        Self { iterations: 100, damping: 1e-4, cost_tolerance: 1e-6, loss: Loss::Squared }
    }
}

/// Bounds of the damping.
const MAX_DAMPING: f64 = 1e12;
const MIN_DAMPING: f64 = 1e-12;

/// Diagonals below this are damped as if they were this: a point seen once has no depth.
const LEAST_DIAGONAL: f64 = 1e-6;

/// Points of one task.
const CHUNK: usize = 512;

impl BundleAdjustment {
    /// Minimizes half the sum of squared residuals over the cameras' parameters that have a column, and over all points. The
    /// report's values are minus that cost. `None` where an observation names no camera or point, the columns are not those
    /// of so many cameras, or a camera sees one of its points nowhere at the start.
    pub fn adjust<const C: usize, E: ReprojectionError<C>>(
        &self,
        error: &E,
        start: Bundle<E::Camera>,
        columns: &Columns<C>,
        observer: &mut dyn FnMut(&Iteration),
    ) -> Option<Report<Bundle<E::Camera>>> {
        let began = Instant::now();
        let mut system = System::new(error, &start, columns, self.loss)?;
        let mut at = start;
        let mut trial = at.clone();
        let start = system.linearize(&at.cameras, &at.points)?;
        let mut cost = start;
        let mut damping = self.damping;
        let mut growth = 2.0;
        let mut iterations = Vec::new();
        let stop = loop {
            if iterations.len() == self.iterations {
                break Stop::Exhausted;
            }
            if damping > MAX_DAMPING {
                break Stop::Stalled;
            }
            let Some((promise, length)) = system.step(damping) else {
                damping *= growth;
                growth *= 2.0;
                continue;
            };
            if promise <= f64::EPSILON * cost {
                break Stop::Converged;
            }
            system.retract(&at, &mut trial);
            let trial_cost = system.cost(&trial.cameras, &trial.points);
            let better = trial_cost.filter(|&trial_cost| trial_cost < cost);
            let iteration = Iteration {
                value: trial_cost.map(|cost| -cost),
                step: length,
                damping,
                accepted: better.is_some(),
                seconds: began.elapsed().as_secs_f64(),
            };
            observer(&iteration);
            iterations.push(iteration);
            if let Some(lower) = better {
                let ratio = (cost - lower) / promise;
                damping *= (1.0 - (2.0 * ratio - 1.0).powi(3)).clamp(1.0 / 3.0, 2.0);
                damping = damping.max(MIN_DAMPING);
                growth = 2.0;
                let gain = cost - lower;
                std::mem::swap(&mut at, &mut trial);
                cost = lower;
                if gain < self.cost_tolerance * cost {
                    break Stop::Converged;
                }
                system.linearize(&at.cameras, &at.points)?;
            } else {
                damping *= growth;
                growth *= 2.0;
            }
        };
        Some(Report { point: at, start: -start, value: -cost, stop, iterations })
    }

    /// The covariance of the cameras' parameters, the points marginalized, for residuals of unit variance: one row a column of
    /// `columns`. `None` where they are not determined: the gauge must be fixed (see [`Columns::fix`]).
    pub fn covariance<const C: usize, E: ReprojectionError<C>>(
        &self,
        error: &E,
        at: &Bundle<E::Camera>,
        columns: &Columns<C>,
    ) -> Option<DMatrix<f64>> {
        let mut system = System::new(error, at, columns, self.loss)?;
        system.linearize(&at.cameras, &at.points)?;
        system.reduce(0.0)?;
        system.reduced.inverse()
    }
}

/// An observation's residual and Jacobians, each times the square root of the loss's weight.
#[derive(Clone, Copy)]
struct Linearized<const C: usize> {
    by_camera: [[f64; C]; 2],
    by_point: [[f64; 3]; 2],
    residual: [f64; 2],
}

/// A camera's row of the normal equations.
#[derive(Clone)]
struct Row<const C: usize> {
    /// Of U, whole.
    hessian: [[f64; C]; C],
    /// Minus the gradient of the cost.
    gradient: [f64; C],
    cost: f64,
    /// The cameras from this one on that see a point of it, ascending; this one first.
    others: Vec<u32>,
    /// The blocks of S for these.
    blocks: Vec<[[f64; C]; C]>,
    right: [f64; C],
}

impl<const C: usize> Row<C> {
    /// Linearizes a camera's observations, and sums its row of them; `None` where the cost is not defined.
    #[inline(always)]
    fn linearize<'a, S: Simd, E: ReprojectionError<C>>(
        &mut self,
        simd: S,
        error: &E,
        loss: Loss,
        camera: &E::Camera,
        observations: &mut [Linearized<C>],
        seen: impl Fn(usize) -> (&'a Point3<f64>, &'a Vector2<f64>),
    ) -> Option<()> {
        self.hessian = [[0.0; C]; C];
        self.gradient = [0.0; C];
        self.cost = 0.0;
        for (k, out) in observations.iter_mut().enumerate() {
            let (point, pixel) = seen(k);
            let (residual, a, b) = error.linearize(camera, point, pixel)?;
            let (cost, weight) = loss.evaluate(residual.norm_squared());
            self.cost += 0.5 * cost;
            let w = weight.sqrt();
            for r in 0..2 {
                out.residual[r] = w * residual[r];
                (0..C).for_each(|c| out.by_camera[r][c] = w * a[(r, c)]);
                (0..3).for_each(|c| out.by_point[r][c] = w * b[(r, c)]);
            }
            add_products(simd, &mut self.hessian, out.by_camera, out.by_camera);
            let [a, b] = &out.by_camera;
            (0..C).for_each(|i| self.gradient[i] -= a[i] * out.residual[0] + b[i] * out.residual[1]);
        }
        self.cost.is_finite().then_some(())
    }
}

/// Adds `a pᵀ + b qᵀ`.
#[inline(always)]
fn add_products<S: Simd, const R: usize, const C: usize>(
    simd: S,
    out: &mut [[f64; C]; R],
    [a, b]: [[f64; R]; 2],
    [p, q]: [[f64; C]; 2],
) {
    let ((p, p_rest), (q, q_rest)) = (p.as_chunks::<4>(), q.as_chunks::<4>());
    for ((line, a), b) in out.iter_mut().zip(a).zip(b) {
        let (wide, rest) = line.as_chunks_mut::<4>();
        for ((out, p), q) in wide.iter_mut().zip(p).zip(q) {
            let sum = f64x4::simd_from(simd, *out) + f64x4::simd_from(simd, *p) * a + f64x4::simd_from(simd, *q) * b;
            *out = sum.into();
        }
        for ((out, p), q) in rest.iter_mut().zip(p_rest).zip(q_rest) {
            *out += p * a + q * b;
        }
    }
}

/// A point's block: the lower triangle of V by rows, minus the gradient, and for a damping the inverse and `V⁻¹ h`.
#[derive(Clone, Copy, Default)]
struct Block {
    hessian: [f64; 6],
    gradient: [f64; 3],
    inverse: [[f64; 3]; 3],
    solved: [f64; 3],
    step: [f64; 3],
}

/// The normal equations. Observations are in the order of their cameras, and of points within a camera.
struct System<'a, const C: usize, E: ReprojectionError<C>> {
    error: &'a E,
    loss: Loss,
    columns: &'a Columns<C>,
    /// The first observation of each camera.
    first_of_camera: Vec<usize>,
    point: Vec<u32>,
    camera: Vec<u32>,
    pixel: Vec<Vector2<f64>>,
    /// The first entry of each point in `of_point`, which lists its observations, ascending.
    first_of_point: Vec<usize>,
    of_point: Vec<u32>,
    linearized: Vec<Linearized<C>>,
    rows: Vec<Row<C>>,
    blocks: Vec<Block>,
    reduced: Reduced,
    camera_steps: Vec<SVector<f64, C>>,
}

impl<'a, const C: usize, E: ReprojectionError<C>> System<'a, C, E> {
    fn new(error: &'a E, bundle: &Bundle<E::Camera>, columns: &'a Columns<C>, loss: Loss) -> Option<Self> {
        let (cameras, points) = (bundle.cameras.len(), bundle.points.len());
        let named = |o: &Observation| (o.camera as usize) < cameras && (o.point as usize) < points;
        if columns.cameras() != cameras || !bundle.observations.iter().all(named) {
            return None;
        }
        let mut sorted = bundle.observations.clone();
        sorted.sort_by_key(|o| (o.camera, o.point));
        let first = |count: usize, key: &dyn Fn(&Observation) -> u32| {
            let mut first = vec![0; count + 1];
            sorted.iter().for_each(|o| first[key(o) as usize + 1] += 1);
            (0..count).for_each(|i| first[i + 1] += first[i]);
            first
        };
        let first_of_camera = first(cameras, &|o| o.camera);
        let first_of_point = first(points, &|o| o.point);
        let mut next = first_of_point.clone();
        let mut of_point = vec![0; sorted.len()];
        for (i, o) in sorted.iter().enumerate() {
            let place = &mut next[o.point as usize];
            of_point[*place] = i as u32;
            *place += 1;
        }
        let camera: Vec<u32> = sorted.iter().map(|o| o.camera).collect();
        let row = |i: usize| {
            let mut seen = vec![false; cameras];
            seen[i] = true;
            for o in &sorted[first_of_camera[i]..first_of_camera[i + 1]] {
                let p = o.point as usize;
                of_point[first_of_point[p]..first_of_point[p + 1]]
                    .iter()
                    .for_each(|&other| seen[camera[other as usize] as usize] = true);
            }
            let others: Vec<u32> = (i as u32..cameras as u32).filter(|&j| seen[j as usize]).collect();
            let blocks = vec![[[0.0; C]; C]; others.len()];
            Row { hessian: [[0.0; C]; C], gradient: [0.0; C], cost: 0.0, others, blocks, right: [0.0; C] }
        };
        let rows: Vec<Row<C>> = (0..cameras).into_par_iter().map(row).collect();
        let reduced = Reduced::new(columns, rows.iter().map(|row| row.others.as_slice()))?;
        let nothing = Linearized { by_camera: [[0.0; C]; 2], by_point: [[0.0; 3]; 2], residual: [0.0; 2] };
        Some(Self {
            error,
            loss,
            columns,
            first_of_camera,
            point: sorted.iter().map(|o| o.point).collect(),
            camera,
            pixel: sorted.iter().map(|o| o.pixel).collect(),
            first_of_point,
            of_point,
            linearized: vec![nothing; sorted.len()],
            rows,
            blocks: vec![Block::default(); points],
            reduced,
            camera_steps: vec![SVector::zeros(); cameras],
        })
    }

    /// The cost at a point; `None` where it is not defined.
    fn cost(&self, cameras: &[E::Camera], points: &[Point3<f64>]) -> Option<f64> {
        let of_camera = |i: usize| {
            let mut cost = 0.0;
            for o in self.first_of_camera[i]..self.first_of_camera[i + 1] {
                let residual = self.error.residual(&cameras[i], &points[self.point[o] as usize], &self.pixel[o])?;
                cost += 0.5 * self.loss.evaluate(residual.norm_squared()).0;
            }
            Some(cost)
        };
        let costs: Option<Vec<f64>> = (0..cameras.len()).into_par_iter().map(of_camera).collect();
        Some(costs?.iter().sum()).filter(|cost: &f64| cost.is_finite())
    }

    /// Residuals, Jacobians and the diagonal blocks at a point; the cost.
    fn linearize(&mut self, cameras: &[E::Camera], points: &[Point3<f64>]) -> Option<f64> {
        let (error, loss, point, pixel) = (self.error, self.loss, &self.point, &self.pixel);
        let mut rest = self.linearized.as_mut_slice();
        let level = Level::new();
        let mut tasks = Vec::with_capacity(cameras.len());
        for (i, row) in self.rows.iter_mut().enumerate() {
            let (first, end) = (self.first_of_camera[i], self.first_of_camera[i + 1]);
            let (mine, others) = rest.split_at_mut(end - first);
            rest = others;
            tasks.push((&cameras[i], first, mine, row));
        }
        let defined = tasks.into_par_iter().map(|(camera, first, mine, row)| {
            let (points, point, pixel) = (&points, &point[first..], &pixel[first..]);
            dispatch!(level, simd => row.linearize(simd, error, loss, camera, mine, |k| (&points[point[k] as usize], &pixel[k])))
        });
        defined.collect::<Option<Vec<()>>>()?;
        let (linearized, first_of_point, of_point) = (&self.linearized, &self.first_of_point, &self.of_point);
        self.blocks.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, blocks)| {
            for (k, block) in blocks.iter_mut().enumerate() {
                let p = chunk * CHUNK + k;
                block.hessian = [0.0; 6];
                block.gradient = [0.0; 3];
                for &o in &of_point[first_of_point[p]..first_of_point[p + 1]] {
                    let Linearized { by_point: [a, b], residual: [x, y], .. } = &linearized[o as usize];
                    let mut next = 0;
                    for i in 0..3 {
                        for j in 0..=i {
                            block.hessian[next] += a[i] * a[j] + b[i] * b[j];
                            next += 1;
                        }
                        block.gradient[i] -= a[i] * x + b[i] * y;
                    }
                }
            }
        });
        Some(self.rows.iter().map(|row| row.cost).sum())
    }

    /// S and its right side for a damping.
    fn reduce(&mut self, damping: f64) -> Option<()> {
        let invert = |block: &mut Block| {
            let [a, b, c, d, e, f] = block.hessian;
            let damped = |x: f64| x + damping * x.max(LEAST_DIAGONAL);
            let matrix = Matrix3::new(damped(a), b, d, b, damped(c), e, d, e, damped(f));
            let inverse = matrix.cholesky()?.inverse();
            block.inverse = std::array::from_fn(|i| std::array::from_fn(|j| inverse[(i, j)]));
            block.solved = (inverse * Vector3::from(block.gradient)).into();
            Some(())
        };
        // A point nobody sees, or seen along one ray without damping, has no inverse.
        let seen = self.first_of_point.windows(2).map(|w| w[1] > w[0]).collect::<Vec<_>>();
        let inverted = self.blocks.par_chunks_mut(CHUNK).enumerate().map(|(chunk, blocks)| {
            blocks.iter_mut().enumerate().try_for_each(
                |(k, block)| {
                    if seen[chunk * CHUNK + k] { invert(block) } else { Some(()) }
                },
            )
        });
        inverted.collect::<Option<Vec<()>>>()?;

        let cameras = self.rows.len();
        let mut rows = std::mem::take(&mut self.rows);
        let level = Level::new();
        rows.par_iter_mut().enumerate().for_each_init(
            || vec![0u32; cameras],
            |slots, (i, row)| dispatch!(level, simd => self.reduce_row(simd, i, row, damping, slots)),
        );
        self.rows = rows;
        self.reduced.assemble(
            self.columns,
            self.rows.iter().map(|row| (row.others.as_slice(), row.blocks.as_slice(), &row.right)),
        );
        Some(())
    }

    /// A camera's row of S for a damping. `slots` has room for the place of each camera in the row.
    #[inline(always)]
    fn reduce_row<S: Simd>(&self, simd: S, i: usize, row: &mut Row<C>, damping: f64, slots: &mut [u32]) {
        let (linearized, blocks, camera) = (&self.linearized, &self.blocks, &self.camera);
        row.others.iter().enumerate().for_each(|(slot, &j)| slots[j as usize] = slot as u32);
        row.blocks.iter_mut().for_each(|block| *block = [[0.0; C]; C]);
        row.blocks[0] = row.hessian;
        (0..C).for_each(|k| row.blocks[0][k][k] += damping * row.hessian[k][k].max(LEAST_DIAGONAL));
        row.right = row.gradient;
        for o in self.first_of_camera[i]..self.first_of_camera[i + 1] {
            let p = self.point[o] as usize;
            let mine = &linearized[o];
            let block = &blocks[p];
            let [a, b] = &mine.by_camera;
            let [s, t] = mine.by_point.map(|row| dot(&row, &block.solved));
            (0..C).for_each(|k| row.right[k] -= a[k] * s + b[k] * t);
            // B V⁻¹, 2 × 3.
            let gain = mine.by_point.map(|row| [0, 1, 2].map(|j| dot(&row, &block.inverse[j])));
            let all = &self.of_point[self.first_of_point[p]..self.first_of_point[p + 1]];
            for &other in all.iter().rev() {
                let other = other as usize;
                // A camera that saw a point twice meets itself in both orders.
                if other < o && camera[other] as usize != i {
                    break;
                }
                let theirs = &linearized[other];
                let m = gain.map(|row| theirs.by_point.map(|other| dot(&row, &other)));
                let mut products = [[0.0; C]; 2];
                add_products(simd, &mut products, [[-m[0][0], -m[1][0]], [-m[0][1], -m[1][1]]], theirs.by_camera);
                let out = &mut row.blocks[slots[camera[other] as usize] as usize];
                add_products(simd, out, mine.by_camera, products);
            }
        }
    }

    /// Solves for a step; what it promises to take off the cost, and its length.
    fn step(&mut self, damping: f64) -> Option<(f64, f64)> {
        self.reduce(damping)?;
        let solution = self.reduced.solve()?;
        // The promise of a damped step is ½ (gᵀs + λ sᵀDs).
        let (mut promise, mut square) = (0.0, 0.0);
        for (i, (step, row)) in self.camera_steps.iter_mut().zip(&self.rows).enumerate() {
            *step = self.columns.gather(i, &solution);
            for k in 0..C {
                let x = step[k];
                promise += 0.5 * x * (row.gradient[k] + damping * x * row.hessian[k][k].max(LEAST_DIAGONAL));
                square += x * x;
            }
        }
        let (linearized, camera, steps) = (&self.linearized, &self.camera, &self.camera_steps);
        let (first_of_point, of_point) = (&self.first_of_point, &self.of_point);
        let parts = self.blocks.par_chunks_mut(CHUNK).enumerate().map(|(chunk, blocks)| {
            let (mut promise, mut square) = (0.0, 0.0);
            for (k, block) in blocks.iter_mut().enumerate() {
                let p = chunk * CHUNK + k;
                let mut right = block.gradient;
                for &o in &of_point[first_of_point[p]..first_of_point[p + 1]] {
                    let seen = &linearized[o as usize];
                    let step = &steps[camera[o as usize] as usize];
                    let [x, y] = seen.by_camera.map(|row| (0..C).map(|k| row[k] * step[k]).sum::<f64>());
                    let [a, b] = &seen.by_point;
                    (0..3).for_each(|k| right[k] -= a[k] * x + b[k] * y);
                }
                block.step = block.inverse.map(|row| dot(&row, &right));
                for (k, diagonal) in [0, 2, 5].into_iter().enumerate() {
                    let x = block.step[k];
                    let weight = damping * block.hessian[diagonal].max(LEAST_DIAGONAL);
                    promise += 0.5 * x * (block.gradient[k] + weight * x);
                    square += x * x;
                }
            }
            (promise, square)
        });
        let parts: Vec<(f64, f64)> = parts.collect();
        for (a, b) in parts {
            promise += a;
            square += b;
        }
        (promise.is_finite() && square.is_finite()).then(|| (promise, square.sqrt()))
    }

    /// The bundle that the step leads to.
    fn retract(&self, at: &Bundle<E::Camera>, to: &mut Bundle<E::Camera>) {
        for ((to, from), step) in to.cameras.iter_mut().zip(&at.cameras).zip(&self.camera_steps) {
            *to = self.error.retract(from, step);
        }
        for ((to, from), block) in to.points.iter_mut().zip(&at.points).zip(&self.blocks) {
            *to = from + Vector3::from(block.step);
        }
    }
}

#[inline]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
