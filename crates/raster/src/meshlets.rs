//! A mesh cut into meshlets: runs of neighbouring triangles with a box around them and vertices of their own.
//!
//! A meshlet that the picture does not show is left out whole, and one that it shows is read from memory front to back. The
//! idea is that of mesh shaders (C. Kubisch, *Introduction to Turing mesh shaders*, NVIDIA 2018).

use crate::Triangles;
use crate::batch::LANES;
use fearless_simd::{i32x16, prelude::*, u32x16};
use rayon::prelude::*;

/// Triangles in a meshlet: the most whose corners a byte tells apart, in whole batches of the sieve.
pub(crate) const TRIANGLES: usize = 80;

/// Vertices kept and projected together.
pub(crate) const GROUP: usize = 8;

/// Vertices a meshlet may have.
pub(crate) const VERTICES: usize = 256;

/// Triangles follow one another well if meshlets have at most so many vertices a triangle: pieces of surface have 0.7.
const COHERENT: f64 = 0.9;

/// Meshlets whose vertices a task gathers.
const TASK: usize = 64;

/// What a [`Renderer`](crate::Renderer) reads of a mesh.
///
/// Making it costs as much as some renderings, up to three dozen; kept with [`Triangles::meshlets`], it serves all others of the same mesh.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Meshlets {
    boxes: Vec<Aabb>,
    /// Where the vertices of each meshlet begin, and where those of the last end, in whole groups.
    starts: Vec<u32>,
    positions: Vec<[[f32; GROUP]; 3]>,
    /// The corners of all triangles, counted within their meshlets. The last batch is filled up with triangles of one point.
    corners: Vec<[u8; 3]>,
    /// The faces in the order of the meshlets, unless that is the mesh's own.
    faces: Option<Vec<u32>>,
}

/// An axis-aligned box: centre and half its sides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Aabb {
    pub(crate) centre: [f32; 3],
    pub(crate) half: [f32; 3],
}

/// One of them.
#[derive(Clone, Copy)]
pub(crate) struct Meshlet<'a> {
    /// All x, y and z of some vertices at a time; the last of them may be none.
    pub(crate) positions: &'a [[[f32; GROUP]; 3]],
    pub(crate) corners: &'a [[[u8; 3]; LANES]],
    faces: Option<&'a [[u32; LANES]]>,
    first: u32,
}

impl Meshlet<'_> {
    /// The position of a vertex.
    pub(crate) fn position(&self, vertex: u8) -> [f32; 3] {
        let (group, lane) = (usize::from(vertex) / GROUP, usize::from(vertex) % GROUP);
        std::array::from_fn(|axis| self.positions[group][axis][lane])
    }

    /// The face that a triangle of a batch is in the mesh.
    pub(crate) fn face(&self, batch: usize, lane: usize) -> u32 {
        self.faces.map_or(self.first + (batch * LANES + lane) as u32, |faces| faces[batch][lane])
    }

    /// The bits of all faces of a batch.
    #[inline(always)]
    pub(crate) fn faces<S: Simd>(&self, simd: S, batch: usize) -> i32x16<S> {
        match self.faces {
            Some(faces) => u32x16::load_array(simd, faces[batch]).bitcast(),
            None => {
                let first = self.first as i32 + (batch * LANES) as i32;
                i32x16::load_array(simd, std::array::from_fn(|lane| lane as i32)) + first
            }
        }
    }
}

