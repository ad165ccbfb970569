//! Predicted edges: short needles on the surface, along lines where what is seen of it changes — its creases and its outline.
//!
//! A needle is two points of the surface a pixel apart. Both move with the camera, so the direction of the edge follows the pose
//! and the lens exactly; the photo's gradient at the first is compared with it.

use crate::Refine;
use crate::parameters::{Dense, MOST};
use crate::pyramid::Level;
use crate::samples::{dither, surface_point};
use crate::sweep::{BLOCK, LANES, LaneSums, Projector, Sums, across, chain};
use fearless_simd::dispatch;
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3, Vector4};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_mi::{Agreement, EdgeAgreement, Real};
use texreg_raster::{GBuffer, NO_FACE, Raycaster};
use texreg_surface::Mesh;

/// Needles on the surface, with weights.
#[derive(Clone, Debug)]
pub(crate) struct Needles {
    ends: Vec<[Point3<f64>; 2]>,
    weights: Vec<f32>,
    agreement: EdgeAgreement,
}

/// The photo where the needles are: its agreement with them, and its second derivatives.
#[derive(Debug)]
pub(crate) struct Edges<T> {
    pub(crate) agreement: Agreement<T>,
    bends: Vec<[T; 3]>,
}

/// Gradients of the photo weaker than this many times their root mean square at the needles are noise. With much less, all places
/// where the direction is right are as good: an edge is then as wide as its blur, and wherever shading goes on beside it wider still.
const NOISE: f64 = 1.5;

/// The least noise, in the photo's range a pixel.
const LEAST_NOISE: f64 = 1e-3;

/// Changes of the normal weaker than this from a pixel's neighbour to the opposite one are no edge.
const FLAT: f32 = 0.1;

/// Needles taken by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1024;

/// So many pixels are looked at for each needle that is wanted: most show no edge.
const CANDIDATES: usize = 4;

impl Needles {
    /// At most about `most` needles of what a rendering at a level's resolution shows.
    pub(crate) fn of(mesh: &Mesh, picture: &GBuffer, level: &Level, view: &View, most: usize) -> Self {
        let camera = &level.camera(&view.camera);
        let width = picture.width as usize;
        let share = (CANDIDATES * most) as f32 / picture.covered().max(1) as f32;
        let looks = Looks {
            mesh,
            picture,
            raycaster: Raycaster::new(camera, &view.pose),
            rotation: view.pose.rotation.matrix().cast(),
            reflectance: mesh.reflectance.as_deref().map(|values| (values, 1.0 / range(values))),
        };
        let rows: Vec<Vec<(usize, Edge)>> =
            (0..picture.height as usize).into_par_iter().with_min_len(16).map(|y| looks.edges(y, share)).collect();
        let found: usize = rows.iter().map(Vec::len).sum();
        let share = share.min(1.0) * most as f32 / found.max(1) as f32;
        let mesh_from_camera = view.pose.inverse();
        let needle = |x: usize, y: usize, edge: &Edge| {
            let depth = f64::from(picture.depth[y * width + x]);
            let [at, other] = edge.ends(camera, &view.pose.transform_point(&edge.point))?;
            let point = at * depth;
            // Along the outline the surface turns away: there a needle faces the camera.
            let steep = edge.normal.dot(&at).abs() < 0.3 * at.norm();
            let depth = if steep { depth } else { edge.normal.dot(&point) / edge.normal.dot(&other) };
            let ends = [point, other * depth].map(|p| mesh_from_camera.transform_point(&Point3::from(p)));
            let [_, gx, gy] = level.sample::<f64>(x as f64 + edge.outward.x, y as f64 + edge.outward.y)?;
            let energy = gx * gx + gy * gy;
            (depth.is_finite() && depth > 0.0).then_some((ends, (edge.weight, f64::from(edge.weight) * energy)))
        };
        let needles = rows.par_iter().enumerate().with_min_len(16).map(|(y, edges)| {
            let kept = edges.iter().filter(|(x, _)| dither(*x, y) < share);
            kept.filter_map(|(x, edge)| needle(*x, y, edge)).collect::<Vec<_>>()
        });
        let needles = needles.collect::<Vec<_>>().into_iter().flatten();
        let (ends, (weights, energies)): (Vec<_>, (Vec<f32>, Vec<f64>)) = needles.unzip();
        let [energy, weight] = [energies.iter().sum::<f64>(), weights.iter().copied().map(f64::from).sum()];
        let noise = (NOISE * (energy / weight).sqrt()).max(LEAST_NOISE);
        Self { ends, weights, agreement: EdgeAgreement { noise } }
    }

