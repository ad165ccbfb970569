//! The pipeline: project all vertices once, sift the triangles, draw the rest band by band.

use crate::band::{Band, first_pixel, twice_area};
use crate::clip::{Vertex, clip};
use crate::corner::{CLIP, Corner, SUBPIXEL_BITS};
use crate::projector::{Lens, Projector};
use crate::{GBuffer, NO_FACE, Options, Raycaster, Triangles};
use nalgebra::Point2;
use rayon::prelude::*;
use texreg_camera::Camera;
use texreg_lie::Pose;

/// Renderings with fewer triangles and pixels than this together stay on the calling thread.
const WORTH_SPREADING: usize = 100_000;

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
#[derive(Debug, Default)]
pub struct Renderer {
    lens: Option<Lens>,
    projected: Projected,
    chunks: Vec<Chunk>,
}

/// All vertices on the image plane.
#[derive(Debug, Default)]
struct Projected {
    xy: Vec<[i32; 2]>,
    w: Vec<f32>,
}

/// What is left of a run of consecutive triangles, by bands.
#[derive(Debug, Default)]
struct Chunk {
    /// Faces that touch each band.
    faces: Vec<Vec<u32>>,
    /// Pieces from the clipper.
    pieces: Vec<(u32, [Corner; 3])>,
    /// Pieces that touch each band.
    piece_indices: Vec<Vec<u32>>,
}

impl Renderer {
    /// A renderer without working memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Renders into `gbuffer`, whose size and previous contents do not matter.
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
        if !self.lens.as_ref().is_some_and(|lens| lens.is_for(camera)) {
            self.lens = None;
        }
        let lens = self.lens.get_or_insert_with(|| Lens::new(camera));
        let near = if options.near > 0.0 { options.near } else { Options::NEAR };
        let projector = Projector::new(lens, camera_from_mesh, near);
        let sieve = Sieve {
            mesh,
            projector: &projector,
            cull: options.cull_back_faces,
            bounds: [camera.width as i32, camera.height as i32],
        };
        let finish = |band: &mut Band, barycentric: &mut [[f32; 2]]| {
            finish(band, barycentric, mesh, camera, camera_from_mesh);
        };
        let work = mesh.indices.len() + gbuffer.depth.len();
        let threads = rayon::current_num_threads();
        if options.parallel && threads > 1 && work >= WORTH_SPREADING {
            self.projected.spread(mesh, &projector);
            let bands = Bands::new(gbuffer, threads);
            sift_all(&mut self.chunks, &sieve, &self.projected, &bands, threads);
            bands.draw(gbuffer, &self.chunks, mesh, &self.projected, finish);
        } else {
            self.projected.fill(mesh, &projector);
            let mut band = Band {
                top: 0,
                width: camera.width as i32,
                height: camera.height as i32,
                w: &mut gbuffer.depth,
                face: &mut gbuffer.face,
            };
            band.clear();
            sieve.sift(0..mesh.indices.len(), &self.projected, &mut |face, corners, _| {
                band.draw(face, corners);
            });
            finish(&mut band, &mut gbuffer.barycentric);
        }
    }
}

impl Projected {
    fn resize(&mut self, vertices: usize) {
        self.xy.resize(vertices, [0; 2]);
        self.w.resize(vertices, 0.0);
    }

    fn fill(&mut self, mesh: &Triangles, projector: &Projector) {
        self.resize(mesh.positions.len());
        projector.project(mesh.positions, &mut self.xy, &mut self.w);
    }

    fn spread(&mut self, mesh: &Triangles, projector: &Projector) {
        self.resize(mesh.positions.len());
        let parts = self.xy.par_chunks_mut(VERTICES).zip(self.w.par_chunks_mut(VERTICES));
        mesh.positions
            .par_chunks(VERTICES)
            .zip(parts)
            .for_each(|(positions, (xy, w))| projector.project(positions, xy, w));
    }

    /// The projected corners of a triangle whose indices are known to be good.
    fn corners(&self, triangle: [u32; 3]) -> [Corner; 3] {
        triangle.map(|i| {
            let [x, y] = self.xy[i as usize];
            Corner { x, y, w: self.w[i as usize] }
        })
    }
}

/// Decides which triangles are worth drawing.
struct Sieve<'a> {
    mesh: &'a Triangles<'a>,
    projector: &'a Projector<'a>,
    cull: bool,
    bounds: [i32; 2],
}

