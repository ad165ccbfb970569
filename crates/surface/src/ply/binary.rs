//! Binary bodies in bulk: where all records of an element have one size, every value's place is known beforehand. The
//! file is then cut into chunks that stay in the cache, which all threads read and convert column by column.
use rayon::prelude::*;

use super::header::{Element, Header, Kind, Order, Scalar};
use super::records::{self, Records, bad_index};
use super::{Faces, Fault, Lists, Roles, Source, Vertices, attributes, colour_scale, downwards, ends_inside};
use crate::error::{Defect, Place};
use crate::mesh::{Bounds, relative, round_origin};

/// About how many bytes are read at once.
const CHUNK: usize = 1 << 18;

/// Reads the body that follows the header.
pub(super) fn read(
    source: &Source,
    order: Order,
    header: &Header,
    roles: &Roles,
    lists: Option<Lists>,
) -> Result<(Vertices, Faces), Fault> {
    let mut body = Body {
        source,
        order,
        offset: header.bytes,
        record: header.bytes,
        window: Vec::new(),
        window_start: 0,
        filled: 0,
    };
    records::read(&mut body, header, roles, lists)
}

/// A binary body and how far it has been read.
struct Body<'a> {
    source: &'a Source<'a>,
    order: Order,
    /// The next byte.
    offset: u64,
    /// The first byte of the record.
    record: u64,
    /// Bytes read ahead for single values: `filled` of them, the first at `window_start`.
    window: Vec<u8>,
    window_start: u64,
    filled: usize,
}

/// How the records of an element lie in the file if they are all alike.
struct Layout {
    /// The bytes from one record to the next.
    stride: usize,
    /// The place of each property in the record: of its value, or of the first item of its list.
    offsets: Vec<usize>,
    /// The place, the type and the value of each list's length.
    lengths: Vec<(usize, Scalar, f64)>,
}

/// `K` values of one type within each record.
#[derive(Clone, Copy)]
struct Column<const K: usize> {
    scalar: Scalar,
    order: Order,
    offsets: [usize; K],
    stride: usize,
}

impl<const K: usize> Column<K> {
    /// Calls `f` with the values of each record.
    #[inline]
    fn each(&self, bytes: &[u8], f: impl FnMut([f64; K])) {
        use Order::{Big, Little};
        match (self.scalar, self.order) {
            (Scalar::U8, _) => self.decode(bytes, |[b]| f64::from(b), f),
            (Scalar::I8, _) => self.decode(bytes, |b| f64::from(i8::from_le_bytes(b)), f),
            (Scalar::U16, Little) => self.decode(bytes, |b| f64::from(u16::from_le_bytes(b)), f),
            (Scalar::U16, Big) => self.decode(bytes, |b| f64::from(u16::from_be_bytes(b)), f),
            (Scalar::I16, Little) => self.decode(bytes, |b| f64::from(i16::from_le_bytes(b)), f),
            (Scalar::I16, Big) => self.decode(bytes, |b| f64::from(i16::from_be_bytes(b)), f),
            (Scalar::U32, Little) => self.decode(bytes, |b| f64::from(u32::from_le_bytes(b)), f),
            (Scalar::U32, Big) => self.decode(bytes, |b| f64::from(u32::from_be_bytes(b)), f),
            (Scalar::I32, Little) => self.decode(bytes, |b| f64::from(i32::from_le_bytes(b)), f),
            (Scalar::I32, Big) => self.decode(bytes, |b| f64::from(i32::from_be_bytes(b)), f),
            (Scalar::F32, Little) => self.decode(bytes, |b| f64::from(f32::from_le_bytes(b)), f),
            (Scalar::F32, Big) => self.decode(bytes, |b| f64::from(f32::from_be_bytes(b)), f),
            (Scalar::F64, Little) => self.decode(bytes, f64::from_le_bytes, f),
            (Scalar::F64, Big) => self.decode(bytes, f64::from_be_bytes, f),
        }
    }

    /// The loop itself, one for each type.
    #[inline]
    fn decode<const N: usize, T>(&self, bytes: &[u8], value: impl Fn([u8; N]) -> T, mut f: impl FnMut([T; K])) {
        for record in bytes.chunks_exact(self.stride) {
            f(self.offsets.map(|offset| {
                let mut raw = [0; N];
                raw.copy_from_slice(&record[offset..offset + N]);
                value(raw)
            }));
        }
    }

    /// Writes one output a record.
    #[inline]
    fn fill<T>(&self, bytes: &[u8], out: &mut [T], convert: impl Fn([f64; K]) -> T) {
        self.each(bytes, into(out, convert));
    }