    /// What the needles meet with from a view.
    pub(crate) fn look<T: Real>(&self, level: &Level, view: &View) -> Edges<T> {
        let projector = Projector::new(level, view);
        let features = fearless_simd::Level::new();
        let count = self.ends.len();
        let (mut edges, mut gradients) = (vec![[T::default(); 2]; count], vec![[T::default(); 2]; count]);
        let mut bends = vec![[T::default(); 3]; count];
        let parts = (edges.par_chunks_mut(CHUNK), gradients.par_chunks_mut(CHUNK), bends.par_chunks_mut(CHUNK));
        (self.ends.par_chunks(CHUNK), parts).into_par_iter().for_each(|(ends, (edges, gradients, bends))| {
            dispatch!(features, _simd => meet(&projector, level, ends, edges, gradients, bends));
        });
        Edges { agreement: self.agreement.evaluate(&edges, &self.weights, &gradients), bends }
    }

    /// The derivatives of the agreement by the tangent. Misalignments are taken as normal: the curvature is that of their
    /// likelihood.
    pub(crate) fn derivatives<T: Real>(
        &self,
        Edges { agreement, bends }: &Edges<T>,
        level: &Level,
        view: &View,
        refine: Refine,
    ) -> Dense {
        let projector = Projector::new(level, view);
        let features = fearless_simd::Level::new();
        let camera = level.camera(&view.camera);
        let parts = (self.ends.par_chunks(CHUNK), agreement.scores.par_chunks(CHUNK), bends.par_chunks(CHUNK));
        let sums: Vec<Sums<MOST>> = parts
            .into_par_iter()
            .map(|(ends, scores, bends)| {
                if refine == Refine::default() {
                    return dispatch!(features, _simd => weigh(&projector, ends, scores, bends)).sums();
                }
                let mut sums = Sums::default();
                for ((ends, score), bend) in ends.iter().zip(scores).zip(bends) {
                    let [by_first, by_second] = by_ends(score, bend);
                    let first = chain(view, &camera, refine, level.scale, &ends[0], &by_first);
                    let second = chain(view, &camera, refine, level.scale, &ends[1], &by_second);
                    if let Some((first, second)) = first.zip(second) {
                        let row: [f64; MOST] = std::array::from_fn(|k| first[k] + second[k]);
                        sums.add(&row[..refine.dimension()]);
                    }
                }
                sums
            })
            .collect();
        let mut total = Sums::default();
        sums.iter().for_each(|part| total.merge(part));
        let share = 1.0 / self.ends.len().max(1) as f64;
        let mut derivatives = total.derivatives(refine.dimension(), share);
        derivatives.curvature /= 2.0 * (1.0 - agreement.value).max(1e-3);
        derivatives
    }
}

/// The needles of one task in the photo: their directions, its gradients and its second derivatives; zero where it does not show
/// them.
#[inline(always)]
fn meet<T: Real>(
    projector: &Projector,
    level: &Level,
    ends: &[[Point3<f64>; 2]],
    edges: &mut [[T; 2]],
    gradients: &mut [[T; 2]],
    bends: &mut [[T; 3]],
) {
    let (mut x, mut y) = ([0.0; BLOCK], [0.0; BLOCK]);
    let found = edges.chunks_mut(BLOCK / 2).zip(gradients.chunks_mut(BLOCK / 2)).zip(bends.chunks_mut(BLOCK / 2));
    for (ends, ((edges, gradients), bends)) in ends.chunks(BLOCK / 2).zip(found) {
        projector.project(ends.as_flattened(), &mut x, &mut y);
        for (i, ((edge, gradient), bend)) in edges.iter_mut().zip(gradients).zip(bends).enumerate() {
            let (a, b) = (2 * i, 2 * i + 1);
            if let Some(seen) = level.grid.bend(x[a], y[a])
                && !x[b].is_nan()
            {
                *edge = [T::of(x[b] - x[a]), T::of(y[b] - y[a])];
                (*gradient, *bend) = seen;
            }
        }
    }
}

