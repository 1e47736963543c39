//! Arrays of NumPy: `[n, 3]` points, or `[n, 6]` points and normals.
//!
//! Format: numpy.lib.format, versions 1 to 3. A header in the syntax of a Python dictionary names
//! type, order and shape; the numbers follow.

use super::binary::{ByteOrder, Field, Scalar, collect, enough};
use super::collector::Collector;
use super::text::excerpt;
use super::{Error, Limits};

/// Longest header that is read; NumPy's own is 118 bytes for such arrays.
const MAX_HEADER: usize = 4096;

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let (text, body) = split(bytes)?;
    let (scalar, order) = element_type(text)?;
    let (rows, columns) = shape(text)?;
    let column_major = match value(text, "fortran_order") {
        Some(text) if text.starts_with("True") => true,
        Some(text) if text.starts_with("False") => false,
        _ => return Err(header("expected fortran_order True or False", text)),
    };
    if columns != 3 && columns != 6 {
        let detail = format!("the array is [{rows}, {columns}]; expected [n, 3] or [n, 6]");
        return Err(Error::NoCoordinates(detail));
    }
    let size = scalar.size();
    enough("the array, in rows,", rows, columns * size, body.len())?;
    let field = |slot| Field {
        slot,
        scalar,
        order,
        start: slot * size * if column_major { rows } else { 1 },
        stride: size * if column_major { 1 } else { columns },
    };
    let fields: Vec<_> = (0..columns).map(field).collect();
    let mut collector = Collector::new(limits, columns == 6, false);
    collect(body, &fields, rows, &mut collector)?;
    Ok(collector)
}

/// The text of the header and the bytes after it.
fn split(bytes: &[u8]) -> Result<(&str, &[u8]), Error> {
    let short = || header("the header is cut short", "");
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err(header("expected an array of NumPy", ""));
    }
    let version = *bytes.get(6).ok_or_else(short)?;
    let rest = bytes.get(8..).ok_or_else(short)?;
    let (length, rest) = if version == 1 {
        let (length, rest) = rest.split_first_chunk().ok_or_else(short)?;
        (usize::from(u16::from_le_bytes(*length)), rest)
    } else {
        let (length, rest) = rest.split_first_chunk().ok_or_else(short)?;
        (u32::from_le_bytes(*length) as usize, rest)
    };
    if length > MAX_HEADER {
        return Err(header("the header is longer than 4096 bytes", ""));
    }
    let (text, body) = rest.split_at_checked(length).ok_or_else(short)?;
    let text = std::str::from_utf8(text).map_err(|_| header("the header is not text", ""))?;
    Ok((text, body))
}

/// What follows a key of the dictionary.
fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let after = &text[text.find(key)? + key.len()..];
    let after = after.trim_start_matches(['\'', '"']).trim_start();
    Some(after.strip_prefix(':')?.trim_start())
}

/// Type and byte order of `descr`, as in `'<f4'`.
fn element_type(text: &str) -> Result<(Scalar, ByteOrder), Error> {
    let descr = value(text, "descr").unwrap_or_default();
    let descr = descr.trim_start_matches(['\'', '"']);
    let descr = descr.split(['\'', '"']).next().unwrap_or_default();
    let expected = || {
        header(
            "expected numbers of type f4, f8, i1 to i8 or u1 to u8",
            descr,
        )
    };
    let [order, kind, size] = descr.as_bytes() else {
        return Err(expected());
    };
    let order = if *order == b'>' {
        ByteOrder::Big
    } else {
        ByteOrder::Little
    };
    let scalar = Scalar::of(*kind, usize::from(size.wrapping_sub(b'0')));
    Ok((scalar.ok_or_else(expected)?, order))
}

/// Rows and columns of `shape`, as in `(100, 3)`.
fn shape(text: &str) -> Result<(usize, usize), Error> {
    let expected = || header("expected a shape of two dimensions", text);
    let shape = value(text, "shape").and_then(|text| text.strip_prefix('('));
    let shape = shape.and_then(|text| Some(text.split_once(')')?.0));
    let mut sizes = shape.ok_or_else(expected)?.split(',').map(str::trim);
    let mut size = || sizes.next()?.parse().ok();
    let (rows, columns) = size().zip(size()).ok_or_else(expected)?;
    match sizes.next() {
        None | Some("") => Ok((rows, columns)),
        Some(_) => Err(expected()),
    }
}

fn header(detail: &str, found: &str) -> Error {
    let found = match found {
        "" => String::new(),
        found => format!(", found \"{}\"", excerpt(found.as_bytes())),
    };
    Error::Header {
        line: 0,
        detail: format!("{detail}{found}"),
    }
}
