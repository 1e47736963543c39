//! Points and normals of VTK's polygon data: the legacy files here, those in XML in `xml`.

mod arrays;
mod xml;

use super::binary::{ByteOrder, Scalar, enough};
use super::collector::Collector;
use super::text::{excerpt, parse};
use super::{Error, Limits};
use crate::reconstruction::space::Space;
use arrays::{Numbers, scalar};

pub(super) use xml::{Tags, is_xml, read as read_xml};

/// Lines before the data set: the mark, a title, how numbers are written.
const HEAD_LINES: usize = 3;

/// Whether a file begins as a legacy file does.
pub(super) fn is_legacy(bytes: &[u8]) -> bool {
    bytes.starts_with(b"# vtk DataFile Version")
}

/// Reads a legacy file.
pub(super) fn read_legacy<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let mut text = Text { bytes, at: 0 };
    let mut lines = [b"".as_slice(); HEAD_LINES];
    for line in &mut lines {
        *line = text.line();
    }
    let is_binary = match lines[2].to_ascii_uppercase().as_slice() {
        b"ASCII" => false,
        b"BINARY" => true,
        _ => return Err(header(3, "must be ASCII or BINARY")),
    };
    let data_set = text.word();
    let kind = text.word();
    if !data_set.eq_ignore_ascii_case(b"DATASET") || !kind.eq_ignore_ascii_case(b"POLYDATA") {
        return Err(Error::UnsupportedFormat(format!(
            "the VTK file holds {}, of which only POLYDATA is read; extract the surface and save it as PLY, for \
             instance with ParaView",
            excerpt(kind)
        )));
    }
    if !text.word().eq_ignore_ascii_case(b"POINTS") {
        return Err(Error::NoCoordinates(
            "POINTS must follow DATASET POLYDATA".to_owned(),
        ));
    }
    let count = text.count()?;
    let points = text.numbers(count, is_binary)?;
    let normals = text
        .find(b"\nPOINT_DATA")
        .and_then(|()| text.find(b"\nNORMALS"));
    let normals = match normals {
        Some(()) => {
            // The name comes before the type.
            text.word();
            Some(text.numbers(count, is_binary)?)
        }
        None => None,
    };
    // The title says it, as 3D Slicer writes it.
    let space = Space::from_tags(lines[1]);
    collect(limits, &[(points, normals)], space)
}

/// Pours the pieces of a file into a collector: points, and normals where all pieces have them.
fn collect<'l>(
    limits: &'l Limits,
    pieces: &[(Numbers, Option<Numbers>)],
    space: Space,
) -> Result<Collector<'l>, Error> {
    let with_normals = pieces.iter().all(|(_, normals)| normals.is_some());
    let mut collector = Collector::new(limits, with_normals, false);
    collector.space(space);
    let mut number = 0;
    for (points, normals) in pieces {
        for i in 0..points.len() / 3 {
            number += 1;
            let at =
                |numbers: &Numbers, axis| numbers.get(3 * i + axis).copied().unwrap_or(f64::NAN);
            let normal = |axis| normals.as_ref().map_or(0.0, |normals| at(normals, axis));
            let [x, y, z] = [0, 1, 2].map(|axis| at(points, axis));
            let row = [x, y, z, normal(0), normal(1), normal(2), 0.0];
            collector.push(&row, number)?;
        }
    }
    Ok(collector)
}

fn header(line: usize, detail: impl Into<String>) -> Error {
    Error::Header {
        line,
        detail: detail.into(),
    }
}