/// The derivatives by both ends of a needle: the gradient of the photo is that at the first.
#[inline(always)]
fn by_ends<T: Real>((by_edge, by_gradient): &([T; 2], [T; 2]), bend: &[T; 3]) -> [Vector2<f64>; 2] {
    let [xx, xy, yy]: [f64; 3] = [bend[0].into(), bend[1].into(), bend[2].into()];
    let [gx, gy]: [f64; 2] = [by_gradient[0].into(), by_gradient[1].into()];
    let by_edge = Vector2::new(by_edge[0].into(), by_edge[1].into());
    [Vector2::new(xx * gx + xy * gy, xy * gx + yy * gy) - by_edge, by_edge]
}

/// The sums of one task, by the pose alone.
#[inline(always)]
fn weigh<T: Real>(
    projector: &Projector,
    ends: &[[Point3<f64>; 2]],
    scores: &[([T; 2], [T; 2])],
    bends: &[[T; 3]],
) -> LaneSums {
    let mut sums = LaneSums::default();
    for ((ends, scores), bends) in ends.chunks(LANES).zip(scores.chunks(LANES)).zip(bends.chunks(LANES)) {
        let mut gradients = [[[0.0; LANES]; 2]; 2];
        for (lane, (score, bend)) in scores.iter().zip(bends).enumerate() {
            let by_ends = by_ends(score, bend);
            for end in 0..2 {
                (0..2).for_each(|k| gradients[end][k][lane] = by_ends[end][k]);
            }
        }
        let [mut rows, second] =
            [0, 1].map(|end| projector.rows(&across(ends.iter().map(|ends| ends[end])), &gradients[end]));
        for (rows, second) in rows.iter_mut().zip(&second) {
            rows.iter_mut().zip(second).for_each(|(sum, x)| *sum += x);
        }
        sums.add(&rows);
    }
    sums
}

/// The range of most values: from a twentieth to nineteen twentieths of some of them.
fn range(values: &[f32]) -> f32 {
    let mut some: Vec<f32> = values.iter().step_by(values.len() / 2_000 + 1).copied().collect();
    some.sort_unstable_by(f32::total_cmp);
    let at = |share: usize| some.get(some.len() * share / 20).copied().unwrap_or(0.0);
    (at(19) - at(1)).max(f32::MIN_POSITIVE)
}

/// An edge in a picture of the model.
struct Edge {
    /// The direction along it, of length 1.
    along: Vector2<f64>,
    /// From the pixel's centre to the edge: half a pixel towards the background on an outline, else zero.
    outward: Vector2<f64>,
    /// The surface's point at the pixel, in the model's frame.
    point: Point3<f64>,
    /// The surface's normal in the camera's frame.
    normal: Vector3<f64>,
    weight: f32,
}

impl Edge {
    /// The directions (x, y, 1) that see the edge, and one pixel along it, from the surface's point in the camera's frame: to first
    /// order, as both are near.
    fn ends(&self, camera: &Camera, point: &Point3<f64>) -> Option<[Vector3<f64>; 2]> {
        let p = point.xy().coords / point.z;
        let (_, slope) = camera.distortion.apply_with_jacobian(&p)?;
        let by_pixel = (camera.intrinsics.linear() * slope).try_inverse()?;
        Some([self.outward, self.outward + self.along].map(|step| (p + by_pixel * step).push(1.0)))
    }
}

/// What a rendering shows of a mesh.
struct Looks<'a> {
    mesh: &'a Mesh,
    picture: &'a GBuffer,
    raycaster: Raycaster,
    rotation: Matrix3<f32>,
    /// And the reciprocal of its range.
    reflectance: Option<(&'a [f32], f32)>,
}

