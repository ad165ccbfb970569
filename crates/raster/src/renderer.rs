//! The pipeline: find the meshlets that may be seen, then draw the picture band by band.

use crate::band::{Band, COLUMNS, TILE, unlock};
use crate::meshlets::Meshlets;
use crate::projector::{Lens, Projector};
use crate::sight::{Seen, Sight};
use crate::{GBuffer, NO_FACE, Options, Raycaster, Triangles};
use fearless_simd::{Level, dispatch};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};
use texreg_camera::Camera;
use texreg_lie::Pose;

/// Renderings with fewer triangles and pixels than this together stay on the calling thread.
const WORTH_SPREADING: usize = 100_000;

/// The least near plane whose 1/z is well within f32.
const NEAREST: f64 = 1e-30;

/// Renders the visible surface of a mesh: allocates, see [`Renderer`] for many renderings.
pub fn render(mesh: &Triangles, camera: &Camera, camera_from_mesh: &Pose, options: &Options) -> GBuffer {
    let mut gbuffer = GBuffer::default();
    Renderer::new().render(mesh, camera, camera_from_mesh, options, &mut gbuffer);
    gbuffer
}

/// A rasterizer that keeps its working memory from one rendering to the next.
///
/// The picture depends on mesh, camera, pose and options alone: not on threads, nor on what was rendered before. Where two
/// surfaces have the same depth at a pixel, the lower face index is seen.
#[derive(Debug)]
pub struct Renderer {
    level: Level,
    lens: Option<Lens>,
    /// For tasks of consecutive meshlets.
    seen: Vec<Vec<Seen>>,
    /// For bands.
    shown: Vec<Vec<Seen>>,
    spare: Mutex<Vec<Workspace>>,
}

/// Working memory of a thread that draws bands.
#[derive(Debug, Default)]
struct Workspace {
    keys: Vec<i64>,
    /// A depth for each tile of the band.
    tiles: Vec<f32>,
    spans: Vec<Range<usize>>,
}

impl Default for Renderer {
    fn default() -> Self {
        Self { level: Level::new(), lens: None, seen: Vec::new(), shown: Vec::new(), spare: Mutex::default() }
    }
}

impl Renderer {
    /// A renderer without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Renders into `gbuffer`, whose size and previous contents do not matter. Pictures may have up to 131,072 pixels a side.
    ///
    /// To render a region of the image, take the camera with the region's size and with cx, cy less its first pixel.
    pub fn render(
        &mut self,
        mesh: &Triangles,
        camera: &Camera,
        camera_from_mesh: &Pose,
        options: &Options,
        gbuffer: &mut GBuffer,
    ) {
        gbuffer.resize(camera.width, camera.height, options.barycentric);
        if gbuffer.depth.is_empty() {
            return;
        }
        let work = mesh.positions.len() + mesh.indices.len() + gbuffer.depth.len();
        let threads = rayon::current_num_threads();
        if options.parallel && threads > 1 && work >= WORTH_SPREADING {
            // The pool is entered once, not for every step.
            rayon::scope(|_| self.render_on(threads, mesh, camera, camera_from_mesh, options, gbuffer));
        } else {
            self.render_on(1, mesh, camera, camera_from_mesh, options, gbuffer);
        }
    }

