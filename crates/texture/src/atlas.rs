//! The atlas: where each triangle lies in the texture, and which triangle each texel shows.
//!
//! Texel coordinates are those of pixels: the centre of the top-left texel is (0, 0), v points down.

use crate::chart::{Chart, Faces};
use crate::pack::pack;
use nalgebra::{Point3, Vector2, Vector3};
use rayon::prelude::*;
use texreg_camera::{Camera, Intrinsics};
use texreg_lie::Pose;
use texreg_raster::{GBuffer, NO_FACE, Options, Triangles, render};
use texreg_surface::Mesh;

/// Texels around a chart that continue it, for bilinear sampling and the coarser levels of a viewer.
const GUTTER: u32 = 3;
/// Directions tried for the box of a chart.
const TURNS: usize = 16;
/// How far, in texels, a face must lie under another one of its chart to be cut off it.
const FOLD: f64 = 6.0;
/// How often folds are looked for.
const FOLD_ROUNDS: usize = 3;
/// How much of the density of the best-seen parts charts have at least.
const COARSEST: f64 = 0.25;
/// The share of texels that own texture coordinates may give to two triangles.
const OVERLAP: f64 = 0.02;

/// Every triangle's place in a texture.
#[derive(Clone, Debug)]
pub(crate) struct Atlas {
    /// In texels.
    pub(crate) width: u32,
    /// In texels.
    pub(crate) height: u32,
    /// The corners of each triangle in texel coordinates.
    pub(crate) corners: Vec<[[f32; 2]; 3]>,
    /// The triangle each texel shows, [`NO_FACE`] where the texture is empty; gutters show the triangle they continue.
    pub(crate) face: Vec<u32>,
    /// The number of charts; zero with the model's own texture coordinates.
    pub(crate) charts: usize,
}

/// A point of the surface, in the mesh frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfacePoint {
    pub(crate) point: Point3<f64>,
    /// Interpolated from the vertices, of unit length.
    pub(crate) normal: Vector3<f64>,
    /// Model units a texel is wide.
    pub(crate) size: f64,
}

impl Atlas {
    /// Cuts a surface into charts and packs them. `density` is the number of texels a model unit shall have on each face, 0
    /// where no photo sees it; `fixed` makes the texture so many texels wide and high, otherwise it is at most `limit`.
    pub(crate) fn cut(mesh: &Mesh, density: &[f32], fixed: Option<u32>, limit: u32) -> Self {
        let faces = Faces::new(mesh);
        let mut charts = faces.charts();
        let mut layout = Layout::new(mesh, &faces, &charts, density, fixed, limit);
        for _ in 0..FOLD_ROUNDS {
            let folded = layout.folded(mesh, &charts);
            if folded.is_empty() {
                break;
            }
            for chart in &mut charts {
                chart.faces.retain(|face| folded.binary_search(face).is_err());
            }
            charts.retain(|chart| !chart.faces.is_empty());
            charts.extend(faces.charts_of(&folded));
            layout = Layout::new(mesh, &faces, &charts, density, fixed, limit);
        }
        let Layout { width, height, corners } = layout;
        let mut face = rasterize(width, height, &corners, |_, _| 1.0).face;
        keep_tiny(&mut face, &charts, &corners, width);
        let face = continued(face, width as usize);
        Self { width, height, corners, face, charts: charts.len() }
    }

