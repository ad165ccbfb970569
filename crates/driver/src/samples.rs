//! Samples on the surface: what a view sees of the model, and the background around it.

use crate::MetricName;
use crate::contour::Contour;
use crate::model::{surrounds, viewpoint};
use crate::needles::Needles;
use crate::pyramid::Level;
use nalgebra::{Point2, Point3, Vector3};
use rayon::prelude::*;
use texreg_camera::{Camera, View};
use texreg_raster::{GBuffer, NO_FACE, Options, Raycaster, Renderer, outline};
use texreg_surface::{Headlight, Mesh, Signal, Surfel};

/// Surface points with fixed bins, and what else metrics look at.
#[derive(Clone, Debug, Default)]
pub(crate) struct SurfaceSamples {
    /// The points in the model's frame, relative to its origin.
    pub(crate) points: Vec<Point3<f64>>,
    /// The bin of each: the signal's, or one more for the background.
    pub(crate) bins: Vec<u16>,
    /// Pixels of the level that show the model.
    pub(crate) covered: usize,
    /// The metric that they were taken for.
    pub(crate) metric: MetricName,
    /// The shading of each surface point by a light at the camera, if the metric looks at it.
    pub(crate) shading: Vec<f32>,
    /// The model's edges, likewise.
    pub(crate) needles: Option<Needles>,
    /// The model's outline, likewise.
    pub(crate) contour: Option<Contour>,
}

impl SurfaceSamples {
    /// The mean shading of each of so many bins; NaN for one without a surface point.
    pub(crate) fn shading_by_bin(&self, bins: usize) -> Vec<f64> {
        let mut sums = vec![[0.0; 2]; bins];
        for (&bin, &shading) in self.bins.iter().zip(&self.shading) {
            let sum = &mut sums[usize::from(bin)];
            sum[0] += f64::from(shading);
            sum[1] += 1.0;
        }
        sums.into_iter().map(|[sum, count]| sum / count).collect()
    }
}

/// How a view is sampled.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sampling {
    /// About how many points of the surface.
    pub(crate) surface: usize,
    /// At most about how many of the background.
    pub(crate) halo: usize,
    /// How far around the silhouette the background is sampled, in pixels of the level.
    pub(crate) band: f32,
    /// The metric that will look at the samples.
    pub(crate) metric: MetricName,
}

/// Background samples taken by one task: fixed, as each ray is found from the one before.
const CHUNK: usize = 2048;

/// Background samples reach this many pixels of a level beyond the silhouette.
const BAND: f32 = 12.0;

impl Sampling {
    /// So many points of the surface alone.
    pub(crate) fn surface(surface: usize) -> Self {
        Self { surface, halo: 0, band: 0.0, metric: MetricName::default() }
    }

    /// So many points of the surface, and half as many around it, for a metric.
    pub(crate) fn with_halo(surface: usize, metric: MetricName) -> Self {
        Self { surface, halo: surface / 2, band: BAND, metric }
    }
}

/// Renders a model and picks samples from the pictures.
pub(crate) struct Sampler<'a> {
    mesh: &'a Mesh,
    signal: &'a dyn Signal,
    renderer: Renderer,
    picture: GBuffer,
}

impl<'a> Sampler<'a> {
    pub(crate) fn new(mesh: &'a Mesh, signal: &'a dyn Signal) -> Self {
        Self { mesh, signal, renderer: Renderer::new(), picture: GBuffer::default() }
    }