impl Sieve<'_> {
    /// Calls `keep(face, corners, is_whole)` for each triangle of a range that may cover a pixel centre, and for each
    /// visible piece of those that must be clipped or split.
    fn sift(
        &self,
        range: std::ops::Range<usize>,
        projected: &Projected,
        keep: &mut impl FnMut(u32, [Corner; 3], bool),
    ) {
        let [width, height] = self.bounds;
        let longest = self.projector.lens.longest_edge;
        for (&triangle, face) in self.mesh.indices[range.clone()].iter().zip(range.start as u32..) {
            let [Some(&a), Some(&b), Some(&c)] = triangle.map(|i| projected.xy.get(i as usize)) else {
                continue;
            };
            if a[0] == CLIP || b[0] == CLIP || c[0] == CLIP {
                self.cut(face, triangle, projected, keep);
                continue;
            }
            let (left, right) = (a[0].min(b[0]).min(c[0]), a[0].max(b[0]).max(c[0]));
            let (top, bottom) = (a[1].min(b[1]).min(c[1]), a[1].max(b[1]).max(c[1]));
            let (x0, x1) = (first_pixel(left).max(0), (right >> SUBPIXEL_BITS).min(width - 1));
            let (y0, y1) = (first_pixel(top).max(0), (bottom >> SUBPIXEL_BITS).min(height - 1));
            if x0 > x1 || y0 > y1 {
                continue;
            }
            if (right - left).max(bottom - top) > longest {
                self.cut(face, triangle, projected, keep);
                continue;
            }
            let corners = projected.corners(triangle);
            let [a, b, c] = corners;
            let area = twice_area(a, b, c);
            if area < 0 || (area > 0 && !self.cull) {
                keep(face, corners, true);
            }
        }
    }

    /// Sends a triangle through the clipper.
    fn cut(&self, face: u32, triangle: [u32; 3], projected: &Projected, keep: &mut impl FnMut(u32, [Corner; 3], bool)) {
        let Some(positions) = self.mesh.corners(face) else {
            return;
        };
        let corners = projected.corners(triangle);
        let vertices = std::array::from_fn(|k| Vertex {
            point: self.projector.in_camera(positions[k]),
            corner: Some(corners[k]).filter(|corner| corner.x != CLIP),
        });
        clip(self.projector, vertices, &mut |[a, b, c]| {
            let area = twice_area(a, b, c);
            if area < 0 || (area > 0 && !self.cull) {
                keep(face, [a, b, c], false);
            }
        });
    }
}

/// How the picture is cut into strips of rows.
struct Bands {
    rows: usize,
    count: usize,
    width: usize,
}

impl Bands {
    fn new(gbuffer: &GBuffer, threads: usize) -> Self {
        let height = gbuffer.height as usize;
        let rows = height.div_ceil(8 * threads).max(8);
        Self { rows, count: height.div_ceil(rows), width: gbuffer.width as usize }
    }

    /// The bands a triangle's rows fall into; it is known to reach the picture.
    fn touched(&self, [a, b, c]: &[Corner; 3]) -> std::ops::RangeInclusive<usize> {
        let row = |y: i32| (y.max(0) as usize / self.rows).min(self.count - 1);
        let (top, bottom) = (a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y));
        row(first_pixel(top))..=row(bottom >> SUBPIXEL_BITS)
    }

    fn draw(
        &self,
        gbuffer: &mut GBuffer,
        chunks: &[Chunk],
        mesh: &Triangles,
        projected: &Projected,
        finish: impl Fn(&mut Band, &mut [[f32; 2]]) + Sync,
    ) {
        let size = self.rows * self.width;
        let mut barycentric: Vec<&mut [[f32; 2]]> = gbuffer.barycentric.chunks_mut(size).collect();
        barycentric.resize_with(self.count, Default::default);
        gbuffer
            .depth
            .par_chunks_mut(size)
            .zip(gbuffer.face.par_chunks_mut(size))
            .zip(barycentric)
            .enumerate()
            .with_max_len(1)
            .for_each(|(index, ((w, face), barycentric))| {
                let mut band = Band {
                    top: (index * self.rows) as i32,
                    width: self.width as i32,
                    height: (w.len() / self.width) as i32,
                    w,
                    face,
                };
                band.clear();
                for chunk in chunks {
                    for &face in &chunk.faces[index] {
                        band.draw(face, projected.corners(mesh.indices[face as usize]));
                    }
                    for &piece in &chunk.piece_indices[index] {
                        let (face, corners) = chunk.pieces[piece as usize];
                        band.draw(face, corners);
                    }
                }
                finish(&mut band, barycentric);
            });
    }
}

/// Sifts all triangles into the bands, in chunks of consecutive faces.
fn sift_all(chunks: &mut Vec<Chunk>, sieve: &Sieve, projected: &Projected, bands: &Bands, threads: usize) {
    let faces = sieve.mesh.indices.len();
    let size = faces.div_ceil(8 * threads).max(1024);
    chunks.resize_with(faces.div_ceil(size), Chunk::default);
    chunks.par_iter_mut().enumerate().with_max_len(1).for_each(|(index, chunk)| {
        chunk.clear(bands.count);
        let range = index * size..((index + 1) * size).min(faces);
        sieve.sift(range, projected, &mut |face, corners, is_whole| {
            let touched = bands.touched(&corners);
            if is_whole {
                touched.for_each(|band| chunk.faces[band].push(face));
            } else {
                touched.for_each(|band| chunk.piece_indices[band].push(chunk.pieces.len() as u32));
                chunk.pieces.push((face, corners));
            }
        });
    });
}

impl Chunk {
    fn clear(&mut self, bands: usize) {
        for lists in [&mut self.faces, &mut self.piece_indices] {
            lists.resize_with(bands, Vec::new);
            lists.iter_mut().for_each(Vec::clear);
        }
        self.pieces.clear();
    }
}

/// Turns the 1/z of a drawn band into z and fills in the barycentrics asked for.
fn finish(band: &mut Band, barycentric: &mut [[f32; 2]], mesh: &Triangles, camera: &Camera, camera_from_mesh: &Pose) {
    for w in band.w.iter_mut() {
        *w = 1.0 / *w;
    }
    if barycentric.is_empty() {
        return;
    }
    let mut raycaster = Raycaster::new(camera, camera_from_mesh);
    let rows = barycentric.chunks_exact_mut(band.width as usize).zip(band.face.chunks_exact(band.width as usize));
    for ((barycentric, faces), y) in rows.zip(band.top..) {
        for ((weights, &face), x) in barycentric.iter_mut().zip(faces).zip(0..) {
            let pixel = Point2::new(f64::from(x), f64::from(y));
            *weights = match face {
                NO_FACE => [0.0; 2],
                face => raycaster.barycentric(mesh, face, pixel).unwrap_or_default(),
            };
        }
    }
}