    /// The atlas of the model's own texture coordinates; `None` if it has none that give every triangle a place of its own.
    pub(crate) fn own(mesh: &Mesh, density: &[f32], fixed: Option<u32>, limit: u32) -> Option<Self> {
        let uvs = mesh.uvs.as_ref()?;
        if !uvs.as_flattened().as_flattened().iter().all(|x| (-1e-4..=1.0001).contains(x)) {
            return None;
        }
        let faces = Faces::new(mesh);
        let area = |[a, b, c]: &[[f32; 2]; 3]| 0.5 * det(&edges(a, b), &edges(a, c)).abs();
        let (mut texels, mut share) = (0.0, 0.0);
        for ((uv, &density), face) in uvs.iter().zip(density).zip(0..) {
            if density > 0.0 {
                texels += faces.area(face) * f64::from(density).powi(2);
                share += area(uv);
            }
        }
        let side = if share > 0.0 { (texels / share).sqrt().ceil() } else { 0.0 };
        let side = fixed.unwrap_or((side.min(f64::from(limit)) as u32).clamp(64, limit));
        let corner = |uv: [f32; 2]| uv.map(|x| (f64::from(x) * f64::from(side) - 0.5) as f32);
        let corners: Vec<[[f32; 2]; 3]> = uvs.iter().map(|t| t.map(corner)).collect();
        let face = rasterize(side, side, &corners, |_, _| 1.0).face;
        // Every texel once, against the area of all triangles.
        let seen = face.iter().filter(|&&f| f != NO_FACE).count() as f64;
        let all = uvs.iter().map(area).sum::<f64>() * f64::from(side).powi(2);
        if all > (1.0 + OVERLAP) * seen + 2.0 * f64::from(side) {
            return None;
        }
        Some(Self { width: side, height: side, corners, face: continued(face, side as usize), charts: 0 })
    }

    /// Texture coordinates: (0, 0) at the top left corner of the texture, (1, 1) at the bottom right one.
    pub(crate) fn uvs(&self) -> Vec<[[f32; 2]; 3]> {
        let uv = |[x, y]: [f32; 2]| [(x + 0.5) / self.width as f32, (y + 0.5) / self.height as f32];
        self.corners.par_iter().map(|t| t.map(uv)).collect()
    }

    /// The texels that show something, ascending.
    pub(crate) fn texels(&self) -> Vec<u32> {
        (0..self.face.len() as u32).into_par_iter().filter(|&i| self.face[i as usize] != NO_FACE).collect()
    }

    /// The weights of the corners of a face at a texel. Gutters extrapolate, if the face is not too thin for that.
    pub(crate) fn weights(&self, texel: u32) -> (u32, [f64; 3]) {
        let face = self.face[texel as usize];
        let at = [(texel % self.width) as f32, (texel / self.width) as f32];
        let [a, b, c] = &self.corners[face as usize];
        let (ab, ac, ap) = (edges(a, b), edges(a, c), edges(a, &at));
        let area = det(&ab, &ac);
        let longest = ab.norm().max(ac.norm()).max((ac - ab).norm());
        if area == 0.0 {
            return (face, [1.0 / 3.0; 3]);
        }
        let (v, w) = (det(&ap, &ac) / area, det(&ab, &ap) / area);
        let weights = [1.0 - v - w, v, w];
        if area.abs() < 0.25 * longest { (face, clamped(weights)) } else { (face, weights) }
    }

    /// The vertices' colours at a texel.
    pub(crate) fn interpolated(&self, mesh: &Mesh, texel: u32, colours: &[[f32; 3]]) -> [f32; 3] {
        let (face, weights) = self.weights(texel);
        let corners = mesh.triangles[face as usize].map(|v| colours[v as usize]);
        let weights = clamped(weights).map(|w| w as f32);
        std::array::from_fn(|c| (0..3).map(|k| weights[k] * corners[k][c]).sum())
    }

    /// The point of the surface that a texel shows.
    pub(crate) fn point(&self, mesh: &Mesh, texel: u32) -> (u32, SurfacePoint) {
        let (face, weights) = self.weights(texel);
        let [i, j, k] = mesh.triangles[face as usize].map(|i| i as usize);
        let mix = |values: &[[f32; 3]], [u, v, w]: [f64; 3]| {
            let at = |i: usize| Vector3::from(values[i].map(f64::from));
            at(i) * u + at(j) * v + at(k) * w
        };
        let normal = mix(&mesh.normals, clamped(weights));
        let [a, b, c] = &self.corners[face as usize];
        let texels = det(&edges(a, b), &edges(a, c)).abs();
        let [p, q, r] = [i, j, k].map(|i| Vector3::from(mesh.positions[i].map(f64::from)));
        let area = (q - p).cross(&(r - p)).norm();
        let size = if texels > 0.0 { (area / texels).sqrt() } else { 0.0 };
        let point = Point3::from(mix(&mesh.positions, weights));
        (face, SurfacePoint { point, normal: normal.try_normalize(0.0).unwrap_or_else(Vector3::z), size })
    }
}

