//! Two photos of the same surface: how much one tells of the other, through the points that both see.
//!
//! Points of the surface that one photo sees are looked up in the other; both values move, each with its own camera. With the
//! scores `a_i`, `b_i` of [`PhotoPair`] the derivative by both tangents is `1/N Σ (a_i g_i, b_i h_i)`, and the curvature is the
//! empirical Fisher matrix of these rows.

use crate::parameters::{Dense, MOST, ViewSpace};
use crate::pyramid::Level;
use crate::samples::SurfaceSamples;
use crate::sweep::{Sums, chain, look};
use nalgebra::{DMatrix, Point3, Vector2};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_mi::{Mutual, PhotoPair};
use texreg_raster::{GBuffer, NO_FACE, Options, Renderer};
use texreg_surface::Mesh;

/// Points that two photos see.
#[derive(Clone, Debug)]
pub(crate) struct Overlap {
    /// The photos, by their index; the points are samples of the first.
    pub(crate) photos: [usize; 2],
    pub(crate) points: Vec<Point3<f64>>,
    /// What the pair counts for, against the metric of a photo.
    pub(crate) weight: f64,
}

/// Bins of each photo's values.
const BINS: usize = 20;

/// The most photos that one is compared with, and the least share of its surface that they must see.
const NEIGHBOURS: usize = 4;
const LEAST: f64 = 0.15;

/// About how many points make a pair, and how many say whether it is worth it. Which photos are asked so closely is said by fewer:
/// of a thousand photos, each asks few.
const POINTS: usize = 5_000;
const PROBES: usize = 200;
const CANDIDATES: usize = 16;
const FEW: usize = 10;

/// Samples summed by one task: fixed, so that sums do not depend on the number of threads.
const CHUNK: usize = 2048;

/// The mutual information of two photos over the views of all.
pub(crate) struct PairObjective<'a> {
    overlap: &'a Overlap,
    levels: [&'a Level; 2],
    seen: Option<Seen>,
}

/// What the points show from the views that were evaluated last.
struct Seen {
    views: [View; 2],
    slopes: [Vec<[f32; 2]>; 2],
    mutual: Mutual,
}

impl<'a> PairObjective<'a> {
    pub(crate) fn new(overlap: &'a Overlap, levels: [&'a Level; 2]) -> Self {
        Self { overlap, levels, seen: None }
    }

    /// The photos, by their index.
    pub(crate) fn photos(&self) -> [usize; 2] {
        self.overlap.photos
    }

    /// The weighted mutual information.
    pub(crate) fn value(&mut self, at: &[View]) -> f64 {
        let views = self.overlap.photos.map(|photo| at[photo]);
        let [(first, a), (second, b)] = [0, 1].map(|k| look(&self.overlap.points, self.levels[k], &views[k]));
        let mutual = PhotoPair { bins: BINS }.mutual_information(&first, &second);
        let value = mutual.value;
        self.seen = Some(Seen { views, slopes: [a, b], mutual });
        self.overlap.weight * value
    }

    /// The derivatives by the components of the first view, and then by those of the second.
    pub(crate) fn derivatives(&mut self, at: &[View], space: &ViewSpace) -> Dense {
        let views = self.overlap.photos.map(|photo| at[photo]);
        if self.seen.as_ref().is_none_or(|seen| seen.views != views) {
            self.value(at);
        }
        let seen = self.seen.as_ref().expect("the views were just evaluated");
        let cameras: [Camera; 2] = [0, 1].map(|k| self.levels[k].camera(&views[k].camera));
        let tangent = space.refine.dimension();
        let scores = [&seen.mutual.first, &seen.mutual.second];
        let half = |k: usize, i: usize| {
            let (slope, score) = (seen.slopes[k][i], f64::from(scores[k][i]));
            let gradient = score * Vector2::new(f64::from(slope[0]), f64::from(slope[1]));
            chain(&views[k], &cameras[k], space.refine, self.levels[k].scale, &self.overlap.points[i], &gradient)
        };
        let sums: Vec<Sums<{ 2 * MOST }>> = (0..self.overlap.points.len())
            .into_par_iter()
            .chunks(CHUNK)
            .map(|chunk| {
                let mut sums = Sums::default();
                for i in chunk {
                    if scores[0][i] != 0.0 || scores[1][i] != 0.0 {
                        let mut row = [0.0; 2 * MOST];
                        for k in 0..2 {
                            if let Some(half) = half(k, i) {
                                row[k * tangent..][..tangent].copy_from_slice(&half[..tangent]);
                            }
                        }
                        sums.add(&row[..2 * tangent]);
                    }
                }
                sums
            })
            .collect();
        let mut total = Sums::default();
        sums.iter().for_each(|part| total.merge(part));
        let scale = self.overlap.weight / self.overlap.points.len().max(1) as f64;
        let charts = views.map(|view| space.chain(&view, tangent));
        let (rows, columns) = charts[0].shape();
        let mut chain = DMatrix::zeros(2 * rows, 2 * columns);
        for (k, chart) in charts.iter().enumerate() {
            chain.view_mut((k * rows, k * columns), (rows, columns)).copy_from(chart);
        }
        total.derivatives(2 * tangent, scale).pulled_by(&chain)
    }
}

