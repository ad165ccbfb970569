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
use texreg_raster::{GBuffer, NO_FACE, Raycaster, Triangles};
use texreg_surface::Mesh;

/// Needles on the surface, with weights.
#[derive(Clone, Debug, Default)]
pub(crate) struct Needles {
    ends: Vec<[Point3<f64>; 2]>,
    weights: Vec<f32>,
}

/// The photo where the needles are: its agreement with them, and its second derivatives.
#[derive(Debug)]
pub(crate) struct Edges<T> {
    pub(crate) agreement: Agreement<T>,
    bends: Vec<[T; 3]>,
}

/// Gradients of the photo weaker than this, in its range a pixel, are noise.
const AGREEMENT: EdgeAgreement = EdgeAgreement { noise: 0.02 };

/// Changes of the normal weaker than this from a pixel's neighbour to the opposite one are no edge.
const FLAT: f32 = 0.1;

/// Needles taken by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 1024;

/// So many pixels are looked at for each needle that is wanted: most show no edge.
const CANDIDATES: usize = 4;

impl Needles {
    /// At most about `most` needles of what a rendering shows.
    pub(crate) fn of(mesh: &Mesh, picture: &GBuffer, camera: &Camera, view: &View, most: usize) -> Self {
        let width = picture.width as usize;
        let share = (CANDIDATES * most) as f32 / picture.covered().max(1) as f32;
        let reflectance = mesh.reflectance.as_deref().map(|values| (values, 1.0 / range(values)));
        let rows: Vec<Vec<(usize, usize, Edge)>> = (picture.face.par_chunks(width).enumerate().with_min_len(16))
            .map_init(
                || Looks {
                    mesh,
                    triangles: mesh.shape(),
                    picture,
                    raycaster: Raycaster::new(camera, &view.pose),
                    rotation: view.pose.rotation.matrix().cast(),
                    reflectance,
                },
                |looks, (y, faces)| {
                    let kept = |&(x, &face): &(usize, &u32)| face != NO_FACE && dither(x, y) < share;
                    let edges = faces.iter().enumerate().filter(kept);
                    edges.filter_map(|(x, _)| Some((x, y, looks.edge(x, y)?))).collect()
                },
            )
            .collect();
        let found: usize = rows.iter().map(Vec::len).sum();
        let share = share.min(1.0) * most as f32 / found.max(1) as f32;
        let mesh_from_camera = view.pose.inverse();
        let mut needles = Self::default();
        for (x, y, edge) in rows.into_iter().flatten().filter(|&(x, y, _)| dither(x, y) < share) {
            let pixel = Point2::new(x as f64, y as f64) + edge.outward;
            let (Some(ray), Some(other)) = (camera.unproject(&pixel), camera.unproject(&(pixel + edge.along))) else {
                continue;
            };
            let point = ray * f64::from(picture.depth[y * width + x]);
            // Along the outline the surface turns away: there a needle faces the camera.
            let steep = edge.normal.dot(&ray).abs() < 0.3 * ray.norm();
            let depth = if steep { point.z } else { edge.normal.dot(&point) / edge.normal.dot(&other) };
            if depth.is_finite() && depth > 0.0 {
                let ends = [point, other * depth].map(|p| mesh_from_camera.transform_point(&Point3::from(p)));
                needles.ends.push(ends);
                needles.weights.push(edge.weight);
            }
        }
        needles
    }

    /// What the needles meet with from a view.
    pub(crate) fn look<T: Real>(&self, level: &Level, camera: &Camera, view: &View) -> Edges<T> {
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
        Edges { agreement: AGREEMENT.evaluate(&edges, &self.weights, &gradients), bends }
    }

    /// The derivatives of the agreement by the tangent, in a level of `scale` pixels per pixel of the photo. Misalignments are taken as
    /// normal: the curvature is that of their likelihood.
    pub(crate) fn derivatives<T: Real>(
        &self,
        Edges { agreement, bends }: &Edges<T>,
        scale: f64,
        camera: &Camera,
        view: &View,
        refine: Refine,
    ) -> Dense {
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
                    let first = chain(view, camera, refine, scale, &ends[0], &by_first);
                    let second = chain(view, camera, refine, scale, &ends[1], &by_edge);
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
    /// The surface's normal in the camera's frame.
    normal: Vector3<f64>,
    weight: f32,
}

/// What a rendering shows of a mesh.
struct Looks<'a> {
    mesh: &'a Mesh,
    triangles: Triangles<'a>,
    picture: &'a GBuffer,
    raycaster: Raycaster,
    rotation: Matrix3<f32>,
    /// And the reciprocal of its range.
    reflectance: Option<(&'a [f32], f32)>,
}

impl Looks<'_> {
    /// What changes at an edge: a pixel's unit normal in the camera's frame, and its reflectance in its own range; zero where there is
    /// no surface.
    fn at(&mut self, x: usize, y: usize) -> Vector4<f32> {
        let face = self.picture.face[y * self.picture.width as usize + x];
        let mut look = || {
            let pixel = Point2::new(x as f64, y as f64);
            let [v, w] = self.raycaster.barycentric(&self.triangles, (face != NO_FACE).then_some(face)?, pixel)?;
            let (corners, weights) = (self.mesh.triangles[face as usize], [1.0 - v - w, v, w]);
            let parts = || corners.iter().map(|&k| k as usize).zip(weights);
            let normal: Vector3<f32> = parts().map(|(k, weight)| Vector3::from(self.mesh.normals[k]) * weight).sum();
            let seen = self
                .reflectance
                .map_or(0.0, |(values, unit)| unit * parts().map(|(k, weight)| values[k] * weight).sum::<f32>());
            Some((self.rotation * normal).try_normalize(0.0)?.push(seen))
        };
        look().unwrap_or_default()
    }

    /// The edge at a pixel, by the structure tensor of what is seen: W. Förstner and E. Gülch, *A fast operator for detection and precise
    /// location of distinct points, corners and centres of circular features*, 1987. Background has a normal of length zero, so outlines
    /// are edges like others.
    fn edge(&mut self, x: usize, y: usize) -> Option<Edge> {
        let (width, height) = (self.picture.width as usize, self.picture.height as usize);
        let normal = self.at(x, y).xyz();
        if x == 0 || y == 0 || x + 1 == width || y + 1 == height || normal == Vector3::zeros() {
            return None;
        }
        let [left, right, above, below] = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)].map(|(x, y)| self.at(x, y));
        let (dx, dy) = (right - left, below - above);
        let (xx, xy, yy) = (dx.dot(&dx), dx.dot(&dy), dy.dot(&dy));
        // The difference of the tensor's eigenvalues, and the angle of the larger one's axis.
        let anisotropy = (xx - yy).hypot(2.0 * xy);
        let weight = anisotropy.sqrt().min(1.0);
        let across = 0.5 * f64::from(2.0 * xy).atan2(f64::from(xx - yy));
        let is_background = |look: Vector4<f32>| f64::from(u8::from(look.xyz() == Vector3::zeros()));
        let outward =
            Vector2::new(is_background(right) - is_background(left), is_background(below) - is_background(above));
        (weight > FLAT).then(|| Edge {
            along: Vector2::new(-across.sin(), across.cos()),
            outward: outward.try_normalize(0.0).map_or(Vector2::zeros(), |outward| 0.5 * outward),
            normal: normal.cast(),
            weight,
        })
    }
}