/// Weights without negative ones.
pub(crate) fn clamped(weights: [f64; 3]) -> [f64; 3] {
    let weights = weights.map(|w| w.max(0.0));
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

fn edges(from: &[f32; 2], to: &[f32; 2]) -> Vector2<f64> {
    Vector2::from(to.map(f64::from)) - Vector2::from(from.map(f64::from))
}

fn det(a: &Vector2<f64>, b: &Vector2<f64>) -> f64 {
    a.x * b.y - a.y * b.x
}

/// Draws triangles of the texture's plane with the rasterizer: what lies at depth z is put at (x z, y z, z) before a camera
/// whose focal length is one texel. `z` is of a face and its corner.
fn rasterize(width: u32, height: u32, corners: &[[[f32; 2]; 3]], z: impl Fn(usize, usize) -> f32 + Sync) -> GBuffer {
    let lift = |face: usize, k: usize| {
        let ([x, y], z) = (corners[face][k], z(face, k));
        [x * z, y * z, z]
    };
    let positions: Vec<[f32; 3]> = (0..3 * corners.len()).into_par_iter().map(|i| lift(i / 3, i % 3)).collect();
    let indices: Vec<[u32; 3]> = (0..corners.len() as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
    let camera = Camera { intrinsics: Intrinsics::new(1.0, 0.0, 0.0), ..Camera::ideal(width, height, 1.0) };
    let mesh = Triangles::new(&positions, &indices);
    render(&mesh, &camera, &Pose::identity(), &Options::default())
}

/// Gives charts that are too small to cover the centre of any texel the texel nearest to them.
fn keep_tiny(face: &mut [u32], charts: &[Chart], corners: &[[[f32; 2]; 3]], width: u32) {
    let mut seen = vec![false; corners.len()];
    face.iter().filter(|&&f| f != NO_FACE).for_each(|&f| seen[f as usize] = true);
    for chart in charts.iter().filter(|chart| !chart.faces.iter().any(|&f| seen[f as usize])) {
        let [x, y] = corners[chart.faces[0] as usize][0].map(|x| x.round().max(0.0) as usize);
        if let Some(texel) = face.get_mut(y * width as usize + x) {
            *texel = chart.faces[0];
        }
    }
}

/// The map with its gutters.
fn continued(mut face: Vec<u32>, width: usize) -> Vec<u32> {
    for _ in 0..GUTTER {
        let grown = |i: usize| {
            if face[i] != NO_FACE {
                return face[i];
            }
            let x = i % width;
            let (left, right) =
                (if x > 0 { Some(i - 1) } else { None }, if x + 1 < width { Some(i + 1) } else { None });
            let around = [left, right, i.checked_sub(width), Some(i + width)];
            let near = around.into_iter().flatten().filter_map(|i| face.get(i).copied());
            near.into_iter().find(|&f| f != NO_FACE).unwrap_or(NO_FACE)
        };
        face = (0..face.len()).into_par_iter().with_min_len(1 << 14).map(grown).collect();
    }
    face
}

/// Charts laid flat and packed.
struct Layout {
    width: u32,
    height: u32,
    corners: Vec<[[f32; 2]; 3]>,
}

/// A chart laid flat: two axes of its plane, and its box along them in model units.
struct Flat {
    axes: [Vector3<f32>; 2],
    low: [f32; 2],
    size: [f32; 2],
    /// Texels a model unit.
    density: f64,
}

impl Layout {
    fn new(mesh: &Mesh, faces: &Faces, charts: &[Chart], density: &[f32], fixed: Option<u32>, limit: u32) -> Self {
        let best = best_density(faces, density);
        let flats: Vec<Flat> = charts.par_iter().map(|chart| Flat::new(mesh, faces, chart, density, best)).collect();
        let sizes = |scale: f64| -> Vec<[u32; 2]> {
            let texels =
                |extent: f32, density: f64| (f64::from(extent) * density * scale).ceil() as u32 + 1 + 2 * GUTTER;
            flats.iter().map(|flat| flat.size.map(|extent| texels(extent, flat.density))).collect()
        };
        // At `scale` the charts fit, at `over` they do not.
        let fits = |scale: f64, side: u32| {
            let sizes = sizes(scale);
            pack(&sizes, side).filter(|(_, height)| *height <= side)
        };
        let mut side = fixed.unwrap_or(limit);
        let mut scale = 1.0;
        if fixed.is_none() {
            let sizes = sizes(1.0);
            let area: f64 = sizes.iter().map(|[w, h]| f64::from(*w) * f64::from(*h)).sum();
            let widest = sizes.iter().map(|[w, h]| *w.max(h)).max().unwrap_or(1);
            side = ((1.04 * area.sqrt()).ceil().min(f64::from(limit)) as u32).max(widest.min(limit));
            while fits(1.0, side).is_none() && side < limit {
                side = (side + side / 24 + 1).min(limit);
            }
        }
        let mut packed = if fixed.is_none() { fits(1.0, side) } else { None };
        if packed.is_none() {
            let (mut low, mut high) = (0.0, 1.0);
            while fits(high, side).is_some() && high < 1e6 {
                (low, high) = (high, 2.0 * high);
            }
            for _ in 0..12 {
                let middle = 0.5 * (low + high);
                if fits(middle, side).is_some() { low = middle } else { high = middle }
            }
            scale = low;
            packed = fits(scale, side);
        }
        // Not even points fit: too many charts for so small a texture, which then grows.
        let (places, used) = packed.unwrap_or_else(|| {
            scale = 0.0;
            let sizes = sizes(0.0);
            while pack(&sizes, side).is_none_or(|(_, height)| height > side) {
                side *= 2;
            }
            pack(&sizes, side).unwrap_or_default()
        });
        let height = if fixed.is_some() { side } else { used.max(1) };
        let mut corners = vec![[[0.0; 2]; 3]; mesh.triangles.len()];
        for ((chart, flat), place) in charts.iter().zip(&flats).zip(&places) {
            let scale = flat.density * scale;
            for &face in &chart.faces {
                corners[face as usize] = mesh.triangles[face as usize].map(|i| {
                    let flattened = flat.project(&mesh.positions[i as usize]);
                    std::array::from_fn(|k| {
                        (f64::from(flattened[k] - flat.low[k]) * scale + f64::from(place[k] + GUTTER)) as f32
                    })
                });
            }
        }
        Self { width: side, height, corners }
    }

    /// The faces that lie under others of their chart, ascending.
    fn folded(&self, mesh: &Mesh, charts: &[Chart]) -> Vec<u32> {
        // By face, the chart's direction over its extent along it, and the least coordinate along it.
        let mut along = vec![(Vector3::zeros(), 0.0f32); mesh.triangles.len()];
        for chart in charts {
            let heights = chart
                .faces
                .iter()
                .flat_map(|&f| mesh.triangles[f as usize])
                .map(|i| chart.direction.dot(&Vector3::from(mesh.positions[i as usize])));
            let (low, high) = heights.fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
            let scale = 1.0 / (high - low).max(f32::MIN_POSITIVE);
            chart.faces.iter().for_each(|&f| along[f as usize] = (chart.direction * scale, low * scale));
        }
        let depth = |face: usize, k: usize| {
            let (direction, low) = &along[face];
            2.0 - (direction.dot(&Vector3::from(mesh.positions[mesh.triangles[face][k] as usize])) - low)
                .clamp(0.0, 1.0)
        };
        let picture = rasterize(self.width, self.height, &self.corners, depth);
        let is_under = |face: usize| {
            let corners = self.corners[face].map(|c| Vector2::from(c.map(f64::from)));
            let z: [f64; 3] = std::array::from_fn(|k| f64::from(depth(face, k)));
            let [a, b, c] =
                [0, 1, 2].map(|k| Vector3::from(mesh.positions[mesh.triangles[face][k] as usize].map(f64::from)));
            let texels = det(&(corners[1] - corners[0]), &(corners[2] - corners[0])).abs();
            let texel = (((b - a).cross(&(c - a))).norm() / texels.max(1e-12)).sqrt();
            let tolerance = FOLD * texel * along[face].0.cast::<f64>().norm();
            let probe = |weights: [f64; 3]| {
                let p = corners[0] * weights[0] + corners[1] * weights[1] + corners[2] * weights[2];
                let z = z[0] * weights[0] + z[1] * weights[1] + z[2] * weights[2];
                let texel = p.y.round() as usize * self.width as usize + p.x.round() as usize;
                picture.depth.get(texel).is_some_and(|&nearest| z - f64::from(nearest) > tolerance)
            };
            [[0.34, 0.33, 0.33], [0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]].into_iter().any(probe)
        };
        (0..mesh.triangles.len()).into_par_iter().filter(|&f| is_under(f)).map(|f| f as u32).collect()
    }
}

/// The density nine tenths of the seen surface do not exceed; 1 over the model where nothing is seen.
fn best_density(faces: &Faces, density: &[f32]) -> f64 {
    let mut seen: Vec<(f32, f64)> =
        density.iter().zip(0..).filter(|(d, _)| **d > 0.0).map(|(&d, face)| (d, faces.area(face))).collect();
    seen.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = seen.iter().map(|s| s.1).sum();
    let mut sum = 0.0;
    let found = seen.iter().find(|(_, area)| {
        sum += area;
        sum >= 0.9 * total
    });
    found.map_or(1.0, |&(d, _)| f64::from(d))
}

impl Flat {
    fn new(mesh: &Mesh, faces: &Faces, chart: &Chart, density: &[f32], best: f64) -> Self {
        let direction = chart.direction;
        let helper = if direction.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let right = direction.cross(&helper).normalize();
        let down = right.cross(&direction);
        let plane: Vec<Vector2<f32>> = chart
            .faces
            .iter()
            .flat_map(|&f| mesh.triangles[f as usize])
            .map(|i| Vector3::from(mesh.positions[i as usize]))
            .map(|p| Vector2::new(right.dot(&p), down.dot(&p)))
            .collect();
        let extent = |axis: &Vector2<f32>| {
            let values = plane.iter().map(|p| axis.dot(p));
            values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
        };
        let turned = (0..TURNS).map(|k| {
            let (s, c) = (std::f32::consts::FRAC_PI_2 * k as f32 / TURNS as f32).sin_cos();
            let (x, y) = (Vector2::new(c, s), Vector2::new(-s, c));
            let (ex, ey) = (extent(&x), extent(&y));
            (x, y, ex, ey, (ex.1 - ex.0) * (ey.1 - ey.0))
        });
        let (mut x, mut y, mut ex, mut ey, _) = turned.min_by(|a, b| a.4.total_cmp(&b.4)).unwrap_or_default();
        // Boxes lie on their longer side; the turn keeps the handedness.
        if ey.1 - ey.0 > ex.1 - ex.0 {
            (x, y, ex, ey) = (y, -x, ey, (-ex.1, -ex.0));
        }
        let axis = |a: Vector2<f32>| right * a.x + down * a.y;
        let (mut sum, mut area) = (0.0, 0.0);
        for &face in chart.faces.iter().filter(|&&f| density[f as usize] > 0.0) {
            sum += faces.area(face) * f64::from(density[face as usize]);
            area += faces.area(face);
        }
        let wanted = if area > 0.0 { sum / area } else { 0.0 };
        Self {
            axes: [axis(x), axis(y)],
            low: [ex.0, ey.0],
            size: [ex.1 - ex.0, ey.1 - ey.0],
            density: wanted.max(COARSEST * best),
        }
    }

    fn project(&self, p: &[f32; 3]) -> [f32; 2] {
        self.axes.map(|axis| axis.dot(&Vector3::from(*p)))
    }
}
