//! PLY, the Stanford polygon format (G. Turk, 1994): a text header that declares elements and their properties, then
//! their values as text or binary of either byte order.
//!
//! Binary vertices and faces whose records all have one size, as nearly every file's have, are read in bulk by
//! `binary`; everything else goes record by record through `records`.
mod binary;
mod header;
mod records;
mod source;
mod write;

use std::path::Path;

use crate::cloud::Scanner;
use crate::error::{Defect, Error, Place};
use crate::mesh::{Attributes, Mesh};
use header::{Element, Encoding, Header, Kind, Scalar};
use records::Words;
pub(crate) use source::Source;

/// Why a file cannot be read, before its name is put to it.
#[derive(Debug)]
enum Fault {
    Io(std::io::Error),
    Syntax(Place, String),
    Defect(Option<Place>, Defect),
}

impl From<Defect> for Fault {
    fn from(defect: Defect) -> Fault {
        Fault::Defect(None, defect)
    }
}

/// The vertices as read: what the fields of [`Mesh`] say.
#[derive(Default)]
struct Vertices {
    origin: [f64; 3],
    positions: Vec<[f32; 3]>,
    attributes: Attributes,
    /// A texture coordinate for each, if they have any.
    uvs: Option<Vec<[f32; 2]>>,
}

/// Where the vertex element keeps what is wanted: numbers of properties.
struct Roles {
    position: [usize; 3],
    normal: Option<[usize; 3]>,
    colour: Option<[usize; 3]>,
    /// Texture coordinates, v upwards.
    texture: Option<[usize; 2]>,
    /// Of each of [`SCALARS`].
    scalars: [Option<usize>; 3],
}

/// Where the face element keeps its lists: numbers of properties.
#[derive(Clone, Copy)]
struct Lists {
    /// Vertex numbers.
    corners: usize,
    /// Texture coordinates, u and v (upwards) of each corner.
    texture: Option<usize>,
}

/// The faces as read.
#[derive(Default)]
struct Faces {
    triangles: Vec<[u32; 3]>,
    /// Texture coordinates as in [`Mesh`], if the faces have their own.
    uvs: Option<Vec<[[f32; 2]; 3]>>,
}

/// Texture coordinates of a file, v upwards, as ours.
fn downwards([u, v]: [f64; 2]) -> [f32; 2] {
    [u as f32, (1.0 - v) as f32]
}

/// The names of attributes of one number, the most telling first: reflectance as scanners' programs write it, and what is computed
/// as this one writes it.
const SCALARS: [&[&str]; 3] = [
    &["reflectance", "intensity", "scalar_Intensity", "scalar_intensity", "scalar_Reflectance", "quality"],
    &[AMBIENT_OCCLUSION],
    &[MEAN_CURVATURE],
];
const AMBIENT_OCCLUSION: &str = "ambient_occlusion";
const MEAN_CURVATURE: &str = "mean_curvature";

impl Roles {
    fn of(vertex: &Element, header: &Header) -> Result<Roles, Fault> {
        let find = |name: &str| vertex.properties.iter().position(|p| p.name == name && matches!(p.kind, Kind::One(_)));
        let three = |names: [&str; 3]| Some([find(names[0])?, find(names[1])?, find(names[2])?]);
        let position = three(["x", "y", "z"])
            .ok_or_else(|| Fault::Syntax(header.end(), "the header declares no vertex properties x, y and z".into()))?;
        Ok(Roles {
            position,
            normal: three(["nx", "ny", "nz"]),
            colour: three(["red", "green", "blue"]).or_else(|| three(["diffuse_red", "diffuse_green", "diffuse_blue"])),
            texture: [["s", "t"], ["texture_u", "texture_v"]].into_iter().find_map(|[u, v]| Some([find(u)?, find(v)?])),
            scalars: SCALARS.map(|names| names.iter().find_map(|name| find(name))),
        })
    }
}

