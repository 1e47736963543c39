//! The formats and how a file shows which one it is.

use serde::{Deserialize, Serialize};

use super::text::Lines;
use super::{Error, foreign};

/// A format that clouds are read from; each may be gzipped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// Stanford polygon file, ASCII or binary.
    Ply,
    /// A table of numbers: `.xyz`, `.txt`, `.csv`, `.tsv`, `.asc`, `.pts`, `.ptx` and their kin.
    Xyz,
    /// Wavefront OBJ; its vertices.
    Obj,
    /// Object file format of Geomview; its vertices.
    Off,
    /// Stereolithography, ASCII or binary; its vertices.
    Stl,
    /// Point Cloud Library, ASCII, binary or compressed.
    Pcd,
    /// An array of NumPy.
    Npy,
}

/// Looked at to tell formats apart; their marks stand at the very beginning.
const HEAD: usize = 4096;

/// Looked at to recognise a table, whose rows may stand below many lines of words.
const TABLE_HEAD: usize = 1 << 16;

impl Format {
    /// The format that a file name's ending stands for, `.gz` aside.
    pub fn from_extension(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        Some(match name.rsplit_once('.')?.1 {
            "ply" => Self::Ply,
            "xyz" | "xyzn" | "xyzrgb" | "xyzi" | "txt" | "csv" | "tsv" | "asc" | "pts" | "ptx"
            | "fcsv" | "dat" | "neu" => Self::Xyz,
            "obj" => Self::Obj,
            "off" => Self::Off,
            "stl" => Self::Stl,
            "pcd" => Self::Pcd,
            "npy" => Self::Npy,
            _ => return None,
        })
    }

    /// Stable `snake_case` name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Xyz => "xyz",
            Self::Obj => "obj",
            Self::Off => "off",
            Self::Stl => "stl",
            Self::Pcd => "pcd",
            Self::Npy => "npy",
        }
    }

    /// The format of a file: by its content; where that leaves it open by the name's ending; and
    /// if that says nothing either, or names a format whose mark is not there, a table if there are
    /// rows of numbers.
    pub(in crate::reconstruction) fn detect(
        bytes: &[u8],
        name: Option<&str>,
    ) -> Result<Self, Error> {
        if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
            let detail = "the file is UTF-16 text; save it as UTF-8 or ASCII";
            return Err(Error::UnsupportedFormat(detail.to_owned()));
        }
        if let Some(format) = Self::from_content(bytes) {
            return Ok(format);
        }
        if let Some(detail) = foreign::refusal(bytes) {
            return Err(Error::UnsupportedFormat(detail));
        }
        match name.and_then(Self::from_extension) {
            // OFF needs no mark.
            Some(format @ (Self::Xyz | Self::Off)) if foreign::is_text(bytes) => Ok(format),
            named => {
                let head = &bytes[..bytes.len().min(TABLE_HEAD)];
                let table = super::xyz::is_table(head).then_some(Self::Xyz);
                // What is no text can only be a format with a mark.
                let named = named.filter(|named| !matches!(named, Self::Xyz | Self::Off));
                let unknown = || Error::UnsupportedFormat(foreign::unknown(bytes));
                table.or(named).ok_or_else(unknown)
            }
        }
    }

    fn from_content(bytes: &[u8]) -> Option<Self> {
        let head = &bytes[..bytes.len().min(HEAD)];
        if head.starts_with(b"\x93NUMPY") {
            return Some(Self::Npy);
        }
        if head.starts_with(b"ply") && head.get(3).is_some_and(u8::is_ascii_whitespace) {
            return Some(Self::Ply);
        }
        if head.starts_with(b"# .PCD") {
            return Some(Self::Pcd);
        }
        if super::stl::has_binary_length(bytes) {
            return Some(Self::Stl);
        }
        let line = Lines::new(head, 0).content().next()?;
        match line.tokens().next()? {
            _ if super::stl::starts_as_text(line.bytes) && has_facet(head) => Some(Self::Stl),
            b"VERSION" | b"FIELDS" | b"version" | b"fields" => Some(Self::Pcd),
            b"v" | b"vn" | b"vt" | b"vp" | b"o" | b"g" | b"s" | b"mtllib" | b"usemtl" => {
                Some(Self::Obj)
            }
            word if super::off::keyword(word).is_some() => Some(Self::Off),
            _ => None,
        }
    }
}

/// Whether an STL in text goes on as one.
fn has_facet(head: &[u8]) -> bool {
    let is_facet = |word: &[u8]| word.eq_ignore_ascii_case(b"facet");
    head.windows(5).any(is_facet)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_name_formats() {
        assert_eq!(
            Format::from_extension("a.b/cloud.PLY.gz"),
            Some(Format::Ply)
        );
        assert_eq!(Format::from_extension("cloud.csv"), Some(Format::Xyz));
        assert_eq!(Format::from_extension("cloud.gz"), None);
        assert_eq!(Format::from_extension("cloud"), None);
    }

    #[test]
    fn content_wins_over_the_name() {
        let format = |bytes: &[u8], name| Format::detect(bytes, name).ok();
        assert_eq!(format(b"ply\nformat", Some("a.txt")), Some(Format::Ply));
        assert_eq!(format(b"# note\nOFF\n", Some("a.txt")), Some(Format::Off));
        assert_eq!(format(b"# note\n\nv 1 2 3\n", None), Some(Format::Obj));
        assert_eq!(format(b"1 2 3\n", Some("a.off")), Some(Format::Off));
        assert_eq!(format(b"x,y,z\n1,2,3\n", None), Some(Format::Xyz));
        assert_eq!(format(b"PK\x03\x04\0\0", Some("a.zip")), None);
        assert_eq!(format(b"\xff\xfe1\0 \0", Some("a.xyz")), None);
    }
}