    /// Writes integers, of which negative ones become great.
    fn fill_integers(&self, bytes: &[u8], out: &mut [[u32; K]]) {
        match (self.scalar, self.order) {
            (Scalar::I32 | Scalar::U32, Order::Little) => self.decode(bytes, u32::from_le_bytes, into(out, |t| t)),
            (Scalar::I32 | Scalar::U32, Order::Big) => self.decode(bytes, u32::from_be_bytes, into(out, |t| t)),
            _ => self.fill(bytes, out, |t| t.map(|x| x as i64 as u32)),
        }
    }
}

/// Converts what it is called with into one output after the other.
#[inline]
fn into<T, U>(out: &mut [U], convert: impl Fn(T) -> U) -> impl FnMut(T) {
    let mut out = out.iter_mut();
    move |values| {
        if let Some(out) = out.next() {
            *out = convert(values);
        }
    }
}

impl Layout {
    /// The layout of the records if all are like the first, whose lists' lengths are read from the file; `None` if
    /// the file ends before the last of them.
    fn of(body: &mut Body, element: &Element) -> Result<Option<Layout>, Fault> {
        let mut layout = Layout { stride: 0, offsets: Vec::new(), lengths: Vec::new() };
        let room = body.source.length() - body.offset;
        for property in &element.properties {
            let size = match property.kind {
                Kind::One(scalar) => scalar.size(),
                Kind::List { length, item } => {
                    if element.count == 0 || (layout.stride + length.size()) as u64 > room {
                        return Ok(None);
                    }
                    let value = body.value_at(body.offset + layout.stride as u64, length)?;
                    if !(0.0..=room as f64).contains(&value) {
                        return Ok(None);
                    }
                    layout.lengths.push((layout.stride, length, value));
                    layout.stride += length.size();
                    value as usize * item.size()
                }
            };
            layout.offsets.push(layout.stride);
            layout.stride += size;
        }
        let fits = (layout.stride as u64).checked_mul(element.count).is_some_and(|bytes| bytes <= room);
        Ok(fits.then_some(layout))
    }

    /// The column of properties of the same type, or `None` if their types differ.
    fn column<const K: usize>(&self, element: &Element, properties: [usize; K], order: Order) -> Option<Column<K>> {
        let Kind::One(scalar) = element.properties[properties[0]].kind else {
            return None;
        };
        let alike = properties.iter().all(|&i| element.properties[i].kind == Kind::One(scalar));
        let offsets = properties.map(|i| self.offsets[i]);
        alike.then_some(Column { scalar, order, offsets, stride: self.stride })
    }

    /// Whether the records in `bytes` are as the layout has them.
    fn fits(&self, bytes: &[u8], order: Order) -> bool {
        self.lengths.iter().all(|&(offset, scalar, expected)| {
            let mut same = true;
            let column = Column { scalar, order, offsets: [offset], stride: self.stride };
            column.each(bytes, |[length]| same &= length == expected);
            same
        })
    }

    /// The number of records in a chunk.
    fn chunk(&self) -> usize {
        (CHUNK / self.stride.max(1)).max(1)
    }
}

impl Body<'_> {
    /// Reads the chunks of records that `jobs` are for, each with a buffer of its thread, and gives what each came to,
    /// in their order.
    fn chunks<J: Send, T: Send>(
        &self,
        layout: &Layout,
        count: u64,
        jobs: Vec<J>,
        work: impl Fn(u64, J, &[u8]) -> T + Sync,
    ) -> Result<Vec<T>, Fault> {
        let chunk = layout.chunk() as u64;
        let run = |buffer: &mut Vec<u8>, (i, job): (usize, J)| {
            let first = i as u64 * chunk;
            let length = chunk.min(count - first) as usize * layout.stride;
            let bytes = self.source.read(self.offset + first * layout.stride as u64, length, buffer)?;
            Ok(work(first, job, bytes))
        };
        jobs.into_par_iter().enumerate().map_init(Vec::new, run).collect::<Result<_, _>>().map_err(Fault::Io)
    }

    /// The box around all vertices.
    fn bounds(&self, layout: &Layout, count: u64, column: Column<3>) -> Result<Bounds, Fault> {
        let jobs = vec![(); (count as usize).div_ceil(layout.chunk())];
        let boxes = self.chunks(layout, count, jobs, |first, (), bytes| {
            let (mut low, mut high, mut finite) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3], true);
            column.each(bytes, |p| {
                for k in 0..3 {
                    low[k] = if p[k] < low[k] { p[k] } else { low[k] };
                    high[k] = if p[k] > high[k] { p[k] } else { high[k] };
                    finite &= p[k].is_finite();
                }
            });
            if finite {
                return Ok(Bounds { low, high });
            }
            let (mut record, mut found) = (first, None);
            column.each(bytes, |p| {
                if let (None, Some(value)) = (found, p.into_iter().find(|x| !x.is_finite())) {
                    found = Some((record, value));
                }
                record += 1;
            });
            Err(found.unwrap_or((first, f64::NAN)))
        })?;
        boxes.into_iter().try_fold(Bounds::EMPTY, |all, part| part.map(|part| all.union(part))).map_err(
            |(record, value)| {
                let defect = Defect::NotFinite { vertex: record as usize, value };
                Fault::Defect(Some(Place::Byte(self.offset + record * layout.stride as u64)), defect)
            },
        )
    }

    /// The value at an offset that lies within the file.
    fn value_at(&mut self, offset: u64, scalar: Scalar) -> Result<f64, Fault> {
        let size = scalar.size();
        let within = |window_start: u64, filled: usize| {
            offset >= window_start && offset + size as u64 <= window_start + filled as u64
        };
        if !within(self.window_start, self.filled) {
            self.filled = (self.source.length() - offset).min(CHUNK as u64) as usize;
            self.window_start = offset;
            self.source.read(offset, self.filled, &mut self.window).map_err(Fault::Io)?;
        }
        let start = (offset - self.window_start) as usize;
        let column = Column { scalar, order: self.order, offsets: [0], stride: size };
        let mut result = f64::NAN;
        column.each(&self.window[start..start + size], |[value]| result = value);
        Ok(result)
    }
}

