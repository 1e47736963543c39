//! Vertices of PLY files, ASCII and binary.
//!
//! `ply-rs` parses the [`header`]; the data are decoded here, because its element readers build a
//! map for each vertex (1 s and 1 GB for a million points, where a plain decode takes some 20 ms)
//! and refuse spellings of numbers that are in use.

mod body;
mod element;
mod header;

use super::binary::{self, ByteOrder, Field};
use super::collector::{Collector, Row};
use super::columns::Columns;
use super::private::{Fill, Place};
use super::{Error, Limits};

pub(in crate::reconstruction) use body::Body;
pub(in crate::reconstruction) use element::{Element, Kind};
pub(in crate::reconstruction) use header::Header;
pub use header::MAX_HEADER_BYTES;

/// Fewest bytes of a value in text: a digit and what parts it from the next.
const SHORTEST_VALUE: usize = 2;

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let header = Header::read(bytes)?;
    let columns = header.vertex_columns()?;
    let mut body = header.body(bytes);
    let mut collector = columns.collector(limits);
    collector.space(header.space);
    for element in &header.elements {
        if element.is_vertex() {
            // Of a text only this many vertices can follow, whatever is declared.
            let possible = bytes.len() / (SHORTEST_VALUE * element.properties.len()) + 1;
            read_vertices(element, &columns, &mut body, &mut collector, possible)?;
        } else {
            body.skip(element)?;
        }
    }
    Ok(collector)
}

/// The texts of the comments.
pub(super) fn texts(bytes: &[u8]) -> Result<Vec<Place>, Error> {
    let comments = Header::read(bytes)?.comments.into_iter();
    Ok(comments
        .map(|range| Place::new(range, Fill::BlanksAroundTags))
        .collect())
}

fn read_vertices(
    element: &Element,
    columns: &Columns,
    body: &mut Body<'_>,
    collector: &mut Collector<'_>,
    possible: usize,
) -> Result<(), Error> {
    match (body, element.record_bytes()) {
        (Body::Text(text), Some(_)) => {
            collector.reserve(element.count.min(possible))?;
            let records = text.records().take(element.count);
            let found = columns.collect(records, collector)? as usize;
            if found < element.count {
                return Err(element.truncated(found));
            }
        }
        (Body::Binary(binary), Some(size)) => {
            let records = binary.records(element, size)?;
            let fields = fields(element, columns, binary.order, size);
            binary::collect(records, &fields, element.count, collector)?;
        }
        (body, None) => {
            for i in 0..element.count {
                let (row, line) = row(element, columns, body, i)?;
                collector.push(&row, line)?;
            }
        }
    }
    Ok(())
}

/// The vertex of record `i` and its line, in binary data its number.
fn row(
    element: &Element,
    columns: &Columns,
    body: &mut Body<'_>,
    i: usize,
) -> Result<(Row, usize), Error> {
    let mut row = [0.0; 7];
    let line = body.record(element, i, |column, value| {
        if let Some(slot) = columns.slot(column) {
            row[slot] = value;
        }
    })?;
    Ok((row, line))
}

/// Where the values of the columns lie in records of `stride` bytes.
fn fields(element: &Element, columns: &Columns, order: ByteOrder, stride: usize) -> Vec<Field> {
    let mut fields = Vec::new();
    let mut start = 0;
    for (column, property) in element.properties.iter().enumerate() {
        if let Kind::Scalar(scalar) = property.kind {
            fields.extend(columns.slot(column).map(|slot| Field {
                slot,
                scalar,
                order,
                start,
                stride,
            }));
            start += scalar.size();
        }
    }
    fields
}
