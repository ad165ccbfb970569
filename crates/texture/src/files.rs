//! Textured models as OBJ and PLY files.

use crate::split::Split;
use crate::{Error, Texture};
use image::RgbImage;
use image::codecs::png::PngEncoder;
use std::fmt::Write as _;
use std::io::Cursor;
use texreg_surface::Mesh;

/// A picture as a PNG file.
///
/// # Errors
/// [`Error::Image`] if it cannot be encoded.
pub fn png(image: &RgbImage) -> Result<Vec<u8>, Error> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_with_encoder(PngEncoder::new(&mut bytes)).map_err(|e| Error::Image { cause: e.to_string() })?;
    Ok(bytes.into_inner())
}

/// A textured mesh as a Wavefront OBJ file that names the material library `material`, coordinates in the world. Its
/// texture coordinates start at the bottom left, as the format has it.
pub fn obj(mesh: &Mesh, texture: &Texture, material: &str) -> String {
    let split = Split::new(mesh, texture);
    let mut text = format!("mtllib {material}\n");
    for i in 0..mesh.positions.len() {
        let p = mesh.point(i);
        let _ = writeln!(text, "v {} {} {}", p.x, p.y, p.z);
    }
    for [u, v] in &split.uvs {
        let _ = writeln!(text, "vt {} {}", u, 1.0 - v);
    }
    for [x, y, z] in &mesh.normals {
        let _ = writeln!(text, "vn {x} {y} {z}");
    }
    text += "usemtl photos\n";
    for triangle in &split.triangles {
        let [a, b, c] = triangle.map(|i| {
            let vertex = split.vertices[i as usize] + 1;
            format!("{vertex}/{}/{vertex}", i + 1)
        });
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    text
}

/// The material library of an OBJ file: one unlit material, `photos`, whose texture is the file `image`.
pub fn mtl(image: &str) -> String {
    format!("newmtl photos\nKa 0 0 0\nKd 1 1 1\nKs 0 0 0\nillum 0\nmap_Kd {image}\n")
}

/// A mesh with coloured vertices as a binary PLY file, coordinates in the world: single precision where that is exact, double
/// otherwise. Normals and reflectance are kept.
pub fn ply(mesh: &Mesh, colours: &[[u8; 3]]) -> Vec<u8> {
    let points: Vec<[f64; 3]> = (0..mesh.positions.len()).map(|i| mesh.point(i).into()).collect();
    let is_single = points.as_flattened().iter().all(|&x| f64::from(x as f32) == x);
    let number = if is_single { "float" } else { "double" };
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", points.len());
    ["x", "y", "z"].iter().for_each(|name| header += &format!("property {number} {name}\n"));
    ["nx", "ny", "nz"].iter().for_each(|name| header += &format!("property float {name}\n"));
    ["red", "green", "blue"].iter().for_each(|name| header += &format!("property uchar {name}\n"));
    if mesh.reflectance.is_some() {
        header += "property float reflectance\n";
    }
    header += &format!("element face {}\nproperty list uchar uint vertex_indices\nend_header\n", mesh.triangles.len());
    let mut bytes = header.into_bytes();
    for (i, point) in points.iter().enumerate() {
        for &x in point {
            if is_single { bytes.extend((x as f32).to_le_bytes()) } else { bytes.extend(x.to_le_bytes()) }
        }
        mesh.normals[i].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        bytes.extend(colours.get(i).copied().unwrap_or_default());
        if let Some(reflectance) = &mesh.reflectance {
            bytes.extend(reflectance[i].to_le_bytes());
        }
    }
    for triangle in &mesh.triangles {
        bytes.push(3);
        triangle.iter().for_each(|i| bytes.extend(i.to_le_bytes()));
    }
    bytes
}
