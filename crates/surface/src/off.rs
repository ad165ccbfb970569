//! OFF files (Geomview's object file format), text: `OFF`, the numbers of vertices, faces and edges, then a line each. Colours and
//! normals (`COFF`, `NOFF`) are read past.
use std::path::Path;

use crate::error::{Error, Place};
use crate::mesh::{Attributes, Mesh};

pub(crate) fn read(bytes: &[u8], path: &Path) -> Result<Mesh, Error> {
    let text = String::from_utf8_lossy(bytes);
    let fail =
        |line: usize, cause: String| Error::Syntax { path: path.to_owned(), place: Place::Line(line as u64), cause };
    let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.split('#').next().unwrap_or_default().trim()));
    let mut lines = lines.filter(|(_, line)| !line.is_empty());
    let (first, header) = lines.next().unwrap_or((1, ""));
    if !matches!(header.split_whitespace().next(), Some("OFF" | "COFF" | "NOFF" | "CNOFF" | "STOFF")) {
        return Err(fail(first, "an OFF file begins with 'OFF'".into()));
    }
    // The numbers may stand on the line of the header.
    let rest = header.split_once(char::is_whitespace).map(|(_, rest)| rest.trim());
    let (number, counts) = rest.map(|rest| (first, rest)).or_else(|| lines.next()).unwrap_or((first, ""));
    let counts: Vec<usize> = counts.split_whitespace().map_while(|word| word.parse().ok()).collect();
    let [vertices, faces, ..] = counts[..] else {
        return Err(fail(number, "the numbers of vertices and faces are missing".into()));
    };
    let mut points = Vec::new();
    let mut last = number;
    let mut next = |what: &str, last: &mut usize| {
        let line =
            lines.next().ok_or_else(|| fail(*last, format!("the file ends before all of its {what} are there")))?;
        *last = line.0;
        Ok(line)
    };
    for _ in 0..vertices {
        let (line, text) = next("vertices", &mut last)?;
        let numbers: Vec<f64> = text.split_whitespace().map_while(|word| word.parse().ok()).take(3).collect();
        let point = <[f64; 3]>::try_from(numbers).ok().filter(|point| point.iter().all(|x| x.is_finite()));
        points.push(point.ok_or_else(|| fail(line, "a vertex needs three finite coordinates".into()))?);
    }
    let mut triangles = Vec::new();
    for _ in 0..faces {
        let (line, text) = next("faces", &mut last)?;
        let numbers: Vec<usize> = text.split_whitespace().map_while(|word| word.parse().ok()).collect();
        let corners = numbers.first().and_then(|&count| numbers.get(1..=count));
        let corners =
            corners.ok_or_else(|| fail(line, "a face needs its number of corners and as many vertices".into()))?;
        if let Some(corner) = corners.iter().find(|&&corner| corner >= vertices) {
            return Err(fail(line, format!("the face names vertex {corner}, but there are only {vertices}")));
        }
        let corner = |i: usize| corners[i] as u32;
        triangles.extend((2..corners.len()).map(|i| [corner(0), corner(i - 1), corner(i)]));
    }
    Mesh::new(&points, triangles, Attributes::default()).map_err(|defect| Error::Defect {
        path: path.to_owned(),
        place: None,
        defect,
    })
}
