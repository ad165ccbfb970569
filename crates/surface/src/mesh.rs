//! The model: triangles over vertices with normals and what the scanner measured there.
use std::sync::OnceLock;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use texreg_raster::{Meshlets, Triangles};

use crate::error::Defect;
use crate::normals::complete_normals;

/// A triangle mesh with per-vertex attributes, in model units.
///
/// Positions are single precision relative to [`origin`](Self::origin), a round point near the middle of the bounding
/// box: `world = origin + position`. So survey coordinates around 10⁶ keep their millimetres, and a renderer works with
/// `camera_from_mesh`, the pose with rotation `R` and translation `R·origin + T`, on the positions as they are.
///
/// Made by [`load`](crate::load) or [`Mesh::new`], a mesh has at least one triangle, finite coordinates, indices in
/// range, and attributes with one value a vertex. Degenerate triangles, duplicate vertices and vertices without a
/// triangle are allowed.
#[derive(Debug, Clone, PartialEq)]
pub struct Mesh {
    /// The point of the world that is the zero of `positions`.
    pub origin: Vector3<f64>,
    /// The vertices, relative to `origin`.
    pub positions: Vec<[f32; 3]>,
    /// Three vertices a triangle, counter-clockwise seen from outside where the model is consistent.
    pub triangles: Vec<[u32; 3]>,
    /// Unit normals, one a vertex.
    pub normals: Vec<[f32; 3]>,
    /// The scanner's reflectance (intensity), one finite value a vertex, on the scanner's own scale.
    pub reflectance: Option<Vec<f32>>,
    /// Red, green and blue, one triple a vertex.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Finite texture coordinates (u, v) of the three corners of each triangle: (0, 0) is the texture's top left corner,
    /// (1, 1) its bottom right one.
    pub uvs: Option<Vec<[[f32; 2]; 3]>>,
    /// See [`ambient_occlusion`](Self::ambient_occlusion), once that was asked for or a file brought it.
    pub(crate) ambient_occlusion: OnceLock<Vec<f32>>,
    /// See [`mean_curvature`](Self::mean_curvature), likewise.
    pub(crate) mean_curvature: OnceLock<Vec<f32>>,
    /// Whether the model is a point cloud: triangles 2i and 2i + 1 over the vertices 4i to 4i + 3 are a square around
    /// point i (see [`Mesh::from_points`]).
    pub is_cloud: bool,
    /// The points of a cloud, relative to `origin`; empty for other models.
    pub(crate) points: Vec<[f32; 3]>,
    /// See [`shape`](Self::shape).
    pub(crate) prepared: Prepared,
}

/// What a mesh makes of itself to be rendered. It tells nothing that the mesh does not, and a copy makes its own.
#[derive(Debug, Default)]
pub(crate) struct Prepared(OnceLock<Meshlets>);

impl Clone for Prepared {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl PartialEq for Prepared {
    fn eq(&self, _other: &Self) -> bool {
        true
    }
}

/// What a vertex may carry besides its position; see the fields of [`Mesh`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Attributes {
    /// Normals of any length; those that are not finite or of no length are computed from the triangles.
    pub normals: Option<Vec<[f32; 3]>>,
    /// Reflectance; values that are not finite are replaced by the mean of the others.
    pub reflectance: Option<Vec<f32>>,
    /// Colours.
    pub colours: Option<Vec<[u8; 3]>>,
    /// Texture coordinates, three pairs a triangle; all are dropped if one is not finite.
    pub uvs: Option<Vec<[[f32; 2]; 3]>>,
    /// [`Mesh::ambient_occlusion`], if it is known already; values that are not finite are replaced by the mean of the others.
    pub ambient_occlusion: Option<Vec<f32>>,
    /// [`Mesh::mean_curvature`], likewise.
    pub mean_curvature: Option<Vec<f32>>,
}

impl Attributes {
    /// Makes sure that there is one value of each attribute a vertex.
    pub(crate) fn check(&self, vertices: usize) -> Result<(), Defect> {
        let expect = |attribute, values: Option<usize>| match values {
            Some(values) if values != vertices => Err(Defect::AttributeLength { attribute, values, vertices }),
            _ => Ok(()),
        };
        expect("normals", self.normals.as_ref().map(Vec::len))?;
        expect("reflectances", self.reflectance.as_ref().map(Vec::len))?;
        expect("ambient occlusions", self.ambient_occlusion.as_ref().map(Vec::len))?;
        expect("mean curvatures", self.mean_curvature.as_ref().map(Vec::len))?;
        expect("colours", self.colours.as_ref().map(Vec::len))
    }
}

