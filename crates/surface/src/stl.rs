//! STL files, ASCII and binary, parsed by `stl_io`. Corners at the same place become one vertex.
use std::io::Cursor;
use std::path::Path;

use crate::error::Error;
use crate::mesh::{Attributes, Mesh};

pub(crate) fn read(bytes: &[u8], path: &Path) -> Result<Mesh, Error> {
    let damaged = |cause: String| Error::damaged(path, &cause);
    // A binary file says how many triangles it has; the parser would take its word for it.
    let is_text = bytes.starts_with(b"solid") && bytes.iter().take(512).all(u8::is_ascii);
    let count = bytes.get(80..84).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])));
    if !is_text && count.is_none_or(|count| 84 + 50 * count > bytes.len() as u64) {
        return Err(damaged("the file is cut short: it has fewer triangles than it says".into()));
    }
    let mesh = stl_io::read_stl(&mut Cursor::new(bytes)).map_err(|error| damaged(error.to_string()))?;
    let points: Vec<[f64; 3]> = mesh.vertices.iter().map(|v| v.0.map(f64::from)).collect();
    let triangles = mesh.faces.iter().map(|face| face.vertices.map(|i| i as u32)).collect();
    Mesh::new(&points, triangles, Attributes::default()).map_err(|defect| Error::Defect {
        path: path.to_owned(),
        place: None,
        defect,
    })
}
