//! LAS, the ASPRS exchange format of laser scans, and LAZ, its compressed form, through the crate `las`.
use std::io::{Read, Seek, SeekFrom};

use ::las::{PointDataBuilder, Reader};

use crate::cloud::Scanner;
use crate::error::Error;
use crate::mesh::{Attributes, Mesh};

/// Points read at once.
const CHUNK: u64 = 1 << 16;

/// Whether a file that begins so is a LAS or LAZ file.
pub(crate) fn is_las(magic: &[u8]) -> bool {
    magic == b"LASF"
}

/// Whether the number of chunks that a LAZ file declares fits its length: the decoder makes room for as many.
fn chunks_fit(file: &mut (impl Read + Seek)) -> std::io::Result<bool> {
    let length = file.seek(SeekFrom::End(0))?;
    let mut number = |at: SeekFrom| -> std::io::Result<u64> {
        let mut bytes = [0; 8];
        file.seek(at)?;
        file.read_exact(&mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    };
    let points = number(SeekFrom::Start(96))? & u64::from(u32::MAX);
    let compressed = number(SeekFrom::Start(104))? & 0xc0 != 0;
    let table = number(SeekFrom::Start(points))?;
    let table = if table == u64::MAX { SeekFrom::End(-8) } else { SeekFrom::Start(table) };
    let chunks = number(table)? >> 32;
    file.rewind()?;
    Ok(!compressed || chunks <= length)
}

/// Reads the points that are not withheld.
pub(crate) fn read(
    mut file: impl Read + Seek + Send + Sync + 'static,
    damaged: impl Fn(String) -> Error,
    defective: impl Fn(crate::Defect) -> Error,
) -> Result<Mesh, Error> {
    let fault = |error: ::las::Error| damaged(error.to_string());
    // What is not even readable so far is for the decoder to say.
    if !chunks_fit(&mut file).unwrap_or(true) || file.rewind().is_err() {
        return Err(damaged("it declares more chunks of points than it has bytes".into()));
    }
    let mut reader = Reader::new(std::io::BufReader::new(file)).map_err(fault)?;
    let header = reader.header();
    let has_colour = header.point_format().has_color;
    let expected = header.number_of_points();
    let mut data = PointDataBuilder::new().for_header(header).build();
    let (mut points, mut intensities) = (Vec::new(), Vec::new());
    let mut colours: Vec<[u16; 3]> = Vec::new();
    let mut left = expected;
    while left > 0 {
        let count = reader.fill_points(CHUNK.min(left), &mut data).map_err(fault)?;
        if count == 0 {
            return Err(damaged(format!("the file ends after {} of {expected} points", expected - left)));
        }
        left = left.saturating_sub(count);
        for point in data.points() {
            let point = point.map_err(fault)?;
            if point.is_withheld {
                continue;
            }
            points.push([point.x, point.y, point.z]);
            intensities.push(f32::from(point.intensity));
            let colour = point.color.unwrap_or_default();
            colours.push([colour.red, colour.green, colour.blue]);
        }
    }
    // Some programs write colours of 8 bits where the format has 16, and intensities of zero where they know none.
    let shift = if colours.as_flattened().iter().any(|&c| c > 255) { 8 } else { 0 };
    let attributes = Attributes {
        reflectance: Some(intensities).filter(|values| values.iter().any(|&v| v > 0.0)),
        colours: has_colour.then(|| colours.into_iter().map(|c| c.map(|x| (x >> shift) as u8)).collect()),
        ..Attributes::default()
    };
    Mesh::from_points(&points, attributes, Scanner::Unknown).map_err(defective)
}
