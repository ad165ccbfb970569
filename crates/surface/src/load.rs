//! Loading a model: the format is told by the first bytes and by the file's name.
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;

use crate::error::Error;
use crate::mesh::Mesh;
use crate::quietly::quietly;
use crate::{e57, gltf, las, mlp, obj, off, ply, stl};

/// Loads a model from a PLY, OBJ, STL, OFF, glTF, LAS, LAZ or E57 file, or all meshes of a MeshLab project.
///
/// - PLY: ASCII and binary of both byte orders. Vertices have `x y z`, optionally normals `nx ny nz`, colours
///   `red green blue`, a reflectance, the first of `reflectance`, `intensity`, `scalar_Intensity` and `quality`, and
///   `ambient_occlusion` and `mean_curvature` as [`Mesh::write_ply`] writes them. Texture coordinates are the faces' `texcoord`
///   or the vertices' `s t` or `texture_u texture_v`. Faces are polygons of any length and become fans of triangles; other elements and properties are skipped.
///   A file without faces is a point cloud.
/// - LAS and LAZ: a point cloud with intensities and colours; points marked as withheld are left out.
/// - E57: the valid points of all scans as one cloud in the frame of the file, with intensities and colours.
/// - OBJ: positions, normals, vertex colours and polygons of all objects of the file together.
/// - STL and OFF: positions and faces.
/// - glTF (`.gltf`, `.glb`): the triangles of all meshes in its scene where its nodes put them, with normals, colours and
///   texture coordinates (the first set).
/// - MeshLab project (`.mlp`): its meshes, each moved by its matrix.
///
/// Several meshes are one model, which has an attribute if all of them do. Units and axes are left as they are.
///
/// Normals that are absent or invalid are computed from the triangles around the vertex, weighted by area, or from the
/// points around a point; see [`Mesh::from_points`] for what becomes of a cloud.
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
    } else if las::is_las(&magic) || e57::is_e57(&magic) {
        file.rewind().map_err(io)?;
        let damaged = |cause: String| Error::damaged(path, &cause);
        let defective = |defect| Error::Defect { path: path.to_owned(), place: None, defect };
        let decode = || match las::is_las(&magic) {
            true => las::read(file, damaged, defective),
            false => e57::read(file, damaged, defective),
        };
        quietly(decode).unwrap_or_else(|| Err(damaged("its decoder gave it up".into())))
    } else {
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let mut whole = |mut bytes: Vec<u8>| file.read_to_end(&mut bytes).map(|_| bytes).map_err(io);
        match extension.as_str() {
            _ if magic == *b"glTF" => gltf::read(&whole(magic)?, path),
            "ply" => Err(ply::not_ply(path, &magic)),
            "obj" => obj::read(&whole(magic)?, path),
            "stl" => stl::read(&whole(magic)?, path),
            "off" => off::read(&whole(magic)?, path),
            "gltf" | "glb" => gltf::read(&whole(magic)?, path),
            "mlp" => mlp::read(&whole(magic)?, path, |file| load(file)),
            _ => Err(Error::Format { path: path.to_owned() }),
        }
    }
}
