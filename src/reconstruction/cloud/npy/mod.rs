//! Arrays of NumPy: `[n, 3]` points, more columns as in a table, `[height, width, 3]` images of points,
//! transposed arrays, and structured ones with fields x, y, z.
//!
//! Format: numpy.lib.format, versions 1 to 3. A header in the syntax of a Python dictionary names
//! type, order and shape; the numbers follow.

mod header;

use header::{Header, Part, error};

use super::binary::{Field, collect, enough};
use super::collector::Collector;
use super::columns::{Columns, MAX_COLUMNS};
use super::private::{Fill, Place};
use super::roles::Sample;
use super::{Error, Limits};

/// Rows that decide what the columns behind the third hold.
const SAMPLE_ROWS: usize = 2000;

/// Most numbers of a point in a transposed array or an image: coordinates, normals, colours, a few more.
const MOST_TRANSPOSED: usize = 16;

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let header = Header::read(bytes)?;
    let body = &bytes[header.bytes..];
    if header.parts.iter().any(|part| !part.name.is_empty()) {
        return structured(&header, body, limits);
    }
    let Some(part) = header.parts.first() else {
        return Err(error("expected a type", ""));
    };
    plain(&header, part, body, limits)
}

/// An array of numbers.
fn plain<'l>(
    header: &Header,
    part: &Part,
    body: &[u8],
    limits: &'l Limits,
) -> Result<Collector<'l>, Error> {
    let Some((rows, width, transposed)) = table(&header.shape) else {
        let shape = header
            .shape
            .iter()
            .map(usize::to_string)
            .collect::<Vec<_>>();
        return Err(Error::NoCoordinates(format!(
            "the array is [{}]; expected [n, 3], or [n, 6] with normals",
            shape.join(", ")
        )));
    };
    let expected = || {
        error(
            "expected numbers of type f2, f4, f8, i1 to i8 or u1 to u8",
            "",
        )
    };
    let scalar = part.scalar.ok_or_else(expected)?;
    let size = scalar.size();
    enough("the array, in rows,", rows, width * size, body.len())?;
    // The numbers of a column lie together in a transposed array, and in one of Fortran's order.
    let by_column = header.column_major != transposed;
    let field = |slot, column| Field {
        slot,
        scalar,
        order: part.order,
        start: column * size * if by_column { rows } else { 1 },
        stride: size * if by_column { 1 } else { width },
    };
    let columns = if width == 3 {
        Columns::placed([0, 1, 2], 3)
    } else {
        let step = rows.div_ceil(SAMPLE_ROWS).max(1);
        let number = |row: usize, column: usize| {
            let Field { start, stride, .. } = field(0, column);
            let bytes = body.get(start + row * stride..);
            bytes
                .and_then(|bytes| scalar.read(part.order, bytes))
                .unwrap_or(f64::NAN)
        };
        let all = (0..rows).step_by(step);
        let values = all.flat_map(|row| (0..width).map(move |column| (row, column)));
        let values = values.map(|(row, column)| number(row, column)).collect();
        let none = || Error::NoCoordinates("the array has not three columns of numbers".to_owned());
        let tallies = Vec::new();
        let sample = Sample {
            width,
            values,
            tallies,
        };
        sample.columns().ok_or_else(none)?
    };
    let mut collector = columns.collector(limits);
    if transposed {
        let message =
            format!("the array is [{width}, {rows}]; it was read as {rows} points, transposed");
        collector.warn("array_transposed", message);
    }
    let fields = (0..width).filter_map(|column| Some(field(columns.slot(column)?, column)));
    let fields: Vec<_> = fields.collect();
    collect(body, &fields, rows, &mut collector)?;
    Ok(collector)
}

/// Rows and columns of an array of a shape, and whether points are its columns. Images of points are
/// read pixel by pixel, whether a pixel is the last axis or the first; more axes of size 1 are none.
fn table(shape: &[usize]) -> Option<(usize, usize, bool)> {
    let mut shape = shape;
    while let [others @ .., 1] = shape {
        shape = others;
    }
    let product = |sizes: &[usize]| {
        let mut sizes = sizes.iter();
        sizes.try_fold(1usize, |product, &size| product.checked_mul(size))
    };
    match shape {
        [] | [_] => None,
        [few @ 3..=MOST_TRANSPOSED, others @ .., last] if *last > MOST_TRANSPOSED => {
            Some((product(others)?.checked_mul(*last)?, *few, true))
        }
        [_, others @ .., last] => {
            let fits = 3..=if others.is_empty() {
                MAX_COLUMNS
            } else {
                MOST_TRANSPOSED
            };
            let rows = product(&shape[..shape.len() - 1])?;
            fits.contains(last).then_some((rows, *last, false))
        }
    }
}

/// The parts of elements that are no numbers.
pub(super) fn texts(bytes: &[u8]) -> Result<Vec<Place>, Error> {
    let header = Header::read(bytes)?;
    let size = header.element_bytes();
    let (mut places, mut start) = (Vec::new(), 0);
    for part in &header.parts {
        let length = part.count * part.size;
        if part.scalar.is_none() && length > 0 {
            let elements = (header.bytes..bytes.len()).step_by(size);
            let text = elements.map(|element| element + start..element + start + length);
            places.extend(text.map(|range| Place::new(range, Fill::Zeros)));
        }
        start += length;
    }
    Ok(places)
}

/// An array of elements with named parts.
fn structured<'l>(
    header: &Header,
    body: &[u8],
    limits: &'l Limits,
) -> Result<Collector<'l>, Error> {
    // Several numbers of one name are told apart as programs do: name_0, name_1.
    let mut names = Vec::new();
    let mut places = Vec::new();
    let mut offset = 0;
    for part in &header.parts {
        for i in 0..part.count {
            names.push(match (part.count, part.scalar) {
                (_, None) => String::new(),
                (1, _) => part.name.clone(),
                _ => format!("{}_{i}", part.name),
            });
            places.push((part, offset + i * part.size));
        }
        offset += part.count * part.size;
        if names.len() > MAX_COLUMNS {
            return Err(error("more than 4096 numbers in an element", ""));
        }
    }
    let columns = Columns::named(names.iter().map(String::as_bytes)).ok_or_else(|| {
        let detail = "the structured array has no fields named x, y and z";
        Error::NoCoordinates(detail.to_owned())
    })?;
    let stride = header.element_bytes();
    let mut sizes = header.shape.iter();
    let rows = sizes.try_fold(1usize, |rows, &size| rows.checked_mul(size));
    let rows = rows.unwrap_or(usize::MAX);
    enough("the array, in elements,", rows, stride, body.len())?;
    let field = |(column, &(part, start)): (usize, &(&Part, usize))| {
        Some(Field {
            slot: columns.slot(column)?,
            scalar: part.scalar?,
            order: part.order,
            start,
            stride,
        })
    };
    let fields: Vec<_> = places.iter().enumerate().filter_map(field).collect();
    let mut collector = columns.collector(limits);
    collect(body, &fields, rows, &mut collector)?;
    Ok(collector)
}
