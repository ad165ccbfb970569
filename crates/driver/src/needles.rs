//! Predicted edges: short needles on the surface, along lines where what is seen of it changes — its creases and its outline.
//!
//! A needle is two points of the surface a pixel apart. Both move with the camera, so the direction of the edge follows the pose
//! and the lens exactly; the photo's gradient at the first is compared with it.

use crate::Refine;
use crate::parameters::{Dense, MOST};
use crate::pyramid::Level;
use crate::samples::dither;
use crate::sweep::{Sums, chain};
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3, Vector4};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_mi::{Agreement, EdgeAgreement, Real};
use texreg_raster::{GBuffer, NO_FACE, Raycaster};
use texreg_surface::Mesh;

/// Needles on the surface, with weights.
#[derive(Clone, Debug, Default)]
pub(crate) struct Needles {
    ends: Vec<[Point3<f64>; 2]>,
    weights: Vec<f32>,
}

/// Gradients of the photo weaker than this, in its range a pixel, are noise.
const AGREEMENT: EdgeAgreement = EdgeAgreement { noise: 0.02 };

/// Changes of the normal weaker than this from a pixel's neighbour to the opposite one are no edge.
const FLAT: f32 = 0.1;

/// Needles taken by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1024;

impl Needles {
    /// About `most` needles of what a rendering shows.
    pub(crate) fn of(mesh: &Mesh, picture: &GBuffer, camera: &Camera, view: &View, most: usize) -> Self {
        let width = picture.width as usize;
        let looks = looks(mesh, picture, camera, view);
        let edges: Vec<(usize, Edge)> = (0..picture.face.len())
            .into_par_iter()
            .with_min_len(4096)
            .filter_map(|i| Some((i, edge(&looks, width, i)?)))
            .collect();
        let share = most as f32 / edges.len().max(1) as f32;
        let mesh_from_camera = view.pose.inverse();
        let mut needles = Self::default();
        for (i, edge) in edges {
            let (x, y) = (i % width, i / width);
            if dither(x, y) >= share {
                continue;
            }
            let pixel = Point2::new(x as f64, y as f64) + edge.outward;
            let (Some(ray), Some(other)) = (camera.unproject(&pixel), camera.unproject(&(pixel + edge.along))) else {
                continue;
            };
            let point = ray * f64::from(picture.depth[i]);
            let normal: Vector3<f64> = looks[i].xyz().cast();
            // Along the outline the surface turns away: there a needle faces the camera.
            let steep = normal.dot(&ray).abs() < 0.3 * ray.norm();
            let depth = if steep { point.z } else { normal.dot(&point) / normal.dot(&other) };
            if depth.is_finite() && depth > 0.0 {
                let ends = [point, other * depth].map(|p| mesh_from_camera.transform_point(&Point3::from(p)));
                needles.ends.push(ends);
                needles.weights.push(edge.weight);
            }
        }
        needles
    }

    /// The agreement from a view, and the second derivatives of the photo where the needles are.
    fn look<T: Real>(&self, level: &Level, camera: &Camera, view: &View) -> (Agreement<T>, Vec<[T; 3]>) {
        let seen: Vec<([T; 2], [T; 2], [T; 3])> = self
            .ends
            .par_iter()
            .with_min_len(CHUNK)
            .map(|ends| {
                let [a, b] = ends.map(|point| camera.project(&view.pose.transform_point(&point)));
                let seen = a.zip(b).and_then(|(a, b)| {
                    let edge = b - a;
                    let [_, x, y] = level.grid.sample::<T>(a.x, a.y)?;
                    Some(([T::of(edge.x), T::of(edge.y)], [x, y], level.grid.bend::<T>(a.x, a.y)?))
                });
                seen.unwrap_or_default()
            })
            .collect();
        let (edges, (gradients, bends)): (Vec<_>, (Vec<_>, Vec<_>)) =
            seen.into_iter().map(|(edge, gradient, bend)| (edge, (gradient, bend))).unzip();
        (AGREEMENT.evaluate(&edges, &self.weights, &gradients), bends)
    }

    /// The share of the needles' weight that the photo agrees with.
    pub(crate) fn value<T: Real>(&self, level: &Level, camera: &Camera, view: &View) -> f64 {
        self.look::<T>(level, camera, view).0.value
    }