    /// Samples what a view, whose pose is relative to the model's origin, sees at a level's resolution. `None` where it
    /// sees nothing of the model.
    ///
    /// Halo samples are points of the background beside the silhouette, put at the depth of the nearest outline point: they
    /// move rigidly with the object and share one bin, so that they hold its occluding contour.
    pub(crate) fn sample(&mut self, view: &View, level: &Level, sampling: &Sampling) -> Option<SurfaceSamples> {
        let camera = level.camera(&view.camera);
        let mesh = self.mesh.shape();
        self.renderer.render(&mesh, &camera, &view.pose, &Options::default(), &mut self.picture);
        let picture = &self.picture;
        let covered = picture.covered();
        if covered == 0 {
            return None;
        }
        let width = picture.width as usize;
        let has_shading = sampling.metric.has_shading();
        let share = sampling.surface as f32 / covered as f32;
        let viewpoint = viewpoint(view);
        let raycaster = Raycaster::new(&camera, &view.pose);
        let rows: Vec<Vec<(Point3<f64>, u16, f32)>> = picture
            .face
            .par_chunks(width)
            .enumerate()
            .with_min_len(16)
            .map(|(y, faces)| {
                let kept = |&(x, &face): &(usize, &u32)| face != NO_FACE && dither(x, y) < share;
                let seen = faces.iter().enumerate().filter(kept);
                let seen: Vec<_> = seen.map(|(x, &face)| (face, Point2::new(x as f64, y as f64))).collect();
                let found = raycaster.clone().barycentrics(&mesh, &seen);
                let samples =
                    seen.into_iter().zip(found).filter(|(_, [v, _])| !v.is_nan()).map(|((face, _), [v, w])| {
                        let corners = self.mesh.triangles[face as usize];
                        let weights = [1.0 - v - w, v, w];
                        let point = surface_point(self.mesh, corners, weights);
                        let surfel = Surfel { mesh: self.mesh, corners, weights, viewpoint: &viewpoint };
                        let shading = if has_shading { Headlight { steps: 1 }.colour(&surfel)[0] } else { 0.0 };
                        (point, self.signal.bin(&surfel) as u16, shading)
                    });
                samples.collect()
            })
            .collect();
        let samples = rows.into_iter().flatten().map(|(point, bin, shading)| (point, (bin, shading)));
        let (mut points, (mut bins, mut shading)): (Vec<_>, (Vec<_>, Vec<_>)) = samples.unzip();
        if !has_shading {
            shading.clear();
        }
        let halo = self.halo(view, &camera, sampling);
        bins.resize(bins.len() + halo.len(), self.signal.bins() as u16);
        points.extend(halo);
        let metric = sampling.metric;
        let needles = || Needles::of(self.mesh, &self.picture, level, view, sampling.surface);
        Some(SurfaceSamples {
            points,
            bins,
            covered,
            metric,
            shading,
            needles: metric.has_edges().then(needles),
            contour: metric.has_silhouettes().then(|| Contour::of(&self.picture, &camera, view)),
        })
    }

    fn halo(&self, view: &View, camera: &Camera, sampling: &Sampling) -> Vec<Point3<f64>> {
        // A scan from inside ends where the scanner saw no farther: what is beside it is no background.
        if sampling.halo == 0 || sampling.band < 1.0 || surrounds(self.mesh, view) {
            return Vec::new();
        }
        let width = self.picture.width as usize;
        let pixels = outline(&self.picture, sampling.band);
        let share = sampling.halo as f32 / pixels.len() as f32;
        let kept = pixels.into_iter().filter_map(|halo| {
            let (x, y) = (halo.pixel as usize % width, halo.pixel as usize / width);
            (dither(x, y) < share).then_some((Point2::new(x as f64, y as f64), halo.nearest as usize))
        });
        let (pixels, nearest): (Vec<_>, Vec<usize>) = kept.unzip();
        let (raycaster, centre) = (Raycaster::new(camera, &view.pose), view.pose.inverse().translation);
        let parts = pixels.par_chunks(CHUNK).zip(nearest.par_chunks(CHUNK)).flat_map_iter(|(pixels, nearest)| {
            let rays = raycaster.clone().rays(pixels);
            let points = rays.into_iter().zip(nearest).filter(|(ray, _)| !ray.x.is_nan());
            points.map(|(ray, &nearest)| Point3::from(centre + ray * f64::from(self.picture.depth[nearest])))
        });
        parts.collect()
    }
}

/// The point of a triangle, in the model's frame, with such barycentric weights.
pub(crate) fn surface_point(mesh: &Mesh, corners: [u32; 3], weights: [f32; 3]) -> Point3<f64> {
    let parts = corners.into_iter().zip(weights).map(|(corner, weight)| {
        let position = mesh.positions[corner as usize].map(f64::from);
        f64::from(weight) * Point3::from(position).coords
    });
    parts.sum::<Vector3<f64>>().into()
}

/// A threshold in `0..1` for each pixel, spread evenly over any neighbourhood: J. Jimenez, *Next generation post processing
/// in Call of Duty: Advanced Warfare*, SIGGRAPH 2014 (interleaved gradient noise).
#[inline]
pub(crate) fn dither(x: usize, y: usize) -> f32 {
    // `f32::fract` calls a library.
    let fraction = |x: f32| x - x as i32 as f32;
    fraction(52.982_918 * fraction(0.067_110_56 * x as f32 + 0.005_837_15 * y as f32))
}
