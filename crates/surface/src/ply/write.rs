//! Writing: binary PLY of little-endian byte order, under the names that are read.
use std::io::{self, Write};

use super::{AMBIENT_OCCLUSION, MEAN_CURVATURE};
use crate::mesh::Mesh;

impl Mesh {
    /// Writes the mesh as a binary PLY file, with all its attributes and whatever was computed of them: what is read back is equal,
    /// but for rounding in texture coordinates, whose v goes upwards there. A cloud is written as its points.
    ///
    /// # Errors
    /// What `out` reports.
    pub fn write_ply(&self, out: &mut dyn Write) -> io::Result<()> {
        let scalars = self.scalars();
        let scalars = || scalars.iter().filter_map(|(name, values)| Some((name, (*values)?)));
        // A point has the attributes of its square's corners.
        let (positions, step) = if self.is_cloud { (&self.points, 4) } else { (&self.positions, 1) };
        // Single precision is exact where the world's zero is the model's own.
        let local = self.origin == nalgebra::Vector3::zeros();
        let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", positions.len());
        let mut declare = |kind: &str, names: &[&str]| {
            names.iter().for_each(|name| header += &format!("property {kind} {name}\n"));
        };
        declare(if local { "float" } else { "double" }, &["x", "y", "z"]);
        declare("float", &["nx", "ny", "nz"]);
        if self.colours.is_some() {
            declare("uchar", &["red", "green", "blue"]);
        }
        scalars().for_each(|(name, _)| declare("float", &[name]));
        let triangles = if self.is_cloud { &[] } else { self.triangles.as_slice() };
        let uvs = self.uvs.as_ref().filter(|_| !self.is_cloud);
        if !triangles.is_empty() {
            header += &format!("element face {}\nproperty list uchar uint vertex_indices\n", triangles.len());
        }
        if uvs.is_some() {
            header += "property list uchar float texcoord\n";
        }
        header += "end_header\n";
        out.write_all(header.as_bytes())?;
        for (position, i) in positions.iter().zip((0..).step_by(step)) {
            if local {
                write_floats(out, *position)?;
            } else {
                let point = self.origin + nalgebra::Vector3::from(position.map(f64::from));
                point.iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
            }
            write_floats(out, self.normals[i])?;
            if let Some(colours) = &self.colours {
                out.write_all(&colours[i])?;
            }
            let mean = |values: &[f32]| values.iter().map(|&x| f64::from(x)).sum::<f64>() / step as f64;
            scalars().try_for_each(|(_, values)| write_floats(out, [mean(&values[i..i + step]) as f32]))?;
        }
        for (i, triangle) in triangles.iter().enumerate() {
            out.write_all(&[3])?;
            triangle.iter().try_for_each(|corner| out.write_all(&corner.to_le_bytes()))?;
            if let Some(uvs) = uvs {
                out.write_all(&[6])?;
                uvs[i].iter().try_for_each(|&[u, v]| write_floats(out, [u, 1.0 - v]))?;
            }
        }
        Ok(())
    }

    /// The attributes of one number under their names in a file.
    fn scalars(&self) -> [(&'static str, Option<&[f32]>); 3] {
        [
            ("reflectance", self.reflectance.as_deref()),
            (AMBIENT_OCCLUSION, self.ambient_occlusion.get().map(Vec::as_slice)),
            (MEAN_CURVATURE, self.mean_curvature.get().map(Vec::as_slice)),
        ]
    }
}

fn write_floats<const N: usize>(out: &mut dyn Write, values: [f32; N]) -> io::Result<()> {
    values.into_iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))
}