    /// The derivatives of [`value`](Self::value) by the tangent. Misalignments are taken as normal: the curvature is that of
    /// their likelihood.
    pub(crate) fn derivatives<T: Real>(&self, level: &Level, camera: &Camera, view: &View, refine: Refine) -> Dense {
        let (agreement, bends) = self.look::<T>(level, camera, view);
        let dimension = refine.dimension();
        let sums: Vec<Sums<MOST>> = self
            .ends
            .par_chunks(CHUNK)
            .zip(agreement.scores.par_chunks(CHUNK))
            .zip(bends.par_chunks(CHUNK))
            .map(|((ends, scores), bends)| {
                let mut sums = Sums::default();
                for ((ends, (by_edge, by_gradient)), bend) in ends.iter().zip(scores).zip(bends) {
                    let [xx, xy, yy] = bend.map(Into::<f64>::into);
                    let by_edge = Vector2::from(by_edge.map(Into::<f64>::into));
                    let [gx, gy] = by_gradient.map(Into::<f64>::into);
                    let by_first = Vector2::new(xx * gx + xy * gy, xy * gx + yy * gy) - by_edge;
                    let first = chain(view, camera, refine, level.scale, &ends[0], &by_first);
                    let second = chain(view, camera, refine, level.scale, &ends[1], &by_edge);
                    if let Some((first, second)) = first.zip(second) {
                        let row: [f64; MOST] = std::array::from_fn(|k| first[k] + second[k]);
                        sums.add(&row[..dimension]);
                    }
                }
                sums
            })
            .collect();
        let mut total = Sums::default();
        sums.iter().for_each(|part| total.merge(part));
        let share = 1.0 / self.ends.len().max(1) as f64;
        let mut derivatives = total.derivatives(dimension, share);
        derivatives.curvature /= 2.0 * (1.0 - agreement.value).max(1e-3);
        derivatives
    }
}

/// What changes at an edge, for each pixel: the unit normal in the camera's frame, and the reflectance in its own range; zero where
/// there is no surface.
fn looks(mesh: &Mesh, picture: &GBuffer, camera: &Camera, view: &View) -> Vec<Vector4<f32>> {
    let triangles = mesh.shape();
    let rotation: Matrix3<f32> = view.pose.rotation.matrix().cast();
    let reflectance = mesh.reflectance.as_ref().map(|values| (values, 1.0 / range(values)));
    let rows: Vec<Vec<Vector4<f32>>> = picture
        .face
        .par_chunks(picture.width as usize)
        .enumerate()
        .map_init(
            || Raycaster::new(camera, &view.pose),
            |raycaster, (y, faces)| {
                let mut look = |(x, &face): (usize, &u32)| {
                    if face == NO_FACE {
                        return None;
                    }
                    let [v, w] = raycaster.barycentric(&triangles, face, Point2::new(x as f64, y as f64))?;
                    let (corners, weights) = (mesh.triangles[face as usize], [1.0 - v - w, v, w]);
                    let parts = corners.iter().zip(weights);
                    let normal: Vector3<f32> =
                        parts.clone().map(|(&k, w)| Vector3::from(mesh.normals[k as usize]) * w).sum();
                    let seen = reflectance
                        .map_or(0.0, |(values, unit)| unit * parts.map(|(&k, w)| values[k as usize] * w).sum::<f32>());
                    Some((rotation * normal).try_normalize(0.0)?.push(seen))
                };
                faces.iter().enumerate().map(|pixel| look(pixel).unwrap_or_default()).collect()
            },
        )
        .collect();
    rows.into_iter().flatten().collect()
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
    /// From the pixel's centre to the edge, in pixels: zero but on an outline.
    outward: Vector2<f64>,
    weight: f32,
}

/// The edge at a pixel, by the structure tensor of what is seen: W. Förstner and E. Gülch, *A fast operator for detection and precise
/// location of distinct points, corners and centres of circular features*, 1987. Background has a normal of length zero, so outlines
/// are edges like others.
fn edge(looks: &[Vector4<f32>], width: usize, i: usize) -> Option<Edge> {
    let (x, y) = (i % width, i / width);
    let inside = x > 0 && y > 0 && x + 1 < width && i + width < looks.len();
    let is_surface = |i: usize| looks[i].xyz() != Vector3::zeros();
    if !inside || !is_surface(i) {
        return None;
    }
    let (dx, dy) = (looks[i + 1] - looks[i - 1], looks[i + width] - looks[i - width]);
    let (xx, xy, yy) = (dx.dot(&dx), dx.dot(&dy), dy.dot(&dy));
    // The difference of the tensor's eigenvalues, and the angle of the larger one's axis.
    let anisotropy = (xx - yy).hypot(2.0 * xy);
    let weight = anisotropy.sqrt().min(1.0);
    let across = 0.5 * f64::from(2.0 * xy).atan2(f64::from(xx - yy));
    let is_background = |i: usize| f64::from(u8::from(!is_surface(i)));
    let outward =
        Vector2::new(is_background(i + 1) - is_background(i - 1), is_background(i + width) - is_background(i - width));
    (weight > FLAT).then(|| Edge {
        along: Vector2::new(-across.sin(), across.cos()),
        outward: outward.try_normalize(0.0).map_or(Vector2::zeros(), |outward| 0.5 * outward),
        weight,
    })
}
