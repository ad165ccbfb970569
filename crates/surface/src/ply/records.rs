//! Any PLY body, text or binary, value by value.
use super::header::{Element, Header, Kind, Scalar, shorten};
use super::{Faces, Fault, Lists, Roles, Source, Vertices, attributes, colour_scale, downwards, ends_inside};
use crate::error::{Defect, Place};
use crate::mesh::localize;

/// A stream of records of values.
pub(super) trait Records {
    /// Goes to the next record; the file must not have ended.
    fn begin(&mut self, element: &Element, record: u64) -> Result<(), Fault>;

    /// The next value of the record.
    fn next(&mut self, scalar: Scalar) -> Result<f64, Fault>;

    /// Makes sure that the record has no more values.
    fn end(&mut self) -> Result<(), Fault>;

    /// Where in the file the record is.
    fn place(&self) -> Place;

    /// All vertices at once, if their layout allows it.
    fn bulk_vertices(&mut self, _: &Element, _: &Roles) -> Result<Option<Vertices>, Fault> {
        Ok(None)
    }

    /// All faces at once, as triangles, if their layout allows it.
    fn bulk_faces(&mut self, _: &Element, _: Lists, _vertices: u64) -> Result<Option<Faces>, Fault> {
        Ok(None)
    }

    /// Goes past an element at once, if its layout allows it.
    fn bulk_skip(&mut self, _: &Element) -> Result<bool, Fault> {
        Ok(false)
    }
}

/// Reads the elements in their order until vertices and faces are there; without `lists`, there are no faces.
pub(super) fn read(
    records: &mut impl Records,
    header: &Header,
    roles: &Roles,
    lists: Option<Lists>,
) -> Result<(Vertices, Faces), Fault> {
    let count = header.element("vertex").map_or(0, |vertex| vertex.count);
    let (mut vertices, mut faces) = (None, None);
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" if vertices.is_none() => {
                vertices = match records.bulk_vertices(element, roles)? {
                    None => Some(self::vertices(records, element, roles)?),
                    bulk => bulk,
                };
            }
            "face"
                if faces.is_none()
                    && let Some(lists) = lists =>
            {
                faces = match records.bulk_faces(element, lists, count)? {
                    None => Some(self::faces(records, element, lists, count)?),
                    bulk => bulk,
                };
            }
            _ if records.bulk_skip(element)? => {}
            _ => skip(records, element)?,
        }
        if vertices.is_some() && (faces.is_some() || lists.is_none()) {
            break;
        }
    }
    Ok((vertices.unwrap_or_default(), faces.unwrap_or_default()))
}

/// The vertices, record by record.
fn vertices(records: &mut impl Records, element: &Element, roles: &Roles) -> Result<Vertices, Fault> {
    let mut points: Vec<[f64; 3]> = Vec::new();
    let mut normals = roles.normal.map(|_| Vec::new());
    let mut scalars = roles.scalars.map(|scalar| scalar.map(|_| Vec::new()));
    let mut colours = roles.colour.map(|_| Vec::new());
    let mut uvs = roles.texture.map(|_| Vec::new());
    let scale = roles.colour.map_or(1.0, |[red, ..]| match element.properties[red].kind {
        Kind::One(scalar) | Kind::List { item: scalar, .. } => colour_scale(scalar),
    });
    let mut values = vec![0.0; element.properties.len()];
    for record in 0..element.count {
        records.begin(element, record)?;
        for (value, property) in values.iter_mut().zip(&element.properties) {
            match property.kind {
                Kind::One(scalar) => *value = records.next(scalar)?,
                Kind::List { length, item } => {
                    for _ in 0..list_length(records, length)? {
                        records.next(item)?;
                    }
                }
            }
        }
        let point = roles.position.map(|i| values[i]);
        if let Some(&value) = point.iter().find(|x| !x.is_finite()) {
            let defect = Defect::NotFinite { vertex: record as usize, value };
            return Err(Fault::Defect(Some(records.place()), defect));
        }
        points.push(point);
        if let (Some(normals), Some(normal)) = (&mut normals, roles.normal) {
            normals.push(normal.map(|i| values[i] as f32));
        }
        for (scalars, role) in scalars.iter_mut().zip(roles.scalars) {
            if let (Some(scalars), Some(i)) = (scalars, role) {
                scalars.push(values[i] as f32);
            }
        }
        if let (Some(colours), Some(colour)) = (&mut colours, roles.colour) {
            colours.push(colour.map(|i| (values[i] * scale).round() as u8));
        }
        if let (Some(uvs), Some(texture)) = (&mut uvs, roles.texture) {
            uvs.push(downwards(texture.map(|i| values[i])));
        }
        records.end()?;
    }
    let (origin, positions) = localize(&points)?;
    Ok(Vertices { origin, positions, attributes: attributes(normals, scalars, colours), uvs })
}

