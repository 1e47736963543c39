//! The header of a PLY file: checked and cleaned by us, then parsed by `ply-rs`.
//!
//! `ply-rs` 0.1.3 panics on numbers beyond u64, reads lines of any length, merges properties of one
//! name, and refuses blank lines, indentation, comments that are not UTF-8 and types that are in use
//! beside the standard. So it is shown only headers of bounded size and plain content; elements
//! without properties, which have no data, are kept from it.

use std::collections::HashSet;
use std::ops::Range;

use ply_rs::parser::Parser;
use ply_rs::ply::{DefaultElement, Encoding};

use super::body::{Binary, Body, Text};
use super::element::{Element, Kind};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar};
use crate::reconstruction::cloud::columns::Columns;
use crate::reconstruction::cloud::text::excerpt;
use crate::reconstruction::space::Space;

/// Most bytes of a header.
pub const MAX_HEADER_BYTES: usize = 64 << 10;
/// Most bytes of a line, comments aside.
const MAX_LINE: usize = 1 << 10;
const MAX_ELEMENTS: usize = 16;
/// Semantics, Gaussian splats and neural features take hundreds.
const MAX_PROPERTIES: usize = 4096;
/// Digits of a count; ten are beyond what u32 indices of faces could address.
const MAX_DIGITS: usize = 10;

/// What a header declares, and where the data after it begin.
#[derive(Debug)]
pub(in crate::reconstruction) struct Header {
    /// In the order of their data.
    pub(in crate::reconstruction) elements: Vec<Element>,
    /// What the comments say of the coordinates.
    pub(in crate::reconstruction) space: Space,
    encoding: Encoding,
    /// Where the texts of the comments are.
    pub(super) comments: Vec<Range<usize>>,
    bytes: usize,
    lines: usize,
}

impl Header {
    /// Reads the header at the start of `bytes`.
    pub(in crate::reconstruction) fn read(bytes: &[u8]) -> Result<Self, Error> {
        let (check, bytes) = check(bytes)?;
        let Check {
            cleaned,
            number: lines,
            types,
            comments,
            places,
            ..
        } = check;
        let definition = Parser::<DefaultElement>::new()
            .read_header(&mut cleaned.as_bytes())
            // Each line has been accepted by itself: what is left is a contradiction between them.
            .map_err(|_| Error::Header {
                line: lines,
                detail: "expected one format and properties after their elements".to_owned(),
            })?;
        let elements = definition.elements.values().map(Element::new);
        let mut elements: Vec<_> = elements.collect::<Result<_, _>>()?;
        for (element, property, scalar) in types {
            if let Some(property) = elements[element].properties.get_mut(property) {
                property.kind = match property.kind {
                    Kind::Scalar(_) => Kind::Scalar(scalar),
                    Kind::List(length, _) => Kind::List(length, scalar),
                };
            }
        }
        Ok(Self {
            elements,
            space: Space::from_tags(&comments),
            encoding: definition.encoding,
            comments: places,
            bytes,
            lines,
        })
    }

    /// What the columns of the vertices hold.
    pub(in crate::reconstruction) fn vertex_columns(&self) -> Result<Columns, Error> {
        let vertex = self.elements.iter().find(|element| element.is_vertex());
        vertex.and_then(Element::columns).ok_or_else(|| {
            let detail = "the file has no element \"vertex\" with properties x, y and z";
            Error::NoCoordinates(detail.to_owned())
        })
    }

    /// The data in `file`, which this is the header of.
    pub(in crate::reconstruction) fn body<'a>(&self, file: &'a [u8]) -> Body<'a> {
        let rest = &file[self.bytes..];
        let binary = |order| Body::Binary(Binary { rest, order });
        match self.encoding {
            Encoding::Ascii => Body::Text(Text::new(rest, self.lines)),
            Encoding::BinaryLittleEndian => binary(ByteOrder::Little),
            Encoding::BinaryBigEndian => binary(ByteOrder::Big),
        }
    }
}

/// The type of an element's property that `ply-rs` has no word for: element, property, type.
type OwnType = (usize, usize, Scalar);

/// The header at the start of `bytes`, checked, and its number of bytes.
fn check(bytes: &[u8]) -> Result<(Check, usize), Error> {
    let mut check = Check::default();
    // Lines end as the first one does; a binary body may begin with any byte, also a line feed.
    let end = match bytes.get(3..5) {
        Some([b'\r', second]) if *second != b'\n' => b'\r',
        _ => b'\n',
    };
    let mut position = 0;
    while !check.complete {
        let rest = &bytes[position..bytes.len().min(MAX_HEADER_BYTES)];
        let most = if is_comment(rest) {
            MAX_HEADER_BYTES
        } else {
            MAX_LINE
        };
        let Some(length) = rest.iter().take(most).position(|&b| b == end) else {
            let detail = if rest.len() >= most {
                format!("a line of the header has more than {MAX_LINE} bytes")
            } else if bytes.len() > MAX_HEADER_BYTES {
                format!("the header has more than {MAX_HEADER_BYTES} bytes")
            } else {
                "the header ends without \"end_header\"".to_owned()
            };
            return Err(check.error(&detail, rest));
        };
        let line = &rest[..length];
        check.line(line)?;
        if is_comment(line) {
            let indent = length - line.trim_ascii_start().len();
            let word = line[indent..].iter().position(u8::is_ascii_whitespace);
            let start = position + indent + word.unwrap_or(length - indent);
            check.places.push(start..position + length);
        }
        position += length + 1;
    }
    Ok((check, position))
}

