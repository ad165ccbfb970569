//! Loading a model: the format is told by the first bytes and by the file's name.
use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::Error;
use crate::mesh::Mesh;
use crate::{obj, ply};

/// Loads a model from a PLY or an OBJ file.
///
/// - PLY: ASCII and binary of both byte orders. Vertices have `x y z`, optionally normals `nx ny nz`, colours
///   `red green blue` and a reflectance, the first of `reflectance`, `intensity`, `scalar_Intensity` and `quality`.
///   Faces are polygons of any length and become fans of triangles; other elements and properties are skipped.
/// - OBJ: positions, normals, vertex colours and polygons of all objects of the file together.
///
/// Normals that are absent or invalid are computed from the triangles around the vertex, weighted by area.
///
/// # Errors
/// One line that names the file, the line or byte, the cause and, where it helps, what to do.
pub fn load(path: impl AsRef<Path>) -> Result<Mesh, Error> {
    let path = path.as_ref();
    let io = |source| Error::Io { path: path.to_owned(), source };
    let mut file = File::open(path).map_err(io)?;
    let metadata = file.metadata().map_err(io)?;
    let mut magic = Vec::new();
    (&mut file).take(4).read_to_end(&mut magic).map_err(io)?;
    if ply::is_ply(&magic) {
        let source = if metadata.is_file() {
            ply::Source::file(file, metadata.len())
        } else {
            file.read_to_end(&mut magic).map_err(io)?;
            ply::Source::Bytes(&magic)
        };
        ply::read(&source, path)
    } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply")) {
        Err(ply::not_ply(path, &magic))
    } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("obj")) {
        file.read_to_end(&mut magic).map_err(io)?;
        obj::read(&magic, path)
    } else {
        Err(Error::Format { path: path.to_owned() })
    }
}