impl Looks<'_> {
    /// The edges at a share of the pixels of a row, with their columns.
    fn edges(&self, y: usize, share: f32) -> Vec<(usize, Edge)> {
        let (width, height) = (self.picture.width as usize, self.picture.height as usize);
        if y == 0 || y + 1 == height {
            return Vec::new();
        }
        let faces = &self.picture.face[y * width..][..width];
        let columns = (1..width.saturating_sub(1)).filter(|&x| faces[x] != NO_FACE && dither(x, y) < share);
        let columns: Vec<usize> = columns.collect();
        let around = |x: usize| [(x, y), (x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)];
        let pixels = columns.iter().flat_map(|&x| around(x)).map(|(x, y)| {
            let face = self.picture.face[y * width + x];
            (face, Point2::new(x as f64, y as f64))
        });
        let pixels: Vec<(u32, Point2<f64>)> = pixels.collect();
        let weights = self.raycaster.clone().barycentrics(&self.mesh.shape(), &pixels);
        let around = pixels.chunks_exact(5).zip(weights.chunks_exact(5));
        let edges = columns.into_iter().zip(around).filter_map(|(x, (pixels, weights))| {
            let looks = std::array::from_fn(|k| self.at(pixels[k].0, weights[k]));
            Some((x, self.edge(looks, || self.point(pixels[0].0, weights[0]))?))
        });
        edges.collect()
    }

    /// The surface's point at a pixel, in the model's frame.
    fn point(&self, face: u32, [v, w]: [f32; 2]) -> Point3<f64> {
        surface_point(self.mesh, self.mesh.triangles[face as usize], [1.0 - v - w, v, w])
    }

    /// What changes at an edge: a pixel's unit normal in the model's frame, and its reflectance in its own range; zero where there is
    /// no surface.
    #[inline]
    fn at(&self, face: u32, [v, w]: [f32; 2]) -> Vector4<f32> {
        if v.is_nan() {
            return Vector4::zeros();
        }
        let corners = self.mesh.triangles[face as usize];
        let [a, b, c] = corners.map(|k| Vector3::from(self.mesh.normals[k as usize]));
        let normal = a * (1.0 - v - w) + b * v + c * w;
        let square = normal.norm_squared();
        if square == 0.0 {
            return Vector4::zeros();
        }
        let seen = self.reflectance.map_or(0.0, |(values, unit)| {
            let [a, b, c] = corners.map(|k| values[k as usize]);
            unit * ((1.0 - v - w) * a + v * b + w * c)
        });
        (normal / square.sqrt()).push(seen)
    }

    /// The edge at a pixel from what it and those on the left, on the right, above and below show, by the structure tensor:
    /// W. Förstner and E. Gülch, *A fast operator for detection and precise location of distinct points, corners and centres of circular
    /// features*, 1987. Background has a normal of length zero, so outlines are edges like others.
    fn edge(
        &self,
        [here, left, right, above, below]: [Vector4<f32>; 5],
        point: impl FnOnce() -> Point3<f64>,
    ) -> Option<Edge> {
        let normal = here.xyz();
        let (dx, dy) = (right - left, below - above);
        let (xx, xy, yy) = (dx.dot(&dx), dx.dot(&dy), dy.dot(&dy));
        // The difference of the tensor's eigenvalues, and the angle of the larger one's axis.
        let anisotropy = (xx - yy).hypot(2.0 * xy);
        let weight = anisotropy.sqrt().min(1.0);
        if normal == Vector3::zeros() || weight <= FLAT {
            return None;
        }
        let across = 0.5 * f64::from(2.0 * xy).atan2(f64::from(xx - yy));
        let is_background = |look: Vector4<f32>| f64::from(u8::from(look.xyz() == Vector3::zeros()));
        let outward =
            Vector2::new(is_background(right) - is_background(left), is_background(below) - is_background(above));
        Some(Edge {
            along: Vector2::new(-across.sin(), across.cos()),
            outward: outward.try_normalize(0.0).map_or(Vector2::zeros(), |outward| 0.5 * outward),
            point: point(),
            normal: (self.rotation * normal).cast(),
            weight,
        })
    }
}