impl Records for Body<'_> {
    fn begin(&mut self, element: &Element, record: u64) -> Result<(), Fault> {
        self.record = self.offset;
        let length = self.source.length();
        if self.offset + element.least_size() as u64 > length {
            return Err(ends_inside(element, record, Place::Byte(length)));
        }
        Ok(())
    }

    fn next(&mut self, scalar: Scalar) -> Result<f64, Fault> {
        let length = self.source.length();
        if self.offset + scalar.size() as u64 > length {
            let cause = "the file ends inside a list; it is cut short or damaged";
            return Err(Fault::Syntax(Place::Byte(length), cause.into()));
        }
        let value = self.value_at(self.offset, scalar)?;
        self.offset += scalar.size() as u64;
        Ok(value)
    }

    fn end(&mut self) -> Result<(), Fault> {
        Ok(())
    }

    fn place(&self) -> Place {
        Place::Byte(self.record)
    }

    fn bulk_vertices(&mut self, element: &Element, roles: &Roles) -> Result<Option<Vertices>, Fault> {
        let Some(layout) = Layout::of(self, element)? else {
            return Ok(None);
        };
        if !layout.lengths.is_empty() {
            return Ok(None);
        }
        let three = |properties: Option<[usize; 3]>| match properties {
            Some(properties) => layout.column(element, properties, self.order).map(Some),
            None => Some(None),
        };
        let one = |role: Option<usize>| role.and_then(|property| layout.column(element, [property], self.order));
        let one = roles.scalars.map(one);
        let texture = match roles.texture.map(|properties| layout.column(element, properties, self.order)) {
            Some(None) => return Ok(None),
            column => column.flatten(),
        };
        let (Some(Some(position)), Some(normal), Some(colour)) =
            (three(Some(roles.position)), three(roles.normal), three(roles.colour))
        else {
            return Ok(None);
        };
        let count = element.count as usize;
        let origin = round_origin(&self.bounds(&layout, element.count, position)?)?;
        let mut positions = vec![[0.0; 3]; count];
        let mut normals = normal.map(|_| vec![[0.0; 3]; count]);
        let mut scalars = one.map(|column| column.map(|_| vec![0.0; count]));
        let mut colours = colour.map(|_| vec![[0; 3]; count]);
        let mut uvs = texture.map(|_| vec![[0.0; 2]; count]);
        let chunk = layout.chunk();
        let jobs: Vec<_> = {
            let mut normals = normals.as_mut().map(|v| v.chunks_mut(chunk));
            let mut scalars = scalars.each_mut().map(|scalar| scalar.as_mut().map(|v| v.chunks_mut(chunk)));
            let mut colours = colours.as_mut().map(|v| v.chunks_mut(chunk));
            let mut uvs = uvs.as_mut().map(|v| v.chunks_mut(chunk));
            let job = |positions| {
                let normals = normals.as_mut().and_then(Iterator::next);
                let scalars = scalars.each_mut().map(|scalar| scalar.as_mut().and_then(Iterator::next));
                let colours = colours.as_mut().and_then(Iterator::next);
                (positions, normals, scalars, colours, uvs.as_mut().and_then(Iterator::next))
            };
            positions.chunks_mut(chunk).map(job).collect()
        };
        self.chunks(&layout, element.count, jobs, |_, (positions, normals, scalars, colours, uvs), bytes| {
            position.fill(bytes, positions, |p| relative(p, &origin));
            if let (Some(column), Some(out)) = (texture, uvs) {
                column.fill(bytes, out, downwards);
            }
            if let (Some(column), Some(out)) = (normal, normals) {
                column.fill(bytes, out, |n| n.map(|x| x as f32));
            }
            for (column, out) in one.into_iter().zip(scalars) {
                if let (Some(column), Some(out)) = (column, out) {
                    column.fill(bytes, out, |[value]| value as f32);
                }
            }
            if let (Some(column), Some(out)) = (colour, colours) {
                let scale = colour_scale(column.scalar);
                column.fill(bytes, out, |c| c.map(|x| (x * scale).round() as u8));
            }
        })?;
        self.offset += layout.stride as u64 * element.count;
        Ok(Some(Vertices { origin, positions, attributes: attributes(normals, scalars, colours), uvs }))
    }

    fn bulk_faces(&mut self, element: &Element, lists: Lists, vertices: u64) -> Result<Option<Faces>, Fault> {
        let Some(layout) = Layout::of(self, element)? else {
            return Ok(None);
        };
        // The column of a list that has this many items in all records.
        let column = |property: usize, count: f64| {
            let before = element.properties[..property].iter().filter(|p| matches!(p.kind, Kind::List { .. })).count();
            match element.properties[property].kind {
                Kind::List { item, .. } if layout.lengths[before].2 == count => Some((item, layout.offsets[property])),
                _ => None,
            }
        };
        let Some((scalar, first)) = column(lists.corners, 3.0) else {
            return Ok(None);
        };
        let size = scalar.size();
        let offsets = [first, first + size, first + 2 * size];
        let texture = match lists.texture.map(|property| column(property, 6.0)) {
            Some(None) => return Ok(None),
            column => column.flatten().map(|(scalar, first)| Column {
                scalar,
                order: self.order,
                offsets: [0, 1, 2, 3, 4, 5].map(|k| first + k * scalar.size()),
                stride: layout.stride,
            }),
        };
        let column = Column { scalar, order: self.order, offsets, stride: layout.stride };
        let mut triangles = vec![[0u32; 3]; element.count as usize];
        let mut uvs = texture.map(|_| vec![[[0.0; 2]; 3]; element.count as usize]);
        let jobs: Vec<_> = {
            let mut uvs = uvs.as_mut().map(|uvs| uvs.chunks_mut(layout.chunk()));
            triangles.chunks_mut(layout.chunk()).map(|out| (out, uvs.as_mut().and_then(Iterator::next))).collect()
        };
        let greatest = self.chunks(&layout, element.count, jobs, |start, (out, uvs), bytes| {
            if !layout.fits(bytes, self.order) {
                return None;
            }
            if let (Some(column), Some(uvs)) = (texture, uvs) {
                column.fill(bytes, uvs, |[a, b, c, d, e, f]| [[a, b], [c, d], [e, f]].map(downwards));
            }
            // A negative index becomes a great one and is out of range like it.
            column.fill_integers(bytes, out);
            let greatest = out.as_flattened().iter().fold(0, |m, &i| m.max(i));
            Some((start, greatest))
        })?;
        for part in greatest {
            match part {
                None => return Ok(None),
                Some((_, greatest)) if u64::from(greatest) < vertices => {}
                Some((start, _)) => {
                    let bad = |t: &[u32; 3]| t.iter().any(|&i| u64::from(i) >= vertices);
                    let face = start + triangles[start as usize..].iter().position(bad).unwrap_or(0) as u64;
                    let place = self.offset + face * layout.stride as u64;
                    let corner = triangles[face as usize].iter().position(|&i| u64::from(i) >= vertices).unwrap_or(0);
                    let value = self.value_at(place + offsets[corner] as u64, scalar)?;
                    return Err(bad_index(Place::Byte(place), face, value, vertices));
                }
            }
        }
        self.offset += layout.stride as u64 * element.count;
        Ok(Some(Faces { triangles, uvs }))
    }

    fn bulk_skip(&mut self, element: &Element) -> Result<bool, Fault> {
        let fixed = element.properties.iter().all(|p| matches!(p.kind, Kind::One(_)));
        let bytes = (element.least_size() as u64).saturating_mul(element.count);
        let fits = bytes <= self.source.length() - self.offset;
        if fixed && fits {
            self.offset += bytes;
        }
        Ok(fixed && fits)
    }
}