fn is_comment(line: &[u8]) -> bool {
    let line = line.trim_ascii_start();
    line.starts_with(b"comment") || line.starts_with(b"obj_info")
}

/// The state of the check after some lines.
#[derive(Default)]
struct Check {
    /// What `ply-rs` gets to see, line for line.
    cleaned: String,
    number: usize,
    /// The line of an element that has no properties yet.
    pending: Option<String>,
    /// Names of the elements that have properties, with the number of these.
    elements: Vec<(String, usize)>,
    /// Names of the properties of the last one.
    properties: HashSet<String>,
    types: Vec<OwnType>,
    /// All comments, with blanks between them.
    comments: Vec<u8>,
    /// Where their texts are.
    places: Vec<Range<usize>>,
    complete: bool,
}

impl Check {
    fn line(&mut self, bytes: &[u8]) -> Result<(), Error> {
        self.number += 1;
        let mut words: Vec<String> = bytes
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty())
            .map(clean)
            .collect();
        if let [keyword, .., name] = words.as_mut_slice()
            && keyword == "property"
        {
            *name = identifier(name);
        }
        match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
            [] | ["comment" | "obj_info", ..] => {
                self.comments.extend_from_slice(bytes);
                self.comments.push(b' ');
                self.cleaned.push_str("comment\n");
                return Ok(());
            }
            ["ply"] if self.number == 1 => {}
            ["format", _, "1.0"] => {}
            ["element", name, count] => return self.element(name, count, bytes),
            ["property", ..] => self.property(&mut words, bytes)?,
            ["end_header"] => self.complete = true,
            _ => return Err(self.error("expected a line of a PLY header", bytes)),
        }
        self.show(&words.join(" "), bytes)
    }

    /// Shows `ply-rs` a line, if it takes it.
    fn show(&mut self, line: &str, bytes: &[u8]) -> Result<(), Error> {
        if Parser::<DefaultElement>::new()
            .read_header_line(line)
            .is_err()
        {
            return Err(self.error("expected a line of a PLY header", bytes));
        }
        self.cleaned.push_str(line);
        self.cleaned.push('\n');
        Ok(())
    }

    /// Keeps an element back until it has a property: without, it has no data.
    fn element(&mut self, name: &str, count: &str, line: &[u8]) -> Result<(), Error> {
        if count.len() > MAX_DIGITS || !count.bytes().all(|b| b.is_ascii_digit()) {
            return Err(self.error("expected a count of at most 10 digits", line));
        }
        if self.elements.len() == MAX_ELEMENTS {
            return Err(self.error("more than 16 elements", line));
        }
        if self.elements.iter().any(|(known, _)| known == name) {
            return Err(self.error("two elements of one name", line));
        }
        self.pending = Some(format!("element {name} {count}"));
        Ok(())
    }

    /// Takes a property, under a name and a type that `ply-rs` tells apart and knows.
    fn property(&mut self, words: &mut [String], line: &[u8]) -> Result<(), Error> {
        if let Some(element) = self.pending.take() {
            self.show(&element, line)?;
            let name = element.split(' ').nth(1).unwrap_or_default();
            self.elements.push((name.to_owned(), 0));
            self.properties.clear();
        }
        let element = self.elements.len().checked_sub(1);
        let Some((element, (_, count))) = element.zip(self.elements.last_mut()) else {
            return Err(self.error("a property before the first element", line));
        };
        if *count == MAX_PROPERTIES {
            return Err(self.error("more than 4096 properties", line));
        }
        *count += 1;
        let property = *count - 1;
        let [.., kind, name] = words else {
            return Err(self.error("expected a line of a PLY header", line));
        };
        if let Some((scalar, stand_in)) = own_type(kind) {
            self.types.push((element, property, scalar));
            stand_in.clone_into(kind);
        }
        // Of two properties of one name the first counts.
        if !self.properties.insert(name.clone()) {
            *name = format!("again_{property}_{name}");
            self.properties.insert(name.clone());
        }
        Ok(())
    }

    fn error(&self, detail: &str, line: &[u8]) -> Error {
        let found = match line.trim_ascii() {
            [] => String::new(),
            line => format!(", found \"{}\"", excerpt(line)),
        };
        Error::Header {
            line: self.number.max(1),
            detail: format!("{detail}{found}"),
        }
    }
}

/// Types that are in use beside the standard, and what stands for them before `ply-rs`.
fn own_type(word: &str) -> Option<(Scalar, &'static str)> {
    Some(match word {
        "int64" | "long" | "longlong" => (Scalar::I64, "double"),
        "uint64" | "ulong" | "ulonglong" => (Scalar::U64, "double"),
        "bool" | "boolean" => (Scalar::U8, "uchar"),
        "float16" | "half" => (Scalar::F16, "float"),
        _ => return None,
    })
}

/// A name of a property as `ply-rs` takes it: no dots, and a letter first.
fn identifier(name: &str) -> String {
    let prefix = match name.as_bytes() {
        [first, ..] if first.is_ascii_alphabetic() => "",
        _ => "_",
    };
    format!("{prefix}{}", name.replace('.', "_"))
}

/// A word with characters that `ply-rs` does not take replaced.
fn clean(word: &[u8]) -> String {
    let known = |&b: &u8| {
        if b.is_ascii_alphanumeric() || b"_-.".contains(&b) {
            char::from(b)
        } else {
            '_'
        }
    };
    word.iter().map(known).collect()
}
