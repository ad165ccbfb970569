//! OBJ files (Wavefront), parsed by `tobj`.
//!
//! Their texture coordinates start at the bottom left; ours at the top left.
use std::path::Path;

use crate::error::{Defect, Error, Place};
use crate::mesh::{Attributes, Mesh};

/// Reads the surface in an OBJ file: the positions, their colours, and the faces of all its objects together with
/// their texture coordinates, if every corner has them. Normals are computed, since the file's belong to corners of faces. `path` is for messages only.
pub(crate) fn read(bytes: &[u8], path: &Path) -> Result<Mesh, Error> {
    let text = String::from_utf8_lossy(bytes);
    let syntax = |(place, cause)| Error::Syntax { path: path.to_owned(), place, cause };
    let options = tobj::LoadOptions { triangulate: true, ..Default::default() };
    // No line that names materials is kept.
    let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
    let parse = |keep: fn(&str) -> bool| {
        let surface: String = text.lines().filter(|line| keep(line)).flat_map(|line| [line, "\n"]).collect();
        tobj::load_obj_buf(&mut surface.as_bytes(), &options, no_materials)
    };
    // Broken texture coordinates do not spoil the surface.
    let (models, _) = parse(|line| is_surface(line) || is_uv(line))
        .or_else(|_| parse(is_surface))
        .map_err(|error| syntax(blame(&text).unwrap_or((Place::Line(1), error.to_string()))))?;
    let Some(tobj::Model { mesh, .. }) = models.into_iter().find(|model| !model.mesh.indices.is_empty()) else {
        let vertices = text.lines().filter(|line| line.split_ascii_whitespace().next() == Some("v")).count();
        return Err(Error::Defect { path: path.to_owned(), place: None, defect: Defect::NoFaces { vertices } });
    };
    let points = mesh.positions.as_chunks().0;
    let triangles = mesh.indices.as_chunks().0.to_vec();
    let colours = mesh.vertex_color.as_chunks().0.iter().map(|c: &[f64; 3]| c.map(|x| (x * 255.0).round() as u8));
    let colours = (!mesh.vertex_color.is_empty()).then(|| colours.collect());
    let uv =
        |&i: &u32| mesh.texcoords.as_chunks().0.get(i as usize).map(|&[u, v]: &[f64; 2]| [u as f32, 1.0 - v as f32]);
    let corners: Vec<[f32; 2]> = mesh.texcoord_indices.iter().map_while(uv).collect();
    let uvs = (corners.len() == mesh.indices.len()).then(|| corners.as_chunks().0.to_vec());
    let attributes = Attributes { colours, uvs, ..Attributes::default() };
    Mesh::new(points, triangles, attributes).map_err(|defect| match blame(&text) {
        // Vertices are numbered by their first use here; the line says more.
        Some(blame) => syntax(blame),
        None => Error::Defect { path: path.to_owned(), place: None, defect },
    })
}

/// Whether a line is a texture coordinate.
fn is_uv(line: &str) -> bool {
    line.split_ascii_whitespace().next() == Some("vt")
}

/// Whether a line describes the surface: a vertex, or a face of at least three corners.
fn is_surface(line: &str) -> bool {
    let mut words = line.split_ascii_whitespace();
    match words.next() {
        Some("v") => true,
        Some("f") => words.count() >= 3,
        _ => false,
    }
}

/// Finds the first line that makes the file unreadable: `tobj` names none.
fn blame(text: &str) -> Option<(Place, String)> {
    let total = text.lines().filter(|line| line.split_ascii_whitespace().next() == Some("v")).count() as i64;
    let mut vertices = 0;
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_ascii_whitespace();
        let cause = match words.next() {
            Some("v") => {
                vertices += 1;
                let finite = |word: &str| word.parse().is_ok_and(f64::is_finite);
                let numbers = words.take(3).filter(|word| finite(word)).count();
                (numbers < 3).then(|| "a vertex needs three finite coordinates; remove or repair it".to_owned())
            }
            Some("f") => words.find_map(|corner| match corner.split('/').next().unwrap_or_default().parse::<i64>() {
                Ok(index) if (1..=total).contains(&index) || (-vertices..0).contains(&index) => None,
                Ok(index) => Some(format!("the face names vertex {index}, but there are only {total}")),
                Err(_) => Some("a face needs whole numbers of vertices".to_owned()),
            }),
            _ => None,
        };
        if let Some(cause) = cause {
            return Some((Place::Line(i as u64 + 1), cause));
        }
    }
    None
}
