//! Parts of a model: several meshes, each in a frame of its own, put together in one.
use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use crate::error::Defect;
use crate::mesh::{Attributes, Mesh, relative};

/// Triangles over points of the world, with attributes that are kept if every part of a model has them.
#[derive(Default)]
pub(crate) struct Part {
    pub(crate) points: Vec<[f64; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) attributes: Attributes,
    /// Whether it is a point cloud; a model is one if every part of it is.
    pub(crate) is_cloud: bool,
    /// Where the squares of a cloud have their points.
    pub(crate) centres: Vec<[f64; 3]>,
}

impl Part {
    /// A mesh as a part.
    pub(crate) fn of(mesh: Mesh) -> Self {
        let points = (0..mesh.positions.len()).map(|i| mesh.point(i).into()).collect();
        let centres = mesh.points.iter().map(|p| (mesh.origin + Vector3::from(p.map(f64::from))).into()).collect();
        let Mesh { triangles, normals, reflectance, colours, uvs, is_cloud, .. } = mesh;
        let attributes = Attributes { normals: Some(normals), reflectance, colours, uvs, ..Attributes::default() };
        Self { points, triangles, attributes, is_cloud, centres }
    }

    /// Moves the part by an affine transform, world from part. One that mirrors turns the triangles over, so that outside
    /// stays outside.
    pub(crate) fn moved(mut self, world_from_part: &Matrix4<f64>) -> Self {
        if *world_from_part == Matrix4::identity() {
            return self;
        }
        for point in self.points.iter_mut().chain(&mut self.centres) {
            *point = world_from_part.transform_point(&Point3::from(*point)).into();
        }
        let linear: Matrix3<f64> = world_from_part.fixed_view::<3, 3>(0, 0).into();
        // Normals go with the cofactors, which are the inverse transpose times the determinant.
        let sign = if linear.determinant() < 0.0 { -1.0 } else { 1.0 };
        let cofactors = sign
            * Matrix3::from_columns(&[
                linear.column(1).cross(&linear.column(2)),
                linear.column(2).cross(&linear.column(0)),
                linear.column(0).cross(&linear.column(1)),
            ]);
        for normal in self.attributes.normals.iter_mut().flatten() {
            let moved = cofactors * Vector3::from(normal.map(f64::from));
            *normal = moved.try_normalize(0.0).unwrap_or_default().map(|x| x as f32).into();
        }
        if sign < 0.0 {
            self.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
            self.attributes.uvs.iter_mut().flatten().for_each(|corners| corners.swap(1, 2));
        }
        self
    }
}

/// The mesh of all parts together.
pub(crate) fn assemble(parts: Vec<Part>) -> Result<Mesh, Defect> {
    let vertices: usize = parts.iter().map(|part| part.points.len()).sum();
    if vertices > u32::MAX as usize {
        return Err(Defect::TooManyVertices { vertices: vertices as u64 });
    }
    let mut parts = parts.into_iter().filter(|part| !part.points.is_empty());
    let mut all = parts.next().unwrap_or_default();
    for part in parts {
        let shift = all.points.len() as u32;
        // A vertex out of range stays so.
        let shifted = |triangle: [u32; 3]| triangle.map(|i| i.saturating_add(shift));
        all.triangles.extend(part.triangles.into_iter().map(shifted));
        all.points.extend(part.points);
        all.centres.extend(part.centres);
        let (ours, theirs) = (&mut all.attributes, part.attributes);
        join(&mut ours.normals, theirs.normals);
        join(&mut ours.reflectance, theirs.reflectance);
        join(&mut ours.colours, theirs.colours);
        join(&mut ours.uvs, theirs.uvs);
        all.is_cloud &= part.is_cloud;
    }
    let mesh = Mesh::new(&all.points, all.triangles, all.attributes)?;
    let origin: [f64; 3] = mesh.origin.into();
    let points = all.centres.iter().filter(|_| all.is_cloud).map(|&point| relative(point, &origin)).collect();
    Ok(Mesh { is_cloud: all.is_cloud, points, ..mesh })
}

fn join<T>(ours: &mut Option<Vec<T>>, theirs: Option<Vec<T>>) {
    match (ours.as_mut(), theirs) {
        (Some(ours), Some(theirs)) => ours.extend(theirs),
        _ => *ours = None,
    }
}
