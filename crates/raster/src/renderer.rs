//! The pipeline: project all vertices once, sift the triangles, draw the rest band by band.

use crate::band::{Band, unlock};
use crate::corner::{Corner, Projected, SUBPIXEL_BITS, first_pixel};
use crate::projector::{Lens, Projector};
use crate::sieve::{Fragment, Sieve, Sink};
use crate::{GBuffer, Options, Raycaster, Triangles};
use fearless_simd::{Level, dispatch, prelude::*};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};
use texreg_camera::Camera;
use texreg_lie::Pose;

/// Renderings with fewer triangles and pixels than this together stay on the calling thread.
const WORTH_SPREADING: usize = 100_000;

/// The least near plane whose 1/z is well within f32.
const NEAREST: f64 = 1e-30;

/// Vertices a task projects.
const VERTICES: usize = 8192;

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
    projected: Projected,
    chunks: Vec<Chunk>,
    /// Keys of a whole picture, or of a band for each thread that draws one.
    keys: Mutex<Vec<Vec<u64>>>,
}

impl Default for Renderer {
    fn default() -> Self {
        Self {
            level: Level::new(),
            lens: None,
            projected: Projected::default(),
            chunks: Vec::new(),
            keys: Mutex::default(),
        }
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
        let spread = threads > 1;
        project(&mut self.projected, self.level, mesh, &projector, spread);
        let sieve = Sieve {
            mesh,
            projector: &projector,
            projected: &self.projected,
            cull: options.cull_back_faces,
            bounds: [camera.width as i32, camera.height as i32],
        };
        let finisher = Finisher {
            level: self.level,
            mesh,
            raycaster: Raycaster::new(camera, camera_from_mesh),
            width: camera.width as usize,
        };
        if spread {
            let bands = Bands::new(gbuffer, threads);
            bands.sift(self.level, &sieve, &mut self.chunks, threads);
            bands.draw(self.level, &sieve, &self.chunks, &self.keys, gbuffer, &finisher);
        } else {
            let mut keys = take(&self.keys, gbuffer.depth.len());
            let [width, height] = sieve.bounds;
            let mut band = Band { top: 0, width, height, keys: &mut keys };
            sieve.sift(self.level, 0..mesh.indices.len(), &mut band);
            let GBuffer { depth, face, barycentric, .. } = gbuffer;
            finisher.finish(0, &keys, Strip { depth, face, barycentric });
            give_back(&self.keys, keys);
        }
    }
}

/// Projects all vertices.
fn project(projected: &mut Projected, level: Level, mesh: &Triangles, projector: &Projector, spread: bool) {
    projected.resize(mesh.positions.len());
    let Projected { xy, w } = projected;
    if spread {
        let parts = xy.par_chunks_mut(VERTICES).zip(w.par_chunks_mut(VERTICES));
        let all = mesh.positions.par_chunks(VERTICES).zip(parts);
        all.for_each(|(positions, (xy, w))| projector.project(level, positions, xy, w));
    } else {
        projector.project(level, mesh.positions, xy, w);
    }
}

/// What is left of a run of consecutive triangles, by bands.
#[derive(Debug, Default)]
struct Chunk {
    bands: Vec<Bin>,
    /// log2 of the rows in a band.
    shift: u32,
}

/// What is left of them in one band.
#[derive(Debug, Default)]
struct Bin {
    fragments: Vec<Fragment>,
    faces: Vec<u32>,
    pieces: Vec<(u32, [Corner; 3])>,
}

impl Chunk {
    fn reset(&mut self, bands: &Bands) {
        self.shift = bands.shift;
        self.bands.resize_with(bands.count, Bin::default);
        for bin in &mut self.bands {
            bin.fragments.clear();
            bin.faces.clear();
            bin.pieces.clear();
        }
    }

    /// The bins of the bands a triangle's rows fall into; it is known to reach the picture.
    fn touched(&mut self, [a, b, c]: &[Corner; 3]) -> &mut [Bin] {
        let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        let end = self.bands.len() - 1;
        let band = |row: i32| ((row.max(0) >> self.shift) as usize).min(end);
        let touched = band(first_pixel(top))..=band(bottom >> SUBPIXEL_BITS);
        &mut self.bands[touched]
    }
}

impl Sink for Chunk {
    #[inline(always)]
    fn fragment(&mut self, fragment: Fragment, y: u32) {
        self.bands[(y >> self.shift) as usize].fragments.push(fragment);
    }

    fn triangle<S: Simd>(&mut self, _simd: S, face: u32, corners: [Corner; 3]) {
        self.touched(&corners).iter_mut().for_each(|bin| bin.faces.push(face));
    }