impl Meshlets {
    /// Cuts a mesh. Triangles follow one another as they do in the mesh, or along a space-filling curve if their neighbours
    /// there are far away.
    pub fn new(mesh: &Triangles) -> Self {
        let order = (!is_coherent(mesh)).then(|| along_a_curve(mesh));
        let mut corners = vec![[0; 3]; mesh.indices.len().next_multiple_of(LANES)];
        let meshlets = corners.par_chunks_mut(TRIANGLES).enumerate().with_min_len(TASK);
        let counts: Vec<u32> = meshlets.map(|(k, corners)| number(mesh, order.as_deref(), k, corners)).collect();
        let faces = order.as_deref();
        let mut starts = Vec::with_capacity(counts.len() + 1);
        let mut start = 0;
        for count in &counts {
            starts.push(start);
            start += count.div_ceil(GROUP as u32).max(1);
        }
        starts.push(start);
        let mut positions = vec![[[0.0; GROUP]; 3]; start as usize];
        let mut boxes = vec![Aabb::around(&[]); counts.len()];
        let mut tasks = Vec::new();
        let mut rest = positions.as_mut_slice();
        for (k, boxes) in boxes.chunks_mut(TASK).enumerate() {
            let end = (k * TASK + boxes.len()).min(counts.len());
            let (mine, others) = rest.split_at_mut((starts[end] - starts[k * TASK]) as usize);
            tasks.push((k * TASK, boxes, mine));
            rest = others;
        }
        tasks.into_par_iter().for_each(|(first, boxes, mut positions)| {
            for (k, aabb) in (first..).zip(boxes) {
                let (own, others) = positions.split_at_mut((starts[k + 1] - starts[k]) as usize);
                positions = others;
                let mut points = [[0.0; 3]; VERTICES];
                let count = gather(mesh, faces, k, &corners, &mut points);
                *aabb = Aabb::around(&points[..count]);
                for (group, points) in own.iter_mut().zip(points.chunks(GROUP)) {
                    *group = std::array::from_fn(|axis| std::array::from_fn(|k| points[k][axis]));
                }
            }
        });
        let filled_up = |mut faces: Vec<u32>| {
            faces.resize(corners.len(), 0);
            faces
        };
        Self { boxes, starts, positions, faces: order.map(filled_up), corners }
    }

    pub(crate) fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    #[inline(always)]
    pub(crate) fn meshlet(&self, k: usize) -> Meshlet<'_> {
        let first = k * TRIANGLES;
        let end = (first + TRIANGLES).min(self.corners.len());
        Meshlet {
            positions: &self.positions[self.starts[k] as usize..self.starts[k + 1] as usize],
            corners: self.corners[first..end].as_chunks().0,
            faces: self.faces.as_ref().map(|faces| faces[first..end].as_chunks().0),
            first: first as u32,
        }
    }
}

impl Aabb {
    /// The box around those points that are finite; none is smaller than nothing.
    fn around(points: &[[f32; 3]]) -> Self {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for point in points.iter().filter(|point| point.iter().all(|x| x.is_finite())) {
            for k in 0..3 {
                low[k] = low[k].min(point[k]);
                high[k] = high[k].max(point[k]);
            }
        }
        if low[0] > high[0] {
            return Self { centre: [0.0; 3], half: [0.0; 3] };
        }
        let centre: [f32; 3] = std::array::from_fn(|k| 0.5 * low[k] + 0.5 * high[k]);
        // Rounded up, so that the box holds all points.
        let half = |k: usize| 0.5 * high[k] - 0.5 * low[k] + f32::EPSILON * (low[k].abs() + high[k].abs());
        Self { centre, half: std::array::from_fn(half) }
    }

    fn ends(&self) -> [[f32; 3]; 2] {
        [std::array::from_fn(|k| self.centre[k] - self.half[k]), std::array::from_fn(|k| self.centre[k] + self.half[k])]
    }
}

/// Whether triangles that follow one another are neighbours, by the meshlets in a sample.
fn is_coherent(mesh: &Triangles) -> bool {
    let whole = mesh.indices.len() / TRIANGLES;
    let sample = (0..whole).step_by(whole / 500 + 1);
    let vertices = sample.clone().map(|k| number(mesh, None, k, &mut [[0; 3]; TRIANGLES])).sum::<u32>();
    f64::from(vertices) <= COHERENT * (sample.len() * TRIANGLES) as f64
}

/// The triangle at a place of an order, if it has vertices.
#[inline(always)]
fn triangle(mesh: &Triangles, faces: Option<&[u32]>, place: usize) -> Option<[u32; 3]> {
    let face = faces.map_or(Some(place), |faces| faces.get(place).map(|&face| face as usize))?;
    let triangle = *mesh.indices.get(face)?;
    triangle.iter().all(|&i| (i as usize) < mesh.positions.len()).then_some(triangle)
}

