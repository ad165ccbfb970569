//! Writing: binary PLY of little-endian byte order, under the names that are read.
use std::io::{self, Write};

use super::{AMBIENT_OCCLUSION, MEAN_CURVATURE};
use crate::mesh::Mesh;

impl Mesh {
    /// Writes the mesh as a binary PLY file, with all its attributes and whatever was computed of them: what is read back is equal.
    ///
    /// # Errors
    /// What `out` reports.
    pub fn write_ply(&self, out: &mut dyn Write) -> io::Result<()> {
        let scalars = self.scalars();
        let scalars = || scalars.iter().filter_map(|(name, values)| Some((name, (*values)?)));
        // Single precision is exact where the world's zero is the model's own.
        let local = self.origin == nalgebra::Vector3::zeros();
        let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", self.positions.len());
        let mut declare = |kind: &str, names: &[&str]| {
            names.iter().for_each(|name| header += &format!("property {kind} {name}\n"));
        };
        declare(if local { "float" } else { "double" }, &["x", "y", "z"]);
        declare("float", &["nx", "ny", "nz"]);
        if self.colours.is_some() {
            declare("uchar", &["red", "green", "blue"]);
        }
        scalars().for_each(|(name, _)| declare("float", &[name]));
        let faces = self.triangles.len();
        header += &format!("element face {faces}\nproperty list uchar uint vertex_indices\nend_header\n");
        out.write_all(header.as_bytes())?;
        for i in 0..self.positions.len() {
            if local {
                write_floats(out, self.positions[i])?;
            } else {
                let point = self.point(i);
                [point.x, point.y, point.z].into_iter().try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
            }
            write_floats(out, self.normals[i])?;
            if let Some(colours) = &self.colours {
                out.write_all(&colours[i])?;
            }
            scalars().try_for_each(|(_, values)| write_floats(out, [values[i]]))?;
        }
        for triangle in &self.triangles {
            out.write_all(&[3])?;
            triangle.iter().try_for_each(|corner| out.write_all(&corner.to_le_bytes()))?;
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