    fn piece<S: Simd>(&mut self, _simd: S, face: u32, corners: [Corner; 3]) {
        self.touched(&corners).iter_mut().for_each(|bin| bin.pieces.push((face, corners)));
    }
}

/// How the picture is cut into strips of rows, each drawn by one thread.
struct Bands {
    /// log2 of the rows in a band.
    shift: u32,
    count: usize,
    width: usize,
}

impl Bands {
    fn new(gbuffer: &GBuffer, threads: usize) -> Self {
        let height = gbuffer.height as usize;
        let shift = (height / (8 * threads)).clamp(8, 64).ilog2();
        Self { shift, count: height.div_ceil(1 << shift), width: gbuffer.width as usize }
    }

    /// Sifts all triangles into bins, in chunks of consecutive faces.
    fn sift(&self, level: Level, sieve: &Sieve, chunks: &mut Vec<Chunk>, threads: usize) {
        let faces = sieve.mesh.indices.len();
        let size = faces.div_ceil(8 * threads).max(2048);
        chunks.resize_with(faces.div_ceil(size), Chunk::default);
        chunks.par_iter_mut().enumerate().with_max_len(1).for_each(|(index, chunk)| {
            chunk.reset(self);
            sieve.sift(level, index * size..((index + 1) * size).min(faces), chunk);
        });
    }

    fn draw(
        &self,
        level: Level,
        sieve: &Sieve,
        chunks: &[Chunk],
        spare: &Mutex<Vec<Vec<u64>>>,
        gbuffer: &mut GBuffer,
        finisher: &Finisher,
    ) {
        let size = self.width << self.shift;
        let mut barycentric: Vec<&mut [[f32; 2]]> = gbuffer.barycentric.chunks_mut(size).collect();
        barycentric.resize_with(self.count, Default::default);
        let GBuffer { depth, face, .. } = gbuffer;
        let strips = depth.par_chunks_mut(size).zip(face.par_chunks_mut(size)).zip(barycentric);
        strips.enumerate().with_max_len(1).for_each(|(index, ((depth, face), barycentric))| {
            let top = (index << self.shift) as i32;
            let height = (depth.len() / self.width) as i32;
            let mut keys = take(spare, depth.len());
            let mut band = Band { top, width: self.width as i32, height, keys: &mut keys };
            let bins = chunks.iter().map(|chunk| &chunk.bands[index]);
            dispatch!(level, simd => draw_all(simd, &mut band, bins, sieve));
            finisher.finish(top as usize * self.width, &keys, Strip { depth, face, barycentric });
            give_back(spare, keys);
        });
    }
}

/// So many keys of background, in memory that is warm if there is any.
fn take(spare: &Mutex<Vec<Vec<u64>>>, size: usize) -> Vec<u64> {
    let mut keys = spare.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
    keys.clear();
    keys.resize(size, 0);
    keys
}

fn give_back(spare: &Mutex<Vec<Vec<u64>>>, keys: Vec<u64>) {
    spare.lock().unwrap_or_else(PoisonError::into_inner).push(keys);
}

/// Draws what the chunks have left in one band.
#[inline(always)]
fn draw_all<'a, S: Simd>(simd: S, band: &mut Band, bins: impl Iterator<Item = &'a Bin>, sieve: &Sieve) {
    for bin in bins {
        for &fragment in &bin.fragments {
            band.put(fragment);
        }
        for &face in &bin.faces {
            let triangle = sieve.mesh.indices[face as usize];
            band.triangle(simd, face, triangle.map(|i| sieve.projected.corner(i)));
        }
        for &(face, corners) in &bin.pieces {
            band.triangle(simd, face, corners);
        }
    }
}

/// Some rows of a [`GBuffer`].
struct Strip<'a> {
    depth: &'a mut [f32],
    face: &'a mut [u32],
    barycentric: &'a mut [[f32; 2]],
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
    fn finish(&self, first: usize, keys: &[u64], strip: Strip) {
        let Strip { depth, face, barycentric } = strip;
        dispatch!(self.level, _simd => {
            for ((&key, depth), face) in keys.iter().zip(depth.iter_mut()).zip(face.iter_mut()) {
                let (w, id) = unlock(key);
                (*depth, *face) = (1.0 / w, id);
            }
        });
        let mut raycaster = self.raycaster.clone();
        let rows = barycentric.chunks_exact_mut(self.width).zip(face.chunks_exact(self.width));
        for ((weights, faces), y) in rows.zip(first / self.width..) {
            dispatch!(self.level, _simd => raycaster.row(self.mesh, y as f64, faces, weights));
        }
    }
}