/// What one photo sees: its view, its samples, and how deep the surface lies in a small picture.
pub(crate) struct Sight<'a> {
    pub(crate) samples: &'a SurfaceSamples,
    pub(crate) depth: DepthMap,
}

/// How deep the visible surface lies.
pub(crate) struct DepthMap {
    view: View,
    picture: GBuffer,
}

impl DepthMap {
    /// Renders a mesh as a view sees it at a level's size.
    pub(crate) fn new(mesh: &Mesh, view: &View, level: &Level) -> Self {
        let view = View { camera: level.camera(&view.camera), pose: view.pose };
        let triangles = mesh.shape();
        let mut picture = GBuffer::default();
        Renderer::new().render(&triangles, &view.camera, &view.pose, &Options::default(), &mut picture);
        Self { view, picture }
    }

    /// Whether the view sees a point of the surface, and not at a grazing angle or beside an edge of depth: its depth must be
    /// among those of the four pixels around it, and these must differ little.
    fn shows(&self, point: &Point3<f64>) -> bool {
        let in_camera = self.view.pose.transform_point(point);
        let Some(pixel) = self.view.camera.project(&in_camera) else { return false };
        let (width, height) = (self.picture.width as usize, self.picture.height as usize);
        if !(pixel.x >= 0.0 && pixel.y >= 0.0) || pixel.x >= (width - 1) as f64 || pixel.y >= (height - 1) as f64 {
            return false;
        }
        let corner = pixel.y as usize * width + pixel.x as usize;
        let around = [corner, corner + 1, corner + width, corner + width + 1];
        if around.iter().any(|&i| self.picture.face[i] == NO_FACE) {
            return false;
        }
        let depths = around.map(|i| f64::from(self.picture.depth[i]));
        let (near, far) = depths.iter().fold((f64::MAX, 0.0f64), |(near, far), &z| (near.min(z), far.max(z)));
        let size_of_pixel = far / self.view.camera.intrinsics.fx;
        let margin = 0.5 * (far - near) + 0.1 * size_of_pixel;
        far - near < STEEP * size_of_pixel && in_camera.z > near - margin && in_camera.z < far + margin
    }
}

/// Surface whose depth grows by more than this many pixels from one pixel to the next is seen too much from the side.
const STEEP: f64 = 4.0;

/// The pairs of photos that see much of the same surface, both directions of each, weighted by the share of the first photo's
/// surface that the second sees, over the number of the first's neighbours.
pub(crate) fn overlaps(sights: &[Sight], background: u16) -> Vec<Overlap> {
    let surface = |sight: &Sight| sight.samples.bins.iter().filter(|&&bin| bin != background).count();
    let pairs = sights.par_iter().enumerate().map(|(p, sight)| {
        let points = &sight.samples.points[..surface(sight)];
        let seen = |other: &Sight, most: usize| -> (f64, Vec<Point3<f64>>) {
            let tested = points.iter().step_by(points.len() / most + 1);
            let count = tested.len().max(1) as f64;
            let seen: Vec<_> = tested.filter(|&point| other.depth.shows(point)).copied().collect();
            (seen.len() as f64 / count, seen)
        };
        let best = |among: &mut dyn Iterator<Item = usize>, probes: usize, most: usize| {
            let mut best: Vec<(f64, usize)> = among.map(|q| (seen(&sights[q], probes).0, q)).collect();
            best.sort_by(|a, b| b.0.total_cmp(&a.0));
            best.truncate(most);
            best
        };
        let candidates = best(&mut (0..sights.len()).filter(|&q| q != p), FEW, CANDIDATES);
        let mut neighbours = best(&mut candidates.into_iter().map(|(_, q)| q), PROBES, NEIGHBOURS);
        neighbours.retain(|&(share, _)| share > LEAST);
        let count = neighbours.len() as f64;
        let overlap = |(_, q): (f64, usize)| {
            let (share, points) = seen(&sights[q], POINTS);
            Overlap { photos: [p, q], points, weight: share / count }
        };
        neighbours.into_iter().map(overlap).collect::<Vec<_>>()
    });
    pairs.collect::<Vec<_>>().into_iter().flatten().collect()
}
