//! The header of a PLY file, bounded before anything behind it is believed.

use super::excerpt;
use crate::reconstruction::cloud::Error;

/// Longest header; real ones have a few hundred bytes.
const HEADER_BYTES: usize = 64 * 1024;
const ELEMENTS: usize = 16;
const PROPERTIES: usize = 64;

/// How numbers are written behind the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A type of number.
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
    /// The number at the start of `bytes` and its size; `None` where they end within it.
    pub(super) fn decode(self, bytes: &[u8], big_endian: bool) -> Option<(f64, usize)> {
        /// The first bytes, least significant first.
        fn first<const N: usize>(bytes: &[u8], big_endian: bool) -> Option<[u8; N]> {
            let mut first = *bytes.first_chunk()?;
            if big_endian {
                first.reverse();
            }
            Some(first)
        }
        Some(match self {
            Self::I8 => (i8::from_le_bytes(first(bytes, big_endian)?).into(), 1),
            Self::U8 => (u8::from_le_bytes(first(bytes, big_endian)?).into(), 1),
            Self::I16 => (i16::from_le_bytes(first(bytes, big_endian)?).into(), 2),
            Self::U16 => (u16::from_le_bytes(first(bytes, big_endian)?).into(), 2),
            Self::I32 => (i32::from_le_bytes(first(bytes, big_endian)?).into(), 4),
            Self::U32 => (u32::from_le_bytes(first(bytes, big_endian)?).into(), 4),
            Self::F32 => (f32::from_le_bytes(first(bytes, big_endian)?).into(), 4),
            Self::F64 => (f64::from_le_bytes(first(bytes, big_endian)?), 8),
        })
    }
}

/// One column of an element.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// Type of the length, for lists.
    pub(super) length: Option<Scalar>,
}

/// One table of the file.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Index of the property of this name that is no list.
    pub(super) fn scalar_column(&self, name: &str) -> Option<usize> {
        let mut properties = self.properties.iter();
        properties.position(|property| property.name == name && property.length.is_none())
    }
}

/// What the header declares.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    /// Number of lines, for messages about those that follow.
    pub(super) lines: usize,
}

impl Header {
    /// Reads the header; also gives what follows it.
    pub(super) fn read(bytes: &[u8]) -> Result<(Self, &[u8]), Error> {
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut start = 0;
        for line in 1.. {
            let rest = &bytes[start..bytes.len().min(HEADER_BYTES)];
            let Some(length) = rest.iter().position(|&b| b == b'\n') else {
                return Err(fault(line, "the header has no end_header"));
            };
            start += length + 1;
            let text = String::from_utf8_lossy(&rest[..length]);
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["end_header"] => {
                    let encoding = encoding.ok_or_else(|| fault(line, "no format is given"))?;
                    check(&elements, line)?;
                    let header = Self {
                        encoding,
                        elements,
                        lines: line,
                    };
                    return Ok((header, &bytes[start..]));
                }
                ["format", name, _version] => encoding = Some(parse_encoding(name, line)?),
                ["element", name, count] => elements.push(Element {
                    name: (*name).to_owned(),
                    count: count
                        .parse()
                        .map_err(|_| fault(line, format!("'{}' is not a count", excerpt(count))))?,
                    properties: Vec::new(),
                }),
                ["property", description @ ..] => {
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| fault(line, "a property stands before any element"))?;
                    element.properties.push(parse_property(description, line)?);
                }
                ["ply"] if line == 1 => {}
                [] | ["comment" | "obj_info", ..] => {}
                _ => {
                    let text = excerpt(&text);
                    return Err(fault(line, format!("'{text}' cannot be understood")));
                }
            }
        }
        Err(fault(0, "the header has no end_header"))
    }
}

fn check(elements: &[Element], line: usize) -> Result<(), Error> {
    if elements.len() > ELEMENTS || elements.iter().any(|e| e.properties.len() > PROPERTIES) {
        return Err(fault(
            line,
            "more elements or properties than any real file has",
        ));
    }
    match elements
        .iter()
        .find(|e| e.properties.is_empty() && e.count > 0)
    {
        Some(e) => Err(fault(
            line,
            format!("element '{}' has no properties", excerpt(&e.name)),
        )),
        None => Ok(()),
    }
}

fn parse_encoding(name: &str, line: usize) -> Result<Encoding, Error> {
    match name {
        "ascii" => Ok(Encoding::Ascii),
        "binary_little_endian" => Ok(Encoding::LittleEndian),
        "binary_big_endian" => Ok(Encoding::BigEndian),
        _ => Err(fault(line, format!("unknown format '{}'", excerpt(name)))),
    }
}

fn parse_property(description: &[&str], line: usize) -> Result<Property, Error> {
    let (length, scalar, name) = match description {
        ["list", length, scalar, name] => (Some(parse_scalar(length, line)?), scalar, name),
        [scalar, name] => (None, scalar, name),
        _ => return Err(fault(line, "a property is a type and a name")),
    };
    if matches!(length, Some(Scalar::F32 | Scalar::F64)) {
        return Err(fault(line, "the length of a list is an integer"));
    }
    Ok(Property {
        name: (*name).to_owned(),
        scalar: parse_scalar(scalar, line)?,
        length,
    })
}

fn parse_scalar(name: &str, line: usize) -> Result<Scalar, Error> {
    Ok(match name {
        "char" | "int8" => Scalar::I8,
        "uchar" | "uint8" => Scalar::U8,
        "short" | "int16" => Scalar::I16,
        "ushort" | "uint16" => Scalar::U16,
        "int" | "int32" => Scalar::I32,
        "uint" | "uint32" => Scalar::U32,
        "float" | "float32" => Scalar::F32,
        "double" | "float64" => Scalar::F64,
        _ => return Err(fault(line, format!("unknown type '{}'", excerpt(name)))),
    })
}

fn fault(line: usize, detail: impl Into<String>) -> Error {
    Error::Header {
        line,
        detail: detail.into(),
    }
}