    /// Renders on one thread, the calling one, or on several.
    fn render_on(
        &mut self,
        threads: usize,
        mesh: &Triangles,
        camera: &Camera,
        camera_from_mesh: &Pose,
        options: &Options,
        gbuffer: &mut GBuffer,
    ) {
        if !self.lens.as_ref().is_some_and(|lens| lens.is_for(camera)) {
            self.lens = None;
        }
        let lens = self.lens.get_or_insert_with(|| Lens::new(camera));
        let near = if options.near > 0.0 { options.near.max(NEAREST) } else { Options::NEAR };
        let projector = Projector::new(lens, camera_from_mesh, near);
        let made;
        let meshlets = match mesh.meshlets {
            Some(meshlets) => meshlets,
            None => {
                made = Meshlets::new(mesh);
                &made
            }
        };
        let level = self.level;
        let sight = Sight { level, projector: &projector, meshlets, width: camera.width, height: camera.height };
        sight.find(&mut self.seen, threads > 1);

        let (width, height) = (camera.width as usize, camera.height as usize);
        let rows = band_rows(width, height, threads);
        share_out(&self.seen, rows, height, &mut self.shown);

        let finisher = Finisher { level, mesh, raycaster: Raycaster::new(camera, camera_from_mesh), width };
        let draw = |(k, (strip, shown)): (usize, (Strip, &Vec<Seen>))| {
            let mut workspace = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
            let Workspace { keys, tiles, spans } = &mut workspace;
            let stride = (width + COLUMNS - 1).next_multiple_of(COLUMNS);
            keys.resize(stride * (strip.depth.len() / width + 1), 0);
            let (top, height) = ((k * rows) as i32, (strip.depth.len() / width) as i32);
            let mut band = Band { top, width: width as i32, height, stride: stride as i32, keys, spans };
            sight.draw(shown, options.cull_back_faces, &mut band, tiles);
            finisher.finish(k * rows * width, &band, strip);
            self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
        };
        let strips: Vec<_> = strips(gbuffer, rows * width).zip(&self.shown).enumerate().collect();
        if threads > 1 {
            strips.into_par_iter().with_max_len(1).for_each(draw);
        } else {
            strips.into_iter().for_each(draw);
        }
    }
}

/// Rows of a band: so many that its keys stay in a cache and that all threads have some to draw.
fn band_rows(width: usize, height: usize, threads: usize) -> usize {
    let most = (131_072 / width).max(TILE);
    let rows = if threads > 1 { most.min(height / (6 * threads)) } else { most.min(height) };
    rows.div_ceil(TILE).max(1) * TILE
}

/// Gives each band the meshlets that reach into it.
fn share_out(seen: &[Vec<Seen>], rows: usize, height: usize, shown: &mut Vec<Vec<Seen>>) {
    shown.iter_mut().for_each(Vec::clear);
    shown.resize_with(height.div_ceil(rows), Vec::new);
    for seen in seen.iter().flatten() {
        let [first, last] = seen.y.map(|tile| usize::from(tile) * TILE / rows);
        shown[first..=last].iter_mut().for_each(|shown| shown.push(*seen));
    }
}

/// Some rows of a [`GBuffer`].
struct Strip<'a> {
    depth: &'a mut [f32],
    face: &'a mut [u32],
    barycentric: &'a mut [[f32; 2]],
}

/// A picture cut into strips of so many pixels.
fn strips(gbuffer: &mut GBuffer, size: usize) -> impl Iterator<Item = Strip<'_>> {
    let GBuffer { depth, face, barycentric, .. } = gbuffer;
    let mut barycentric = barycentric.chunks_mut(size);
    let strips = depth.chunks_mut(size).zip(face.chunks_mut(size));
    strips.map(move |(depth, face)| Strip { depth, face, barycentric: barycentric.next().unwrap_or_default() })
}

/// Turns keys into depth and face, and fills in the barycentrics asked for.
struct Finisher<'a> {
    level: Level,
    mesh: &'a Triangles<'a>,
    raycaster: Raycaster,
    width: usize,
}

impl Finisher<'_> {
    /// `first` is the index of the first pixel in the picture.
    fn finish(&self, first: usize, band: &Band, strip: Strip) {
        let Strip { depth, face, barycentric } = strip;
        let rows = depth.chunks_exact_mut(self.width).zip(face.chunks_exact_mut(self.width));
        dispatch!(self.level, _simd => {
            for (((depth, face), keys), y) in rows.zip(band.keys.chunks_exact(band.stride as usize)).zip(0..) {
                let span = &band.spans[y / TILE];
                for beside in [0..span.start, span.end..self.width] {
                    depth[beside.clone()].fill(f32::INFINITY);
                    face[beside].fill(NO_FACE);
                }
                let there = depth[span.clone()].iter_mut().zip(&mut face[span.clone()]);
                for ((depth, face), &key) in there.zip(&keys[span.clone()]) {
                    let (w, id) = unlock(key);
                    (*depth, *face) = (1.0 / w, id);
                }
            }
        });
        let mut raycaster = self.raycaster.clone();
        let rows = barycentric.chunks_exact_mut(self.width).zip(face.chunks_exact(self.width));
        for ((weights, faces), y) in rows.zip(first / self.width..) {
            dispatch!(self.level, _simd => raycaster.row(self.mesh, y as f64, faces, weights));
        }
    }
}
