//! Polygon data in XML (`.vtp`): arrays as text, base64 or appended, plain or packed by zlib.

use super::arrays::{Numbers, Packing, numbers, of_base64};
use super::{ByteOrder, Scalar, collect, enough, header, scalar_of_xml};
use crate::reconstruction::cloud::collector::Collector;
use crate::reconstruction::cloud::text::{excerpt, parse};
use crate::reconstruction::cloud::{Error, Limits};
use crate::reconstruction::space::Space;

/// Looked at to tell polygon data from other kinds.
const HEAD: usize = 4096;

/// Whether a file is polygon data in XML.
pub(in crate::reconstruction::cloud) fn is_xml(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(HEAD)];
    let text = head.trim_ascii_start();
    let starts = text.starts_with(b"<?xml") || text.starts_with(b"<VTKFile");
    let mut tags = Tags::of(head);
    let file = tags.find(|tag| tag.name == b"VTKFile");
    starts && file.is_some_and(|tag| tag.get(b"type") == Some(b"PolyData".as_slice()))
}

/// A tag with its attributes.
#[derive(Debug, Clone, Copy)]
pub(in crate::reconstruction::cloud) struct Tag<'a> {
    /// Its name, with a slash in front where it ends something.
    pub(in crate::reconstruction::cloud) name: &'a [u8],
    attributes: &'a [u8],
    /// Where its content begins.
    pub(in crate::reconstruction::cloud) end: usize,
}

impl<'a> Tag<'a> {
    /// The value of an attribute.
    pub(in crate::reconstruction::cloud) fn get(&self, name: &[u8]) -> Option<&'a [u8]> {
        let mut rest = self.attributes;
        loop {
            let equals = rest.iter().position(|&b| b == b'=')?;
            let found = rest[..equals].trim_ascii();
            let value = rest[equals + 1..].trim_ascii_start();
            let (&quote, value) = value.split_first()?;
            if quote != b'"' && quote != b'\'' {
                return None;
            }
            let end = value.iter().position(|&b| b == quote)?;
            if found == name {
                return Some(&value[..end]);
            }
            rest = &value[end + 1..];
        }
    }

    fn number(&self, name: &[u8]) -> Option<usize> {
        std::str::from_utf8(self.get(name)?)
            .ok()?
            .trim()
            .parse()
            .ok()
    }
}

/// The tags of a text, one after the other. Attributes of VTK hold no angle brackets.
pub(in crate::reconstruction::cloud) struct Tags<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Tags<'a> {
    pub(in crate::reconstruction::cloud) fn of(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }
}

impl<'a> Iterator for Tags<'a> {
    type Item = Tag<'a>;

    fn next(&mut self) -> Option<Tag<'a>> {
        let start = self.at + self.bytes.get(self.at..)?.iter().position(|&b| b == b'<')? + 1;
        let length = self.bytes[start..].iter().position(|&b| b == b'>')?;
        self.at = start + length + 1;
        let inside = &self.bytes[start..start + length];
        let name = inside
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(length);
        Some(Tag {
            name: &inside[..name],
            attributes: &inside[name..],
            end: self.at,
        })
    }
}

/// How a file writes its arrays.
struct File<'a> {
    bytes: &'a [u8],
    /// Most bytes of an array.
    most: usize,
    packing: Packing,
    /// What is appended, and whether that is base64.
    appended: Option<(&'a [u8], bool)>,
}

/// Reads a file.
pub(in crate::reconstruction::cloud) fn read<'l>(
    bytes: &[u8],
    limits: &'l Limits,
) -> Result<Collector<'l>, Error> {
    let mut tags = Tags::of(bytes);
    let root = tags.find(|tag| tag.name == b"VTKFile");
    let root = root.ok_or_else(|| header(0, "the tag VTKFile is missing"))?;
    let file = File {
        bytes,
        most: limits.expanded(bytes.len()),
        packing: packing(&root)?,
        appended: appended(bytes),
    };
    let mut pieces = Vec::new();
    let mut piece: Option<Piece<'_>> = None;
    let mut within: &[u8] = b"";
    let mut space = Space::default();
    for tag in tags {
        match tag.name {
            b"AppendedData" => break,
            b"Array" if tag.get(b"Name") == Some(b"SPACE".as_slice()) => space = file.space(&tag),
            b"Piece" => {
                let count = tag.number(b"NumberOfPoints").unwrap_or(0);
                piece = (count > 0).then(|| Piece::of(count));
            }
            b"/Piece" => {
                if let Some(Piece {
                    points: Some(points),
                    normals,
                    ..
                }) = piece.take()
                {
                    pieces.push((points, normals));
                }
            }
            b"Points" => within = tag.name,
            b"PointData" => {
                within = tag.name;
                if let Some(piece) = &mut piece {
                    piece.name = tag.get(b"Normals").unwrap_or_default();
                }
            }
            b"/Points" | b"/PointData" => within = b"",
            b"DataArray" => {
                let Some(piece) = &mut piece else {
                    continue;
                };
                if within == b"Points" && piece.points.is_none() {
                    piece.points = Some(file.array(&tag, piece.count)?);
                } else if within == b"PointData"
                    && !piece.name.is_empty()
                    && tag.get(b"Name") == Some(piece.name)
                {
                    piece.normals = Some(file.array(&tag, piece.count)?);
                }
            }
            _ => {}
        }
    }
    if pieces.is_empty() {
        return Err(Error::Empty);
    }
    collect(limits, &pieces, space)
}