/// Numbers the vertices of a meshlet in the order of their first use, and counts them. Triangles without vertices keep
/// their corners.
fn number(mesh: &Triangles, faces: Option<&[u32]>, k: usize, corners: &mut [[u8; 3]]) -> u32 {
    // A hash table with linear probing: which vertex is where, by its number and one.
    const SLOTS: usize = 512;
    let (mut slots, mut vertices) = ([0_u16; SLOTS], [0_u32; VERTICES]);
    let mut count = 0;
    for (place, corners) in (k * TRIANGLES..).zip(corners) {
        let Some(triangle) = triangle(mesh, faces, place) else { continue };
        *corners = triangle.map(|vertex| {
            let mut slot = (vertex.wrapping_mul(0x9E37_79B1) >> 23) as usize;
            loop {
                match slots[slot] {
                    0 => {
                        vertices[count] = vertex;
                        count += 1;
                        slots[slot] = count as u16;
                        break (count - 1) as u8;
                    }
                    known if vertices[usize::from(known) - 1] == vertex => break (known - 1) as u8,
                    _ => slot = (slot + 1) % SLOTS,
                }
            }
        });
    }
    count as u32
}

/// Writes the positions of a meshlet's vertices, and counts them.
fn gather(mesh: &Triangles, faces: Option<&[u32]>, k: usize, corners: &[[u8; 3]], points: &mut [[f32; 3]]) -> usize {
    let first = k * TRIANGLES;
    let mut known = 0;
    for (place, corners) in (first..).zip(corners[first..].iter().take(TRIANGLES)) {
        let Some(triangle) = triangle(mesh, faces, place) else { continue };
        for (&corner, vertex) in corners.iter().zip(triangle) {
            if usize::from(corner) == known {
                points[known] = mesh.positions[vertex as usize];
                known += 1;
            }
        }
    }
    known
}

/// The faces in the order in which a space-filling curve visits their first corners.
fn along_a_curve(mesh: &Triangles) -> Vec<u32> {
    let parts: Vec<Aabb> = mesh.positions.par_chunks(1 << 16).map(Aabb::around).collect();
    let ends: Vec<[f32; 3]> = parts.iter().flat_map(Aabb::ends).collect();
    let whole = Aabb::around(&ends);
    let [low, _] = whole.ends();
    let scale = whole.half.map(|half| ((1 << (BITS - 1)) as f32 / half).min(f32::MAX));
    let visit = |p: &[f32; 3]| {
        // The cast saturates.
        hilbert(std::array::from_fn(|k| (((p[k] - low[k]) * scale[k]) as u32).min((1 << BITS) - 1)))
    };
    let visits: Vec<u32> = mesh.positions.par_iter().with_min_len(1 << 12).map(visit).collect();
    let key = |(face, triangle): (usize, &[u32; 3])| {
        let visit = visits.get(triangle[0] as usize).copied().unwrap_or(0);
        u64::from(visit) << 32 | face as u64
    };
    let mut keys: Vec<u64> = mesh.indices.par_iter().enumerate().map(key).collect();
    keys.par_sort_unstable();
    keys.into_par_iter().map(|key| key as u32).collect()
}

/// Bits of a cell's coordinates.
const BITS: u32 = 10;

/// Where Hilbert's curve visits a cell (J. Skilling, *Programming the Hilbert curve*, AIP Conference Proceedings 2004).
fn hilbert(cell: [u32; 3]) -> u32 {
    let mut x = cell;
    for q in (1..BITS).rev().map(|bit| 1 << bit) {
        for i in 0..3 {
            if x[i] & q != 0 {
                x[0] ^= q - 1;
            } else {
                let t = (x[0] ^ x[i]) & (q - 1);
                x[0] ^= t;
                x[i] ^= t;
            }
        }
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    let mut t = 0;
    for q in (1..BITS).rev().map(|bit| 1 << bit) {
        if x[2] & q != 0 {
            t ^= q - 1;
        }
    }
    let x = x.map(|x| x ^ t);
    (0..BITS).rev().fold(0, |key, bit| x.iter().fold(key, |key, x| key << 1 | (x >> bit & 1)))
}
