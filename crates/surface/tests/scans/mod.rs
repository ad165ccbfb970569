//! Scans written by the formats' own libraries.
use std::io::Cursor;

use e57::{E57Writer, Record, RecordValue, Transform};
use las::point::Format;
use las::{Builder, Color, Point, Writer};

/// A point with what a scanner knows of it.
#[derive(Clone, Copy)]
pub(crate) struct ScanPoint {
    pub(crate) place: [f64; 3],
    pub(crate) intensity: u16,
    pub(crate) colour: [u8; 3],
}

impl ScanPoint {
    /// Point `i` of a grid of half-metre squares, so many a row, every one different.
    pub(crate) fn grid(i: usize, row: usize) -> ScanPoint {
        let place = [0.5 * (i % row) as f64, 0.5 * (i / row) as f64, 0.25 * (i % 3) as f64];
        ScanPoint { place, intensity: 100 + 7 * i as u16, colour: [i as u8, 200, 255 - i as u8] }
    }
}

/// A LAS or LAZ file with millimetres and colours of 16 bits.
pub(crate) fn las(points: &[ScanPoint], compressed: bool) -> Vec<u8> {
    let mut builder = Builder::from((1, 4));
    builder.point_format = Format::new(7).expect("a point format");
    builder.point_format.is_compressed = compressed;
    for axis in [&mut builder.transforms.x, &mut builder.transforms.y, &mut builder.transforms.z] {
        axis.scale = 0.001;
    }
    let first = points.first().map_or([0.0; 3], |p| p.place);
    (builder.transforms.x.offset, builder.transforms.y.offset) = (first[0].floor(), first[1].floor());
    let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header().expect("a header")).expect("a writer");
    for point in points {
        let [x, y, z] = point.place;
        let [red, green, blue] = point.colour.map(|c| u16::from(c) << 8);
        let color = Some(Color { red, green, blue });
        let point = Point { x, y, z, intensity: point.intensity, color, gps_time: Some(0.0), ..Point::default() };
        writer.write_point(point).expect("a point");
    }
    writer.into_inner().expect("a file").into_inner()
}

/// An E57 file of one scan whose scanner stands at a place.
pub(crate) fn e57(points: &[ScanPoint], scanner: [f64; 3]) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut file, "file").expect("a writer");
    let prototype = vec![
        Record::CARTESIAN_X_F64,
        Record::CARTESIAN_Y_F64,
        Record::CARTESIAN_Z_F64,
        Record::INTENSITY_U16,
        Record::COLOR_RED_U8,
        Record::COLOR_GREEN_U8,
        Record::COLOR_BLUE_U8,
    ];
    let mut scan = writer.add_pointcloud("scan", prototype).expect("a scan");
    let mut transform = Transform::default();
    (transform.translation.x, transform.translation.y, transform.translation.z) = scanner.into();
    scan.set_transform(Some(transform));
    for point in points {
        let place = (0..3).map(|k| RecordValue::Double(point.place[k] - scanner[k]));
        let others = [i64::from(point.intensity)].into_iter().chain(point.colour.map(i64::from));
        scan.add_point(place.chain(others.map(RecordValue::Integer)).collect()).expect("a point");
    }
    scan.finalize().expect("the end of the scan");
    writer.finalize().expect("the end of the file");
    drop(writer);
    file.into_inner()
}