impl Mesh {
    /// A mesh from points of the world, triangles and what else is known of the vertices.
    ///
    /// # Errors
    /// Whatever breaks the promises above is a [`Defect`].
    pub fn new(points: &[[f64; 3]], triangles: Vec<[u32; 3]>, attributes: Attributes) -> Result<Mesh, Defect> {
        let vertices = points.len();
        if triangles.is_empty() {
            return Err(Defect::NoFaces { vertices });
        }
        if vertices > u32::MAX as usize {
            return Err(Defect::TooManyVertices { vertices: vertices as u64 });
        }
        let out_of_range = |t: &[u32; 3]| t.iter().any(|&i| i as usize >= vertices);
        if let Some(face) = triangles.par_iter().position_first(out_of_range) {
            let index = triangles[face].into_iter().max().map_or(0, i64::from);
            return Err(Defect::IndexOutOfRange { face, index, vertices });
        }
        attributes.check(vertices)?;
        if let Some(values) = attributes.uvs.as_ref().map(Vec::len).filter(|values| *values != triangles.len()) {
            return Err(Defect::UvLength { values, triangles: triangles.len() });
        }
        let (origin, positions) = localize(points)?;
        Ok(Mesh::assemble(origin, positions, triangles, attributes))
    }

    /// The mesh over what is valid already: finite positions relative to `origin`, indices in range, as many values
    /// of each attribute as vertices.
    pub(crate) fn assemble(
        origin: [f64; 3],
        positions: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        attributes: Attributes,
    ) -> Mesh {
        let Attributes { normals, colours, uvs, .. } = attributes;
        let normals = complete_normals(normals, &positions, &triangles);
        let scalars = [attributes.reflectance, attributes.ambient_occlusion, attributes.mean_curvature];
        let [reflectance, ambient_occlusion, mean_curvature] = scalars.map(|scalars| scalars.map(without_gaps));
        let known = |values: Option<Vec<f32>>| values.map_or_else(OnceLock::new, OnceLock::from);
        Mesh {
            origin: origin.into(),
            positions,
            triangles,
            normals,
            reflectance,
            colours,
            uvs: uvs.filter(|uvs| uvs.as_flattened().as_flattened().iter().all(|x| x.is_finite())),
            ambient_occlusion: known(ambient_occlusion),
            mean_curvature: known(mean_curvature),
            is_cloud: false,
            points: Vec::new(),
            prepared: Prepared::default(),
        }
    }

    /// The mesh as the rasterizer takes it, made ready when it is first asked for: positions and triangles are not to be changed
    /// after that.
    pub fn shape(&self) -> Triangles<'_> {
        let plain = Triangles::new(&self.positions, &self.triangles);
        Triangles { meshlets: Some(self.prepared.0.get_or_init(|| Meshlets::new(&plain))), ..plain }
    }

    /// Vertex `i` in the world.
    pub fn point(&self, i: usize) -> Point3<f64> {
        Point3::from(self.origin + Vector3::from(self.positions[i].map(f64::from)))
    }

    /// The least and the greatest corner of the bounding box, in the world.
    pub fn bounds(&self) -> (Point3<f64>, Point3<f64>) {
        let bounds = Bounds::over(&self.positions);
        (Point3::from(self.origin + Vector3::from(bounds.low)), Point3::from(self.origin + Vector3::from(bounds.high)))
    }

    /// The centre of the bounding box, in the world.
    pub fn centre(&self) -> Point3<f64> {
        let (low, high) = self.bounds();
        nalgebra::center(&low, &high)
    }

    /// The length of the bounding box's diagonal.
    pub fn diagonal(&self) -> f64 {
        let (low, high) = self.bounds();
        (high - low).norm()
    }
}

/// A bounding box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) low: [f64; 3],
    pub(crate) high: [f64; 3],
}

impl Bounds {
    /// The box around nothing.
    pub(crate) const EMPTY: Bounds = Bounds { low: [f64::INFINITY; 3], high: [f64::NEG_INFINITY; 3] };

