//! Vertices of PLY files, ASCII and binary.
//!
//! `ply-rs` parses the header ([`header`]); the data are decoded here, because its element readers
//! build a map for each vertex (1 s and 1 GB for a million points, where a plain decode takes some
//! 20 ms) and refuse spellings of numbers that are in use.

mod header;

use ply_rs::ply::{ElementDef, Encoding, PropertyType, ScalarType};

use super::binary::{self, ByteOrder, Field, Scalar};
use super::collector::Collector;
use super::columns::Columns;
use super::text::{Line, Lines};
use super::{Error, Limits};

/// Fewest bytes of a value in text: a digit and what parts it from the next.
const SHORTEST_VALUE: usize = 2;

/// A property of an element.
#[derive(Debug, Clone, Copy)]
enum Property {
    Scalar(Scalar),
    /// The types of the length and of the items.
    List(Scalar, Scalar),
}

/// An element of the header.
struct Element<'a> {
    name: &'a str,
    count: usize,
    properties: Vec<Property>,
}

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let header = header::read(bytes)?;
    let body = &bytes[header.bytes..];
    let definitions = &header.definition.elements;
    let vertex = definitions.get("vertex");
    let columns = vertex.and_then(vertex_columns).ok_or_else(|| {
        let detail = "the file has no element \"vertex\" with properties x, y and z";
        Error::NoCoordinates(detail.to_owned())
    })?;
    let elements = definitions
        .values()
        .map(element)
        .collect::<Result<Vec<_>, _>>()?;
    let mut collector = columns.collector(limits);
    match header.definition.encoding {
        Encoding::Ascii => {
            let lines = Lines::new(body, header.lines);
            ascii(lines, body.len(), &elements, &columns, &mut collector)?;
        }
        Encoding::BinaryLittleEndian => {
            let file = Binary::new(body, ByteOrder::Little);
            file.read(&elements, &columns, &mut collector)?;
        }
        Encoding::BinaryBigEndian => {
            let file = Binary::new(body, ByteOrder::Big);
            file.read(&elements, &columns, &mut collector)?;
        }
    }
    Ok(collector)
}

/// The columns of a vertex; lists are none that could be used.
fn vertex_columns(vertex: &ElementDef) -> Option<Columns> {
    Columns::named(
        vertex
            .properties
            .values()
            .map(|property| match property.data_type {
                PropertyType::Scalar(_) => property.name.as_bytes(),
                PropertyType::List(..) => b"".as_slice(),
            }),
    )
}

fn element(definition: &ElementDef) -> Result<Element<'_>, Error> {
    let property = |data_type: &PropertyType| match data_type {
        PropertyType::Scalar(of) => Some(Property::Scalar(scalar(of))),
        PropertyType::List(length, of) => {
            let length = scalar(length);
            length
                .is_integer()
                .then(|| Property::List(length, scalar(of)))
        }
    };
    let types = definition.properties.values().map(|p| &p.data_type);
    let properties: Option<_> = types.map(property).collect();
    Ok(Element {
        name: &definition.name,
        count: definition.count,
        properties: properties.ok_or_else(|| Error::Header {
            line: 0,
            detail: "the length of a list must be an integer".to_owned(),
        })?,
    })
}

fn scalar(of: &ScalarType) -> Scalar {
    match of {
        ScalarType::Char => Scalar::I8,
        ScalarType::UChar => Scalar::U8,
        ScalarType::Short => Scalar::I16,
        ScalarType::UShort => Scalar::U16,
        ScalarType::Int => Scalar::I32,
        ScalarType::UInt => Scalar::U32,
        ScalarType::Float => Scalar::F32,
        ScalarType::Double => Scalar::F64,
    }
}

impl Element<'_> {
    /// Bytes of one record; `None` if lists make them vary.
    fn record_bytes(&self) -> Option<usize> {
        let size = |property: &Property| match property {
            Property::Scalar(scalar) => Some(scalar.size()),
            Property::List(..) => None,
        };
        self.properties.iter().map(size).sum()
    }

    fn truncated(&self, found: usize) -> Error {
        Error::Truncated {
            what: format!("element {}", super::text::excerpt(self.name.as_bytes())),
            declared: self.count as u64,
            found: found as u64,
        }
    }
}

