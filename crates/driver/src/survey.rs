//! Looking for a view with nothing to start from: the model from all sides, at every roll, size and place in the photo.
//!
//! Orientations are spread evenly over all rotations: M. Alexa, *Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)*,
//! CVPR 2022. The model is rendered once for each orientation and size, in the middle of a tiny picture; to turn the camera about
//! its own centre then shifts what is seen, so that the places need no renderings. Views are compared by the mutual information
//! over the whole picture, and by how well the outline lies on edges.

use crate::counts::Counts;
use crate::model::viewpoint;
use crate::outlines::Outline;
use crate::overview::Overview;
use nalgebra::{Point2, Quaternion, Rotation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use texreg_camera::{Camera, Intrinsics, View};
use texreg_lie::Pose;
use texreg_raster::{GBuffer, NO_FACE, Options, Renderer};
use texreg_surface::{Mesh, Signal, Surfel};

/// Orientations: about 14° apart.
const ORIENTATIONS: usize = 5_000;

/// The size of the model's picture: the diagonal of its bounding box over the shorter side of the photo.
const SIZES: [f64; 8] = [1.9, 1.36, 0.97, 0.69, 0.49, 0.35, 0.25, 0.18];

/// The distance between places, over the diagonal of the model's picture.
const STEP: f64 = 0.12;

/// The least distance between places, in pixels.
const CLOSEST: f64 = 3.0;

/// The share of the model from which a view that cuts it off is not looked at.
const MOST_CUT: f64 = 0.25;

/// The views of a camera that explain a small picture best, at most one for each orientation and size, the best first; that an
/// outline as long as the picture's border lies on edges counts as much as `edges` nats. The mesh is a coarse one; views are of its
/// frame.
pub(crate) fn survey(
    mesh: &Mesh,
    signal: &dyn Signal,
    overview: &Overview,
    edges: f64,
    camera: &Camera,
) -> Vec<(f64, View)> {
    let middle = mesh.centre() - mesh.origin;
    let shorter = overview.width.min(overview.height) as f64;
    let scale = 1.0 / overview.factor as f64;
    let focal = 0.5 * scale * (camera.intrinsics.fx + camera.intrinsics.fy);
    let ground = Ground::new(overview, (SIZES[0] * shorter).ceil() as usize);
    let mut views: Vec<(f64, View)> = (0..ORIENTATIONS * SIZES.len())
        .into_par_iter()
        .map_init(Stamp::default, |stamp, i| {
            let rotation = orientation(i / SIZES.len(), ORIENTATIONS);
            let size = SIZES[i % SIZES.len()] * shorter;
            let distance = focal * mesh.diagonal() / size;
            let pose = Pose::new(rotation, Vector3::z() * distance - rotation * middle.coords);
            stamp.render(mesh, signal, focal, &pose, size.ceil() as u32, &ground);
            let weight = edges * overview.weight(&stamp.outline);
            let (score, place) = stamp.best_place(&ground, weight, (STEP * size).max(CLOSEST))?;
            // The camera turns until its ray through the place passes through the middle of the model.
            let pixel = Point2::from((place.coords.add_scalar(0.5)) / scale).coords.add_scalar(-0.5);
            let ray = camera.unproject(&pixel.into())?;
            let rotation = Rotation3::rotation_between(&Vector3::z(), &ray)? * rotation;
            let translation = ray.normalize() * distance - rotation * middle.coords;
            Some((score, View { camera: *camera, pose: Pose::new(rotation, translation) }))
        })
        .flatten()
        .collect();
    views.sort_by(|a, b| b.0.total_cmp(&a.0));
    views
}

/// The i-th of n rotations on a super-Fibonacci spiral.
fn orientation(i: usize, n: usize) -> Rotation3<f64> {
    // φ is the square root of two, ψ the positive root of ψ⁴ = ψ + 4.
    const PSI: f64 = 1.533_751_168_755_204_3;
    let s = i as f64 + 0.5;
    let (t, d) = (s / n as f64, std::f64::consts::TAU * s);
    let (r, big_r) = (t.sqrt(), (1.0 - t).sqrt());
    let (alpha, beta) = (d / std::f64::consts::SQRT_2, d / PSI);
    let q = Quaternion::new(big_r * beta.cos(), r * alpha.sin(), r * alpha.cos(), big_r * beta.sin());
    UnitQuaternion::from_quaternion(q).to_rotation_matrix()
}

/// The tiny picture of the photo with a wide margin of no colour.
struct Ground {
    width: usize,
    height: usize,
    /// Pixels a row, with the margin on both sides.
    stride: usize,
    margin: usize,
    /// The colour of each pixel; one more for the margin.
    colours: Vec<u16>,
    /// How many pixels have each colour.
    palette: Vec<u32>,
    /// The edges at each pixel, none in the margin.
    edges: Vec<[f32; 3]>,
    entropies: Counts,
}

impl Ground {
    fn new(overview: &Overview, margin: usize) -> Self {
        let (width, height) = (overview.width, overview.height);
        let stride = width + 2 * margin;
        let colours = framed(&overview.colours, width, margin, overview.palette.len() as u16);
        let edges = framed(overview.edges(), width, margin, [0.0; 3]);
        let entropies = Counts::up_to(width * height);
        Self { width, height, stride, margin, colours, palette: overview.palette.clone(), edges, entropies }
    }

    /// The mutual information of counts, in rows of colours and of what lies in the margin, whose last row becomes what is left
    /// of the picture; less what chance alone would show.
    fn information(&self, counts: &mut [u32]) -> Option<f64> {
        let colours = self.palette.len();
        let (model, background) = counts.split_at_mut(counts.len() - colours - 1);
        background[..colours].copy_from_slice(&self.palette);
        for row in model.chunks_exact(colours + 1) {
            background.iter_mut().zip(&row[..colours]).for_each(|(left, &n)| *left -= n);
        }
        self.entropies.information(counts.chunks_exact(colours + 1).map(|row| &row[..colours]), &self.palette)
    }
}

/// Rows of a picture with a margin of the same on all sides.
fn framed<T: Copy>(pixels: &[T], width: usize, margin: usize, around: T) -> Vec<T> {
    let stride = width + 2 * margin;
    let mut framed = vec![around; stride * (pixels.len() / width + 2 * margin)];
    for (row, line) in pixels.chunks_exact(width).zip(framed.chunks_exact_mut(stride).skip(margin)) {
        line[margin..margin + width].copy_from_slice(row);
    }
    framed
}

/// A small picture of the model in the middle of nothing.
#[derive(Default)]
struct Stamp {
    renderer: Renderer,
    picture: GBuffer,
    /// The pixels that show the model: their offsets in the ground from its middle, and where their rows of counts begin.
    pixels: Vec<(isize, u32)>,
    /// Bins that have pixels.
    rows: usize,
    counts: Vec<u32>,
    outline: Outline,
}

impl Stamp {
    /// Renders within `half` pixels around the middle.
    fn render(&mut self, mesh: &Mesh, signal: &dyn Signal, focal: f64, pose: &Pose, half: u32, ground: &Ground) {
        let centre = f64::from(half);
        let camera = Camera {
            width: 2 * half + 1,
            height: 2 * half + 1,
            intrinsics: Intrinsics { fx: focal, fy: focal, cx: centre, cy: centre, skew: 0.0 },
            distortion: Default::default(),
        };
        let triangles = mesh.shape();
        let options = Options { parallel: false, ..Options::default() };
        self.renderer.render(&triangles, &camera, pose, &options, &mut self.picture);
        let viewpoint = viewpoint(&View { camera, pose: *pose });
        let width = camera.width as usize;
        self.outline = Outline::of(&self.picture);
        let mut row_of: Vec<Option<u32>> = vec![None; signal.bins()];
        self.rows = 0;
        self.pixels.clear();
        for (i, &face) in self.picture.face.iter().enumerate() {
            if face != NO_FACE {
                let corners = mesh.triangles[face as usize];
                let surfel = Surfel { mesh, corners, weights: [1.0 / 3.0; 3], viewpoint: &viewpoint };
                let row = *row_of[signal.bin(&surfel)].get_or_insert_with(|| {
                    self.rows += 1;
                    ((self.rows - 1) * (ground.palette.len() + 1)) as u32
                });
                let (x, y) = ((i % width) as isize - half as isize, (i / width) as isize - half as isize);
                self.pixels.push((y * ground.stride as isize + x, row));
            }
        }
    }

    /// The place of the model's middle that explains the picture best, and how much better than places do in the mean: what
    /// smooth surfaces explain of smooth backgrounds by chance, they explain anywhere. `None` if no place shows most of the
    /// model.
    fn best_place(&mut self, ground: &Ground, edges: f64, step: f64) -> Option<(f64, Point2<f64>)> {
        let places = |length: usize| {
            let count = (length as f64 / step).round().max(1.0);
            (0..count as usize).map(move |k| ((k as f64 + 0.5) * length as f64 / count) as usize)
        };
        let outside = ground.palette.len();
        let half = (self.picture.width / 2) as isize;
        let mut best: Option<(f64, Point2<f64>)> = None;
        let (mut sum, mut count) = (0.0, 0.0);
        for v in places(ground.height) {
            for u in places(ground.width) {
                self.counts.clear();
                self.counts.resize((self.rows + 1) * (outside + 1), 0);
                let middle = ((v + ground.margin) * ground.stride + u + ground.margin) as isize;
                for &(offset, row) in &self.pixels {
                    let colour = ground.colours[(middle + offset) as usize];
                    self.counts[row as usize + usize::from(colour)] += 1;
                }
                let cut: u32 = self.counts.chunks_exact(outside + 1).map(|row| row[outside]).sum();
                if f64::from(cut) >= MOST_CUT * self.pixels.len() as f64 {
                    continue;
                }
                let on = self.outline.on(|x, y| {
                    let offset = (y - half) * ground.stride as isize + x - half;
                    ground.edges.get((middle + offset) as usize)
                });
                let score = ground.information(&mut self.counts)? + edges * on;
                sum += score;
                count += 1.0;
                if best.is_none_or(|(value, _)| score > value) {
                    best = Some((score, Point2::new(u as f64, v as f64)));
                }
            }
        }
        best.map(|(score, place)| (score - sum / count, place))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orientations_are_spread_over_all_rotations() {
        let all: Vec<_> = (0..ORIENTATIONS).map(|i| orientation(i, ORIENTATIONS)).collect();
        let nearest = |r: &Rotation3<f64>, but: usize| {
            let others = all.iter().enumerate().filter(|(i, _)| *i != but);
            others.map(|(_, other)| r.angle_to(other)).fold(f64::INFINITY, f64::min).to_degrees()
        };
        for i in (0..ORIENTATIONS).step_by(301) {
            assert!(nearest(&all[i], i) > 6.0, "{i}");
            let between = Rotation3::from_scaled_axis(Vector3::new(0.7, 0.1 * i as f64, -0.4)) * all[i];
            assert!(nearest(&between, usize::MAX) < 20.0, "{i}");
        }
    }

    #[test]
    fn what_the_model_leaves_of_the_picture_is_background() {
        let colours = [vec![0; 16], vec![1; 9], vec![2; 15]].concat();
        let overview = Overview::of(1, 8, 5, colours, vec![[0.0; 3]; 40]);
        // The fourth column lies in the margin.
        let mut counts = [5, 0, 2, 9, 1, 7, 3, 1, 0, 0, 0, 0];
        let value = Ground::new(&overview, 4).information(&mut counts);
        assert_eq!(counts[8..11], [10, 2, 10]);
        let table = [5, 0, 2, 1, 7, 3, 10, 2, 10];
        assert_eq!(value, Counts::up_to(40).information(table.chunks_exact(3), &[16, 9, 15]));
    }
}