/// A piece whose end is yet to come.
struct Piece<'a> {
    /// Number of its points.
    count: usize,
    /// Name of its normals, empty where there are none.
    name: &'a [u8],
    points: Option<Numbers>,
    normals: Option<Numbers>,
}

impl Piece<'_> {
    fn of(count: usize) -> Self {
        Self {
            count,
            name: b"",
            points: None,
            normals: None,
        }
    }
}

fn packing(root: &Tag<'_>) -> Result<Packing, Error> {
    let zlib = match root.get(b"compressor") {
        None => false,
        Some(b"vtkZLibDataCompressor") => true,
        Some(other) => {
            return Err(Error::UnsupportedFormat(format!(
                "arrays packed by {} are not read; save the file without compression or with zlib",
                excerpt(other)
            )));
        }
    };
    Ok(Packing {
        head: match root.get(b"header_type") {
            Some(b"UInt64") => Scalar::U64,
            _ => Scalar::U32,
        },
        order: match root.get(b"byte_order") {
            Some(b"BigEndian") => ByteOrder::Big,
            _ => ByteOrder::Little,
        },
        zlib,
    })
}

/// What is behind the underscore of the appended data.
fn appended(bytes: &[u8]) -> Option<(&[u8], bool)> {
    let tag = Tags::of(bytes).find(|tag| tag.name == b"AppendedData")?;
    let data = &bytes[tag.end..];
    let start = data.iter().position(|&b| b == b'_')?;
    Some((&data[start + 1..], tag.get(b"encoding") == Some(b"base64")))
}

impl File<'_> {
    /// The frame that an array of the codes of its letters names.
    fn space(&self, tag: &Tag<'_>) -> Space {
        let text = &self.bytes[tag.end..];
        let text = &text[..text.iter().position(|&b| b == b'<').unwrap_or(text.len())];
        let codes = text.split(u8::is_ascii_whitespace).filter_map(parse);
        let letters = codes.map(|code| code as u8).filter(u8::is_ascii_alphabetic);
        let tags: Vec<u8> = b"SPACE=".iter().copied().chain(letters.take(8)).collect();
        Space::from_tags(&tags)
    }

    /// Three numbers for each of `count` points.
    fn array(&self, tag: &Tag<'_>, count: usize) -> Result<Numbers, Error> {
        let kind = tag.get(b"type").unwrap_or_default();
        let scalar = scalar_of_xml(kind)
            .ok_or_else(|| header(0, format!("{} is no type of numbers", excerpt(kind))))?;
        if tag.number(b"NumberOfComponents") != Some(3) {
            return Err(header(0, "points and normals must have three components"));
        }
        let what = "the points of a piece";
        enough(what, count, 3 * scalar.size(), self.most)?;
        let length = 3 * count * scalar.size();
        let inline = &self.bytes[tag.end..];
        let inline = &inline[..inline
            .iter()
            .position(|&b| b == b'<')
            .unwrap_or(inline.len())];
        let base64 = |text: &[u8]| {
            // In front of the data, or of each of its blocks, there is a number of 8 bytes at most.
            let most = length.saturating_mul(2).saturating_add(1 << 16);
            of_base64(text, most).ok_or_else(|| header(0, "an array is no base64"))
        };
        let data = match tag.get(b"format") {
            Some(b"ascii") => return ascii(inline, count),
            Some(b"binary") => self.packing.unpack(&base64(inline)?, length)?,
            Some(b"appended") => {
                let (data, is_base64) = self
                    .appended
                    .ok_or_else(|| header(0, "AppendedData is missing"))?;
                let offset = tag.number(b"offset").unwrap_or(0);
                let data = data.get(offset..).unwrap_or_default();
                if is_base64 {
                    self.packing.unpack(&base64(data)?, length)?
                } else {
                    self.packing.unpack(data, length)?
                }
            }
            _ => {
                return Err(header(
                    0,
                    "the format of an array must be ascii, binary or appended",
                ));
            }
        };
        Ok(numbers(&data, scalar, self.packing.order))
    }
}

fn ascii(text: &[u8], count: usize) -> Result<Numbers, Error> {
    let words = text
        .split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty());
    let numbers: Option<Numbers> = words.take(3 * count).map(parse).collect();
    let numbers = numbers.ok_or_else(|| header(0, "an array has a word that is no number"))?;
    enough("the points of a piece", count, 3, numbers.len())?;
    Ok(numbers)
}
