//! The header of an array: a dictionary in the syntax of Python.

use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar};
use crate::reconstruction::cloud::columns::MAX_COLUMNS;
use crate::reconstruction::cloud::text::excerpt;

/// Longest header that is read; NumPy's own is 118 bytes for plain arrays, more with many fields.
const MAX_HEADER: usize = 64 << 10;

/// Most axes of an array: an image of points has three.
const MAX_AXES: usize = 8;

/// A number, or several of one type, in each element of an array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Part {
    /// Empty where elements have one part only.
    pub(super) name: String,
    /// `None` for types that are not numbers of ours: text, complex numbers, dates.
    pub(super) scalar: Option<Scalar>,
    pub(super) order: ByteOrder,
    /// Bytes of one.
    pub(super) size: usize,
    /// How many there are.
    pub(super) count: usize,
}

/// What stands before the data.
#[derive(Debug)]
pub(super) struct Header {
    /// The parts of an element; only a structured array has several.
    pub(super) parts: Vec<Part>,
    pub(super) column_major: bool,
    pub(super) shape: Vec<usize>,
    /// Bytes of the header.
    pub(super) bytes: usize,
}

impl Header {
    /// Reads the header at the start of `bytes`.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, Error> {
        let (text, start) = split(bytes)?;
        let column_major = match value(text, "fortran_order") {
            Some(text) if text.starts_with("True") => true,
            Some(text) if text.starts_with("False") => false,
            _ => return Err(error("expected fortran_order True or False", text)),
        };
        Ok(Self {
            parts: parts(text)?,
            column_major,
            shape: shape(text)?,
            bytes: start,
        })
    }

    /// Bytes of an element.
    pub(super) fn element_bytes(&self) -> usize {
        self.parts.iter().map(|part| part.size * part.count).sum()
    }
}

/// The text of the header, and where the data begin.
fn split(bytes: &[u8]) -> Result<(&str, usize), Error> {
    let short = || error("the header is cut short", "");
    if !bytes.starts_with(b"\x93NUMPY") {
        return Err(error("expected an array of NumPy", ""));
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
        return Err(error("the header is longer than 65536 bytes", ""));
    }
    let (text, body) = rest.split_at_checked(length).ok_or_else(short)?;
    let text = std::str::from_utf8(text).map_err(|_| error("the header is not text", ""))?;
    Ok((text, bytes.len() - body.len()))
}

/// What follows a key of the dictionary.
fn value<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let after = &text[text.find(key)? + key.len()..];
    let after = after.trim_start_matches(['\'', '"']).trim_start();
    Some(after.strip_prefix(':')?.trim_start())
}

/// The parts of `descr`: `'<f4'`, or a list as in `[('x', '<f4'), ('rgb', '|u1', (3,))]`.
fn parts(text: &str) -> Result<Vec<Part>, Error> {
    let descr = value(text, "descr").unwrap_or_default();
    let Some(mut rest) = descr.strip_prefix('[') else {
        let (spelled, _) = quoted(descr).ok_or_else(|| error("expected a type", descr))?;
        return Ok(vec![part("", spelled, 1)?]);
    };
    let mut parts = Vec::new();
    loop {
        rest = rest.trim_start_matches([',', ' ']);
        if rest.starts_with(']') {
            return Ok(parts);
        }
        let expected = || {
            error(
                "expected fields of name and type in a structured array",
                rest,
            )
        };
        let inside = rest.strip_prefix('(').ok_or_else(expected)?;
        // A name may have a title before it, which is of no use here.
        let (name, after) = match inside.strip_prefix('(') {
            Some(titled) => {
                let (_, after) = quoted(titled).ok_or_else(expected)?;
                let (name, after) =
                    quoted(after.trim_start_matches([',', ' '])).ok_or_else(expected)?;
                (name, after.trim_start_matches([')', ' ']))
            }
            None => quoted(inside).ok_or_else(expected)?,
        };
        let (spelled, after) = quoted(after.trim_start_matches([',', ' '])).ok_or_else(expected)?;
        let after = after.trim_start_matches([',', ' ']);
        let (count, after) = match after.strip_prefix('(') {
            Some(inside) => {
                let (sizes, after) = inside.split_once(')').ok_or_else(expected)?;
                (product(sizes).ok_or_else(expected)?, after)
            }
            None => (1, after),
        };
        if parts.len() == MAX_COLUMNS || count > MAX_COLUMNS {
            return Err(error("more than 4096 numbers in an element", ""));
        }
        parts.push(part(name, spelled, count)?);
        rest = after.trim_start().strip_prefix(')').ok_or_else(expected)?;
    }
}

/// The inside of the quotes that a text begins with, and what follows them.
fn quoted(text: &str) -> Option<(&str, &str)> {
    let quote = text.chars().next().filter(|c| "'\"".contains(*c))?;
    text[1..].split_once(quote)
}

fn product(sizes: &str) -> Option<usize> {
    let sizes = sizes
        .split(',')
        .map(str::trim)
        .filter(|size| !size.is_empty());
    sizes
        .map(|size| size.parse().ok())
        .try_fold(1usize, |product, size| product.checked_mul(size?))
}

/// A type as in `<f4`: byte order, kind, size.
fn part(name: &str, spelled: &str, count: usize) -> Result<Part, Error> {
    let expected = || {
        error(
            "expected numbers of type f2, f4, f8, i1 to i8 or u1 to u8",
            spelled,
        )
    };
    let order = match spelled.as_bytes().first() {
        Some(b'>') => ByteOrder::Big,
        _ => ByteOrder::Little,
    };
    let plain = spelled.trim_start_matches(['<', '>', '|', '=']);
    let kind = plain.chars().next().filter(char::is_ascii_alphabetic);
    let kind = kind.ok_or_else(expected)?;
    let digits: String = plain[1..]
        .chars()
        .take_while(char::is_ascii_digit)
        .collect();
    if kind == 'O' {
        return Err(error("expected numbers, not Python objects", spelled));
    }
    let size: usize = digits.parse().map_err(|_| expected())?;
    let (scalar, size) = match kind {
        // Text has four bytes a character.
        'U' => (None, size.checked_mul(4).ok_or_else(expected)?),
        'b' => (Some(Scalar::U8), size),
        'f' | 'i' | 'u' => (Scalar::of(kind as u8, size), size),
        _ => (None, size),
    };
    if size > MAX_HEADER {
        return Err(expected());
    }
    Ok(Part {
        name: name.to_owned(),
        scalar,
        order,
        size,
        count,
    })
}

/// The sizes of `shape`, as in `(100, 3)`.
fn shape(text: &str) -> Result<Vec<usize>, Error> {
    let expected = || error("expected a shape", text);
    let shape = value(text, "shape").and_then(|text| text.strip_prefix('('));
    let (shape, _) = shape
        .and_then(|text| text.split_once(')'))
        .ok_or_else(expected)?;
    let sizes = shape
        .split(',')
        .map(str::trim)
        .filter(|size| !size.is_empty());
    let sizes: Option<Vec<usize>> = sizes.take(MAX_AXES).map(|size| size.parse().ok()).collect();
    sizes.ok_or_else(expected)
}

pub(super) fn error(detail: &str, found: &str) -> Error {
    let found = match found {
        "" => String::new(),
        found => format!(", found \"{}\"", excerpt(found.as_bytes())),
    };
    Error::Header {
        line: 0,
        detail: format!("{detail}{found}"),
    }
}