/// What was read of the vertices' attributes, the scalars in the order of [`SCALARS`].
fn attributes(
    normals: Option<Vec<[f32; 3]>>,
    [reflectance, ambient_occlusion, mean_curvature]: [Option<Vec<f32>>; 3],
    colours: Option<Vec<[u8; 3]>>,
) -> Attributes {
    Attributes { normals, reflectance, colours, uvs: None, ambient_occlusion, mean_curvature }
}

/// What brings a colour of a type to 0…255: integers of 8 bits are it already, wider ones lose their low bits, and
/// floating-point colours span 0…1.
fn colour_scale(scalar: Scalar) -> f64 {
    match scalar {
        Scalar::F32 | Scalar::F64 => 255.0,
        Scalar::I16 | Scalar::U16 => 255.0 / 65535.0,
        _ => 1.0,
    }
}

/// Whether a file that begins so is a PLY file.
pub(crate) fn is_ply(magic: &[u8]) -> bool {
    magic.starts_with(b"ply\n") || magic.starts_with(b"ply\r")
}

/// What to say of a file that is named `.ply` and is none.
pub(crate) fn not_ply(path: &Path, magic: &[u8]) -> Error {
    let cause = if magic.is_empty() { "the file is empty" } else { "not a PLY file: its first line is not \"ply\"" };
    Error::Syntax { path: path.to_owned(), place: Place::Line(1), cause: cause.into() }
}

/// Reads a PLY file; `path` is for messages only.
pub(crate) fn read(source: &Source, path: &Path) -> Result<Mesh, Error> {
    read_mesh(source).map_err(|fault| match fault {
        Fault::Io(source) => Error::Io { path: path.to_owned(), source },
        Fault::Syntax(place, cause) => Error::Syntax { path: path.to_owned(), place, cause },
        Fault::Defect(place, defect) => Error::Defect { path: path.to_owned(), place, defect },
    })
}

fn read_mesh(source: &Source) -> Result<Mesh, Fault> {
    let header = header::read(source)?;
    let missing = |what: &str| Fault::Syntax(header.end(), format!("the header declares no element \"{what}\""));
    let vertex = header.element("vertex").ok_or_else(|| missing("vertex"))?;
    if vertex.count > u64::from(u32::MAX) {
        return Err(Defect::TooManyVertices { vertices: vertex.count }.into());
    }
    if header.element("tristrips").is_some() && header.element("face").is_none() {
        return Err(Fault::Syntax(
            header.end(),
            "the faces are triangle strips; convert them to triangles first".into(),
        ));
    }
    let face = header.element("face").filter(|face| face.count > 0);
    let roles = Roles::of(vertex, &header)?;
    let lists = face.map(|face| face.lists(&header)).transpose()?;
    let (vertices, faces) = match header.encoding {
        Encoding::Ascii => records::read(&mut Words::new(source, &header)?, &header, &roles, lists)?,
        Encoding::Binary(order) => binary::read(source, order, &header, &roles, lists)?,
    };
    let Vertices { origin, positions, mut attributes, uvs } = vertices;
    let Faces { triangles, uvs: corners } = faces;
    let of_vertices = |uvs: Vec<[f32; 2]>| triangles.iter().map(|t| t.map(|i| uvs[i as usize])).collect();
    attributes.uvs = corners.or_else(|| uvs.map(of_vertices));
    match face {
        None => Ok(Mesh::from_local_points(origin, &positions, attributes, Scanner::Unknown)?),
        Some(_) if triangles.is_empty() => Err(Defect::NoFaces { vertices: positions.len() }.into()),
        Some(_) => Ok(Mesh::assemble(origin, positions, triangles, attributes)),
    }
}

/// The advice that goes with a file that ends too early.
fn ends_inside(element: &Element, record: u64, end: Place) -> Fault {
    let Element { name, count, .. } = element;
    Fault::Syntax(
        end,
        format!("the file ends inside {name} {record} of {count}; it is cut short, copy or export it again"),
    )
}