/// Text: one line a record, blank lines aside.
fn ascii(
    lines: Lines<'_>,
    bytes: usize,
    elements: &[Element<'_>],
    columns: &Columns,
    collector: &mut Collector<'_>,
) -> Result<(), Error> {
    let mut lines = lines.filter(|line| !line.bytes.is_empty());
    for element in elements {
        let mut records = lines.by_ref().take(element.count);
        let found = if element.name == "vertex" {
            let possible = bytes / (SHORTEST_VALUE * element.properties.len()) + 1;
            collector.reserve(element.count.min(possible))?;
            if element.record_bytes().is_some() {
                columns.collect(records, collector)? as usize
            } else {
                records.try_fold(0, |found, line| {
                    collector.push(&row_with_lists(line, element, columns)?, line.number)?;
                    Ok(found + 1)
                })?
            }
        } else {
            records.count()
        };
        if found < element.count {
            return Err(element.truncated(found));
        }
    }
    Ok(())
}

fn row_with_lists(
    line: Line<'_>,
    element: &Element<'_>,
    columns: &Columns,
) -> Result<super::collector::Row, Error> {
    let mut row = [0.0; 7];
    let mut tokens = line.tokens();
    for (column, property) in element.properties.iter().enumerate() {
        let token = tokens
            .next()
            .ok_or_else(|| line.error("expected more values"))?;
        let value = line.number(token)?;
        if let Property::List(..) = property {
            let length = list_length(value, line.number)?;
            if length > 0 && tokens.nth(length - 1).is_none() {
                return Err(line.error(format!("expected a list of {length} values")));
            }
        } else if let Some(slot) = columns.slot(column) {
            row[slot] = value;
        }
    }
    Ok(row)
}

fn list_length(value: f64, line: usize) -> Result<usize, Error> {
    if value >= 0.0 {
        return Ok(value as usize);
    }
    let detail = format!("{value} is not the length of a list");
    Err(Error::Row { line, detail })
}

/// A binary body that is read from its start.
struct Binary<'a> {
    bytes: &'a [u8],
    order: ByteOrder,
}

impl<'a> Binary<'a> {
    fn new(bytes: &'a [u8], order: ByteOrder) -> Self {
        Self { bytes, order }
    }

    fn read(
        mut self,
        elements: &[Element<'_>],
        columns: &Columns,
        collector: &mut Collector<'_>,
    ) -> Result<(), Error> {
        for element in elements {
            let is_vertex = element.name == "vertex";
            if let Some(size) = element.record_bytes() {
                let left = self.bytes.len() / size;
                if left < element.count {
                    return Err(element.truncated(left));
                }
                let (records, rest) = self.bytes.split_at(element.count * size);
                if is_vertex {
                    let fields = self.fields(element, columns);
                    binary::collect(records, &fields, element.count, collector)?;
                }
                self.bytes = rest;
                continue;
            }
            for i in 0..element.count {
                let row = self.record(element, columns, i)?;
                if is_vertex {
                    collector.push(&row, i + 1)?;
                }
            }
        }
        Ok(())
    }

    /// Where the values of the columns lie in records of one size.
    fn fields(&self, element: &Element<'_>, columns: &Columns) -> Vec<Field> {
        let mut fields = Vec::new();
        let mut start = 0;
        let stride = element.record_bytes().unwrap_or_default();
        for (column, property) in element.properties.iter().enumerate() {
            if let Property::Scalar(scalar) = *property {
                fields.extend(columns.slot(column).map(|slot| Field {
                    slot,
                    scalar,
                    order: self.order,
                    start,
                    stride,
                }));
                start += scalar.size();
            }
        }
        fields
    }

    /// Record `i` of an element with lists.
    fn record(
        &mut self,
        element: &Element<'_>,
        columns: &Columns,
        i: usize,
    ) -> Result<super::collector::Row, Error> {
        let mut row = [0.0; 7];
        for (column, property) in element.properties.iter().enumerate() {
            match *property {
                Property::Scalar(scalar) => {
                    let value = self.next(scalar).ok_or_else(|| element.truncated(i))?;
                    // Of elements other than the vertices the caller drops the row.
                    if let Some(slot) = columns.slot(column) {
                        row[slot] = value;
                    }
                }
                Property::List(length, item) => {
                    let value = self.next(length).ok_or_else(|| element.truncated(i))?;
                    let bytes = list_length(value, i + 1)?.checked_mul(item.size());
                    let rest = bytes.and_then(|bytes| self.bytes.get(bytes..));
                    self.bytes = rest.ok_or_else(|| element.truncated(i))?;
                }
            }
        }
        Ok(row)
    }

    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        let value = scalar.read(self.order, self.bytes)?;
        self.bytes = &self.bytes[scalar.size()..];
        Some(value)
    }
}
