//! E57 (ASTM E2807), the exchange format of terrestrial scanners, through the crate `e57`: the points of all scans, each put
//! into the world by its scanner's pose.
use std::io::{Read, Seek};

use ::e57::{CartesianCoordinate, E57Reader};

use crate::cloud::splats;
use crate::error::Error;
use crate::mesh::{Attributes, Mesh, localize};

/// Whether a file that begins so is an E57 file.
pub(crate) fn is_e57(magic: &[u8]) -> bool {
    magic == b"ASTM"
}

/// Reads the valid points of all scans.
pub(crate) fn read(
    file: impl Read + Seek,
    damaged: impl Fn(String) -> Error,
    defective: impl Fn(crate::Defect) -> Error,
) -> Result<Mesh, Error> {
    let fault = |error: ::e57::Error| damaged(error.to_string());
    let mut reader = E57Reader::new(std::io::BufReader::new(file)).map_err(fault)?;
    let scans = reader.pointclouds();
    let (mut points, mut intensities, mut colours) = (Vec::new(), Vec::new(), Vec::new());
    // The scanner's place, and the number of its last point and one.
    let mut scanners: Vec<([f64; 3], usize)> = Vec::new();
    for scan in &scans {
        let mut simple = reader.pointcloud_simple(scan).map_err(fault)?;
        simple.intensity_to_color(false);
        for point in simple {
            let point = point.map_err(fault)?;
            let CartesianCoordinate::Valid { x, y, z } = point.cartesian else { continue };
            points.push([x, y, z]);
            intensities.push(point.intensity.unwrap_or(f32::NAN));
            let code = |value: f32| (255.0 * value).round() as u8;
            colours.push(point.color.map_or([0; 3], |c| [code(c.red), code(c.green), code(c.blue)]));
        }
        let place = scan.transform.as_ref().map(|transform| &transform.translation);
        scanners.push((place.map_or([0.0; 3], |t| [t.x, t.y, t.z]), points.len()));
    }
    let attributes = Attributes {
        reflectance: scans.iter().any(|scan| scan.has_intensity()).then_some(intensities),
        colours: scans.iter().any(|scan| scan.has_color()).then_some(colours),
        ..Attributes::default()
    };
    let (origin, positions) = localize(&points).map_err(&defective)?;
    let scanner = |i: usize| scanners[scanners.partition_point(|&(_, end)| end <= i)].0;
    splats(origin, &positions, attributes, scanner).map_err(defective)
}