/// Words and numbers of a legacy file, one behind the other.
struct Text<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Text<'a> {
    fn left(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    /// The rest of the line, without blanks around it.
    fn line(&mut self) -> &'a [u8] {
        let left = self.left();
        let end = left.iter().position(|&b| b == b'\n').unwrap_or(left.len());
        self.at += (end + 1).min(left.len());
        left[..end].trim_ascii()
    }

    /// The next word; nothing at the end.
    fn word(&mut self) -> &'a [u8] {
        let left = self.left();
        let start = left.iter().position(|b| !b.is_ascii_whitespace());
        let start = start.unwrap_or(left.len());
        let word = &left[start..];
        let end = word
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(word.len());
        self.at += start + end;
        &word[..end]
    }

    fn count(&mut self) -> Result<usize, Error> {
        let word = self.word();
        let count = std::str::from_utf8(word)
            .ok()
            .and_then(|word| word.parse().ok());
        count.ok_or_else(|| header(5, format!("POINTS {} is no number", excerpt(word))))
    }

    /// Moves behind the next place of `mark` and says whether there is one.
    fn find(&mut self, mark: &[u8]) -> Option<()> {
        let found = self
            .left()
            .windows(mark.len())
            .position(|window| window == mark)?;
        self.at += found + mark.len();
        Some(())
    }

    /// A type, and three numbers of it for each of `count` points.
    fn numbers(&mut self, count: usize, is_binary: bool) -> Result<Numbers, Error> {
        let name = self.word();
        let scalar = scalar(name)
            .ok_or_else(|| header(5, format!("{} is no type of numbers", excerpt(name))))?;
        self.line();
        let what = "the coordinates of the points";
        // A digit and a blank are the least that a number takes.
        let size = if is_binary { 3 * scalar.size() } else { 6 };
        enough(what, count, size, self.left().len() + 1)?;
        if is_binary {
            enough(what, count, size, self.left().len())?;
            let data = &self.left()[..count * size];
            self.at += data.len();
            return Ok(arrays::numbers(data, scalar, ByteOrder::Big));
        }
        let mut numbers = Vec::new();
        for i in 0..3 * count {
            let word = self.word();
            if word.is_empty() {
                return Err(Error::Truncated {
                    what: what.to_owned(),
                    declared: count as u64,
                    found: (i / 3) as u64,
                });
            }
            let number = parse(word).ok_or_else(|| Error::Row {
                line: i / 3 + 1,
                detail: format!("{} is no number", excerpt(word)),
            })?;
            numbers.push(number);
        }
        Ok(numbers)
    }
}

/// The type of a name in XML: `Float32`, `UInt8`.
fn scalar_of_xml(name: &[u8]) -> Option<Scalar> {
    let name = std::str::from_utf8(name).ok()?;
    let kinds = [("Float", b'f'), ("Int", b'i'), ("UInt", b'u')];
    let of = |(start, kind): (&str, u8)| Some((kind, name.strip_prefix(start)?));
    let (kind, bits) = kinds.into_iter().find_map(of)?;
    let bits: usize = bits.parse().ok()?;
    bits.is_multiple_of(8).then(|| Scalar::of(kind, bits / 8))?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(text: &[u8]) -> Result<Vec<[f64; 3]>, Error> {
        let limits = Limits::default();
        Ok(read_legacy(text, &limits)?.finish()?.0.points)
    }

    #[test]
    fn text_and_binary_are_read_alike() {
        let text = b"# vtk DataFile Version 4.2\nname\nASCII\nDATASET POLYDATA\nPOINTS 2 float\n1 2 3 4\n5 6\n";
        let mut binary =
            b"# vtk DataFile Version 4.2\nname\nBINARY\nDATASET POLYDATA\nPOINTS 2 float\n"
                .to_vec();
        binary.extend(
            [1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0]
                .into_iter()
                .flat_map(f32::to_be_bytes),
        );
        let expected = vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
        assert_eq!(points(text).unwrap(), expected);
        assert_eq!(points(&binary).unwrap(), expected);
        assert!(points(&binary[..binary.len() - 1]).is_err());
        assert!(points(&text[..text.len() - 2]).is_err());
    }

    #[test]
    fn types_of_xml_have_sizes() {
        assert_eq!(scalar_of_xml(b"Float64"), Some(Scalar::F64));
        assert_eq!(scalar_of_xml(b"UInt8"), Some(Scalar::U8));
        assert_eq!(scalar_of_xml(b"String"), None);
    }
}