    /// The smallest box around both.
    pub(crate) fn union(self, other: Bounds) -> Bounds {
        Bounds {
            low: std::array::from_fn(|k| self.low[k].min(other.low[k])),
            high: std::array::from_fn(|k| self.high[k].max(other.high[k])),
        }
    }

    /// The box around points of the world, all of which must be finite.
    fn of(points: &[[f64; 3]]) -> Result<Bounds, Defect> {
        let not_finite = |p: &[f64; 3]| p.iter().any(|x| !x.is_finite());
        if let Some(vertex) = points.par_iter().position_first(not_finite) {
            let value = points[vertex].into_iter().find(|x| !x.is_finite()).unwrap_or(f64::NAN);
            return Err(Defect::NotFinite { vertex, value });
        }
        Ok(points.par_iter().map(|&p| Bounds { low: p, high: p }).reduce(|| Bounds::EMPTY, Bounds::union))
    }

    /// The box around single-precision positions.
    pub(crate) fn over(positions: &[[f32; 3]]) -> Bounds {
        // Four points side by side, so that the loop runs on whole SIMD registers.
        let fold = |chunk: &[[f32; 3]]| {
            let (mut low, mut high) = ([f32::INFINITY; 12], [f32::NEG_INFINITY; 12]);
            let mut add = |four: &[f32; 12]| {
                for k in 0..12 {
                    low[k] = if four[k] < low[k] { four[k] } else { low[k] };
                    high[k] = if four[k] > high[k] { four[k] } else { high[k] };
                }
            };
            let (fours, rest) = chunk.as_flattened().as_chunks::<12>();
            fours.iter().for_each(&mut add);
            for point in rest.as_chunks::<3>().0 {
                add(&std::array::from_fn(|k| point[k % 3]));
            }
            let over = |lanes: [f32; 12], pick: fn(f32, f32) -> f32| -> [f64; 3] {
                std::array::from_fn(|k| f64::from((0..4).map(|i| lanes[3 * i + k]).fold(lanes[k], pick)))
            };
            Bounds { low: over(low, f32::min), high: over(high, f32::max) }
        };
        positions.par_chunks(1 << 16).map(fold).reduce(|| Bounds::EMPTY, Bounds::union)
    }
}

/// The origin for a model within `bounds`: its centre, rounded to a power of two at most 1/16 of its longest side, so
/// that subtracting it from single-precision coordinates loses as little as can be.
pub(crate) fn round_origin(bounds: &Bounds) -> Result<[f64; 3], Defect> {
    let extent = (0..3).map(|k| bounds.high[k] - bounds.low[k]).fold(0.0, f64::max);
    if extent > f64::from(f32::MAX).sqrt() {
        return Err(Defect::TooLarge { extent });
    }
    if bounds.low[0] > bounds.high[0] {
        return Ok([0.0; 3]);
    }
    let grid = if extent > f64::MIN_POSITIVE { (extent / 16.0).log2().floor().exp2() } else { 0.0 };
    Ok(std::array::from_fn(|k| {
        let centre = bounds.low[k] + 0.5 * (bounds.high[k] - bounds.low[k]);
        let rounded = (centre / grid).round() * grid;
        if rounded.is_finite() { rounded } else { centre }
    }))
}

/// A round origin for points of the world, and the points relative to it.
pub(crate) fn localize(points: &[[f64; 3]]) -> Result<([f64; 3], Vec<[f32; 3]>), Defect> {
    let origin = round_origin(&Bounds::of(points)?)?;
    Ok((origin, points.par_iter().map(|&p| relative(p, &origin)).collect()))
}

/// A point of the world relative to the origin.
#[inline]
pub(crate) fn relative(point: [f64; 3], origin: &[f64; 3]) -> [f32; 3] {
    [(point[0] - origin[0]) as f32, (point[1] - origin[1]) as f32, (point[2] - origin[2]) as f32]
}

/// The values, those that are not finite replaced by the mean of those that are (zero if none is).
fn without_gaps(mut values: Vec<f32>) -> Vec<f32> {
    if values.iter().all(|v| v.is_finite()) {
        return values;
    }
    let finite = values.iter().filter(|v| v.is_finite());
    let (sum, count) = finite.fold((0.0, 0.0), |(sum, count), &v| (sum + f64::from(v), count + 1.0));
    let mean = if count > 0.0 { (sum / count) as f32 } else { 0.0 };
    values.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = mean);
    values
}
