//! Clouds of the Point Cloud Library, version 0.7: ASCII, binary and compressed.
//!
//! The viewpoint of the header is not applied: coordinates are taken as they stand, as PCL does.

mod header;
mod lzf;

use header::{Data, Header};

use super::binary::{self, ByteOrder, Field, enough};
use super::collector::Collector;
use super::columns::Columns;
use super::private::{Place, lines};
use super::text::Lines;
use super::{Error, Limits};

/// Fewest bytes of a value in text: a digit and what parts it from the next.
const SHORTEST_VALUE: usize = 2;

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let header = header::read(bytes)?;
    let columns = Columns::named(header.column_names())
        .ok_or_else(|| Error::NoCoordinates("FIELDS does not name x, y and z".to_owned()))?;
    let body = &bytes[header.bytes..];
    let mut collector = columns.collector(limits);
    match header.data {
        Data::Ascii => ascii(body, &header, &columns, &mut collector)?,
        Data::Binary => {
            enough(
                "the list of points",
                header.points,
                header.record_bytes(),
                body.len(),
            )?;
            let fields = fields(&header, &columns, false);
            binary::collect(body, &fields, header.points, &mut collector)?;
        }
        Data::Compressed => {
            let table = expand(body, &header, limits)?;
            let fields = fields(&header, &columns, true);
            binary::collect(&table, &fields, header.points, &mut collector)?;
        }
    }
    Ok(collector)
}

/// Comments.
pub(super) fn texts(bytes: &[u8]) -> Result<Vec<Place>, Error> {
    let header = header::read(bytes)?;
    let text = header.data == Data::Ascii;
    Ok(lines::of_pcd(bytes, header.bytes, text))
}

fn ascii(
    body: &[u8],
    header: &Header<'_>,
    columns: &Columns,
    collector: &mut Collector<'_>,
) -> Result<(), Error> {
    let possible = body.len() / (SHORTEST_VALUE * columns.width()) + 1;
    collector.reserve(header.points.min(possible))?;
    let lines = Lines::new(body, header.lines).content().take(header.points);
    let found = columns.collect(lines, collector)?;
    if found < header.points as u64 {
        return Err(Error::Truncated {
            what: "the list of points".to_owned(),
            declared: header.points as u64,
            found,
        });
    }
    Ok(())
}

/// Where the columns lie: in records, or, in the compressed form, one field after the other.
fn fields(header: &Header<'_>, columns: &Columns, by_field: bool) -> Vec<Field> {
    let mut fields = Vec::new();
    let (mut column, mut offset) = (0, 0);
    for field in &header.fields {
        let size = field.scalar.size() * field.count;
        fields.extend(columns.slot(column).map(|slot| Field {
            slot,
            scalar: field.scalar,
            order: ByteOrder::Little,
            start: offset * if by_field { header.points } else { 1 },
            stride: if by_field {
                size
            } else {
                header.record_bytes()
            },
        }));
        column += field.count;
        offset += size;
    }
    fields
}

/// The table of the compressed form: sizes before and after as u32, then LZF.
fn expand(body: &[u8], header: &Header<'_>, limits: &Limits) -> Result<Vec<u8>, Error> {
    let number = |at: usize| Some(u32::from_le_bytes(*body.get(at..)?.first_chunk()?) as usize);
    let sizes = number(0).zip(number(4)).zip(body.get(8..));
    let Some(((packed, expanded), rest)) = sizes else {
        return Err(Error::Truncated {
            what: "the compressed data, in bytes,".to_owned(),
            declared: 8,
            found: body.len() as u64,
        });
    };
    enough("the compressed data, in bytes,", packed, 1, rest.len())?;
    let needed = header.points.checked_mul(header.record_bytes());
    if needed.is_none_or(|needed| expanded < needed) {
        return Err(Error::Truncated {
            what: "the list of points".to_owned(),
            declared: header.points as u64,
            found: (expanded / header.record_bytes()) as u64,
        });
    }
    if expanded > limits.expanded(packed) {
        let limit = limits.expanded(packed);
        return Err(Error::ExpandsTooFar { limit });
    }
    lzf::expand(&rest[..packed], expanded)
        .ok_or_else(|| Error::Compression("LZF: the data are damaged".to_owned()))
}