/// The faces as fans of triangles, record by record. Faces of fewer than three corners are skipped.
fn faces(records: &mut impl Records, element: &Element, lists: Lists, vertices: u64) -> Result<Faces, Fault> {
    let mut faces = Faces { triangles: Vec::new(), uvs: lists.texture.map(|_| Vec::new()) };
    let (mut corners, mut texture): (Vec<u32>, Vec<f64>) = (Vec::new(), Vec::new());
    for record in 0..element.count {
        records.begin(element, record)?;
        corners.clear();
        texture.clear();
        for (i, property) in element.properties.iter().enumerate() {
            let (length, item) = match property.kind {
                Kind::One(scalar) => (1, scalar),
                Kind::List { length, item } => (list_length(records, length)?, item),
            };
            for _ in 0..length {
                let value = records.next(item)?;
                if i == lists.corners {
                    if value.fract() != 0.0 || !(0.0..vertices as f64).contains(&value) {
                        return Err(bad_index(records.place(), record, value, vertices));
                    }
                    corners.push(value as u32);
                } else if Some(i) == lists.texture {
                    texture.push(value);
                }
            }
        }
        for k in 2..corners.len() {
            let fan = [0, k - 1, k];
            faces.triangles.push(fan.map(|k| corners[k]));
            if let Some(uvs) = &mut faces.uvs {
                // A face without them has none that is a number.
                let at = |i: usize| texture.get(i).copied().unwrap_or(f64::NAN);
                uvs.push(fan.map(|k| downwards([at(2 * k), at(2 * k + 1)])));
            }
        }
        records.end()?;
    }
    Ok(faces)
}

/// What to say of a corner that is no vertex.
pub(super) fn bad_index(place: Place, face: u64, value: f64, vertices: u64) -> Fault {
    if value.fract() == 0.0 {
        let (face, index, vertices) = (face as usize, value as i64, vertices as usize);
        Fault::Defect(Some(place), Defect::IndexOutOfRange { face, index, vertices })
    } else {
        Fault::Syntax(place, format!("{value} is no vertex number"))
    }
}

fn skip(records: &mut impl Records, element: &Element) -> Result<(), Fault> {
    for record in 0..element.count {
        if element.properties.is_empty() {
            break;
        }
        records.begin(element, record)?;
        for property in &element.properties {
            let (length, item) = match property.kind {
                Kind::One(scalar) => (1, scalar),
                Kind::List { length, item } => (list_length(records, length)?, item),
            };
            for _ in 0..length {
                records.next(item)?;
            }
        }
        records.end()?;
    }
    Ok(())
}

fn list_length(records: &mut impl Records, scalar: Scalar) -> Result<u64, Fault> {
    let length = records.next(scalar)?;
    if length.fract() != 0.0 || !(0.0..=f64::from(u32::MAX)).contains(&length) {
        return Err(Fault::Syntax(records.place(), format!("{length} is no length of a list")));
    }
    Ok(length as u64)
}

/// The words of a text body, a line a record; blank lines are skipped.
pub(super) struct Words {
    text: Vec<u8>,
    /// What is left of the record's line is `at..end`, and the next line begins at `next`.
    at: usize,
    end: usize,
    next: usize,
    line: u64,
}

impl Words {
    /// The body of a file with this header.
    pub(super) fn new(source: &Source, header: &Header) -> Result<Words, Fault> {
        let mut text = Vec::new();
        let length = (source.length() - header.bytes) as usize;
        source.read(header.bytes, length, &mut text).map_err(Fault::Io)?;
        Ok(Words { text, at: 0, end: 0, next: 0, line: header.lines })
    }

    /// The next word of the line.
    fn word(&mut self) -> Option<&[u8]> {
        let rest = &self.text[self.at..self.end];
        let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len() - start);
        self.at += start + length;
        Some(&rest[start..start + length])
    }
}

impl Records for Words {
    fn begin(&mut self, element: &Element, record: u64) -> Result<(), Fault> {
        loop {
            let rest = self.text.get(self.next..).unwrap_or_default();
            if rest.is_empty() {
                return Err(ends_inside(element, record, Place::Line(self.line)));
            }
            self.at = self.next;
            self.end = self.at + rest.iter().position(|&b| b == b'\n').unwrap_or(rest.len());
            self.next = self.end + 1;
            self.line += 1;
            if self.text[self.at..self.end].iter().any(|b| !b.is_ascii_whitespace()) {
                return Ok(());
            }
        }
    }

    fn next(&mut self, _: Scalar) -> Result<f64, Fault> {
        let place = self.place();
        let Some(word) = self.word() else {
            let cause = "the line has fewer values than the header declares; the file is cut short or damaged";
            return Err(Fault::Syntax(place, cause.into()));
        };
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        number.ok_or_else(|| {
            Fault::Syntax(place, format!("\"{}\" is no number", shorten(&String::from_utf8_lossy(word))))
        })
    }

    fn end(&mut self) -> Result<(), Fault> {
        match self.word() {
            None => Ok(()),
            Some(_) => Err(Fault::Syntax(self.place(), "the line has more values than the header declares".into())),
        }
    }

    fn place(&self) -> Place {
        Place::Line(self.line)
    }
}
