//! What can be wrong with a model, said in one line: the file, the place in it, the cause and, where it helps, what to do.
use std::fmt;
use std::path::{Path, PathBuf};

/// A model file that could not be loaded.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The file could not be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is of no format this crate reads.
    #[error("{}: not a PLY, OBJ, STL, OFF, glTF, LAS, LAZ, E57 or MeshLab project file; convert the model to one of these", path.display())]
    Format {
        /// The file.
        path: PathBuf,
    },
    /// The file breaks the rules of its format, or ends too early.
    #[error("{}: {place}: {cause}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Where in the file.
        place: Place,
        /// What is wrong there.
        cause: String,
    },
    /// The file cannot be decoded.
    #[error("{}: {cause}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What the decoder says.
        cause: String,
    },
    /// The file is well formed, but what it holds is no usable surface.
    #[error("{}: {}{defect}", path.display(), place.map(|p| format!("{p}: ")).unwrap_or_default())]
    Defect {
        /// The file.
        path: PathBuf,
        /// Where in the file, if one place is to blame.
        place: Option<Place>,
        /// What is wrong with the surface.
        defect: Defect,
    },
}

impl Error {
    /// The longest cause that is told in full, in characters.
    const LONGEST: usize = 200;

    /// What a decoder says of a file, in a line, whatever of the file it quotes.
    pub(crate) fn damaged(path: &Path, cause: &str) -> Self {
        let mut line: String =
            cause.chars().take(Self::LONGEST).map(|c| if c.is_control() { ' ' } else { c }).collect();
        if cause.chars().nth(Self::LONGEST).is_some() {
            line.push('…');
        }
        Error::Damaged { path: path.to_owned(), cause: line }
    }
}

/// A place in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// A line of a text file, counted from one.
    Line(u64),
    /// An offset into a binary file, counted from zero.
    Byte(u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Place::Line(line) => write!(f, "line {line}"),
            Place::Byte(byte) => write!(f, "byte {byte}"),
        }
    }
}

/// Why vertices and triangles do not make a usable surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Defect {
    /// There is nothing to see: no faces, nor a point cloud.
    #[error(
        "the model has no faces; export its {vertices} points as a cloud (PLY, LAS, E57), or reconstruct a surface"
    )]
    NoFaces {
        /// The number of vertices there are.
        vertices: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has the coordinate {value}, which is not finite; remove or repair the vertex")]
    NotFinite {
        /// The vertex, counted from zero.
        vertex: usize,
        /// The coordinate.
        value: f64,
    },
    /// The model is so large that its coordinates do not fit single precision.
    #[error("the model is {extent:e} units wide, more than single precision holds; choose a larger unit")]
    TooLarge {
        /// The longest side of its bounding box.
        extent: f64,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {index}, but there are only {vertices}")]
    IndexOutOfRange {
        /// The face, counted from zero.
        face: usize,
        /// The vertex it names.
        index: i64,
        /// The number of vertices there are.
        vertices: usize,
    },
    /// There are more vertices than 32-bit indices reach.
    #[error("the model has {vertices} vertices, more than 32-bit indices reach; decimate it first")]
    TooManyVertices {
        /// The number of vertices.
        vertices: u64,
    },
    /// A per-vertex attribute has not one value a vertex.
    #[error("there are {values} {attribute} for {vertices} vertices")]
    AttributeLength {
        /// The attribute.
        attribute: &'static str,
        /// The number of its values.
        values: usize,
        /// The number of vertices.
        vertices: usize,
    },
    /// There are not three texture coordinates a triangle.
    #[error("there are texture coordinates of {values} triangles for {triangles}")]
    UvLength {
        /// The number of triangles that have texture coordinates.
        values: usize,
        /// The number of triangles.
        triangles: usize,
    },
}
