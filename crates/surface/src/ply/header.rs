//! The header: encoding, elements and their properties.
use super::{Fault, Lists, Source};
use crate::error::Place;

/// Headers longer than this are refused.
const LONGEST: u64 = 1 << 20;

/// How the values are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Binary(Order),
}

/// The byte order of binary values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Order {
    Little,
    Big,
}

/// The type of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn named(name: &str) -> Option<Scalar> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// The number of bytes of a binary value.
    pub(super) fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    fn is_integer(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

/// One value a record, or a list: its length and that many values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    One(Scalar),
    List { length: Scalar, item: Scalar },
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The properties that list a face's corners.
    pub(super) fn lists(&self, header: &Header) -> Result<Lists, Fault> {
        let list =
            |name: &str| self.properties.iter().position(|p| p.name == name && matches!(p.kind, Kind::List { .. }));
        let found = list("vertex_indices").or_else(|| list("vertex_index"));
        let fault = |cause: &str| Fault::Syntax(header.end(), cause.into());
        let corners = found.ok_or_else(|| fault("the header declares no list vertex_indices for the faces"))?;
        match self.properties[corners].kind {
            Kind::List { item, .. } if item.is_integer() => Ok(Lists { corners, texture: list("texcoord") }),
            _ => Err(fault("the faces' vertex_indices are not integers")),
        }
    }

    /// The least number of bytes of a binary record: lists are empty.
    pub(super) fn least_size(&self) -> usize {
        let size = |p: &Property| match p.kind {
            Kind::One(scalar) => scalar.size(),
            Kind::List { length, .. } => length.size(),
        };
        self.properties.iter().map(size).sum()
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Its length in bytes, with the end of the last line.
    pub(super) bytes: u64,
    /// The number of its lines.
    pub(super) lines: u64,
}

impl Header {
    pub(super) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }

    /// The last line of the header, which is to blame for what it lacks.
    pub(super) fn end(&self) -> Place {
        Place::Line(self.lines)
    }
}

/// Reads the header and checks that the counts it declares can fit the file.
pub(super) fn read(source: &Source) -> Result<Header, Fault> {
    let mut buffer = Vec::new();
    let text = source.read(0, source.length().min(LONGEST) as usize, &mut buffer).map_err(Fault::Io)?;
    let header = parse(text)?;
    for element in &header.elements {
        let (name, count) = (&element.name, element.count);
        // A text record has at least a character and a separator a value, a list at least its length.
        let least = match header.encoding {
            Encoding::Ascii => 2 * element.properties.len(),
            Encoding::Binary(_) => element.least_size(),
        };
        let room = source.length() - header.bytes + 1;
        if least > 0 && count > room / least as u64 {
            let cause = format!(
                "{count} {name} records are declared, but the {} bytes of the file's body cannot hold them; \
                 it is cut short or damaged",
                room - 1
            );
            return Err(Fault::Syntax(Place::Byte(source.length()), cause));
        }
    }
    Ok(header)
}

fn parse(text: &[u8]) -> Result<Header, Fault> {
    let mut header = Header { encoding: Encoding::Ascii, elements: Vec::new(), bytes: 0, lines: 0 };
    let mut encoding = None;
    loop {
        let rest = &text[header.bytes as usize..];
        header.lines += 1;
        let fault = |cause: String| Fault::Syntax(Place::Line(header.lines), cause);
        let Some(length) = rest.iter().position(|&b| b == b'\n' || b == b'\r') else {
            return Err(fault("the header has no end_header line".into()));
        };
        let end_of_line = if rest[length..].starts_with(b"\r\n") { 2 } else { 1 };
        header.bytes += (length + end_of_line) as u64;
        let line = String::from_utf8_lossy(&rest[..length]);
        let words: Vec<&str> = line.split_ascii_whitespace().collect();
        match words[..] {
            ["ply"] if header.lines == 1 => {}
            [] | ["comment" | "obj_info", ..] => {}
            ["format", name, _version] => {
                encoding = Some(match name {
                    "ascii" => Encoding::Ascii,
                    "binary_little_endian" => Encoding::Binary(Order::Little),
                    "binary_big_endian" => Encoding::Binary(Order::Big),
                    _ => return Err(fault(format!("unknown format \"{name}\""))),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| fault(format!("\"{count}\" is no count of {name} elements")))?;
                header.elements.push(Element { name: name.into(), count, properties: Vec::new() });
            }
            ["property", ref property @ ..] => {
                let property = match *property {
                    [kind, name] => Scalar::named(kind).map(|scalar| (name, Kind::One(scalar))),
                    ["list", length, item, name] => match (Scalar::named(length), Scalar::named(item)) {
                        (Some(length), Some(item)) if length.is_integer() => Some((name, Kind::List { length, item })),
                        _ => None,
                    },
                    _ => None,
                };
                let Some((name, kind)) = property else {
                    return Err(fault(format!("\"{line}\" declares no property of a known type")));
                };
                let Some(element) = header.elements.last_mut() else {
                    return Err(fault("a property before the first element".into()));
                };
                element.properties.push(Property { name: name.into(), kind });
            }
            ["end_header"] => {
                header.encoding = encoding.ok_or_else(|| fault("the header names no format".into()))?;
                return Ok(header);
            }
            _ => {
                return Err(fault(format!("\"{}\" is no line of a PLY header", shorten(&line))));
            }
        }
    }
}

/// The beginning of a text that may be long, for a message.
pub(super) fn shorten(text: &str) -> String {
    let short: String = text.chars().take(40).map(|c| if c.is_control() { '?' } else { c }).collect();
    if text.chars().nth(40).is_some() { short + "…" } else { short }
}
