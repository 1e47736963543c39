//! The formats and how a file shows which one it is.

use serde::{Deserialize, Serialize};

use super::collector::Collector;
use super::private::{Place, lines, table, vtk as texts_of_vtk};
use super::text::Lines;
use super::{Error, Limits, foreign, npy, obj, off, pcd, ply, stl, vtk, xyz};
use crate::reconstruction::medical::{self, Reading, Segmentation};

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
    /// A label map in one file of NIfTI-1 or -2.
    Nifti,
    /// A label map in NRRD, or a segmentation of 3D Slicer in it.
    Nrrd,
    /// A label map in `MetaImage` with its data in the same file.
    Mha,
    /// A segmentation or a structure set of DICOM.
    Dicom,
    /// Polygon data in a legacy file of VTK; its points.
    Vtk,
    /// Polygon data of VTK in XML; its points.
    Vtp,
}

/// What a file of a format becomes.
#[derive(Clone, Copy)]
pub(super) enum Reader {
    /// Points.
    Points(for<'l> fn(&[u8], &'l Limits) -> Result<Collector<'l>, Error>),
    /// A stack of slices, one part of which becomes points.
    Slices(for<'a> fn(&'a [u8], &Reading) -> Result<Segmentation<'a>, Error>),
}

/// All that is particular to a format.
struct Row {
    format: Format,
    name: &'static str,
    /// Endings of file names, `.gz` aside; the first is written.
    endings: &'static [&'static str],
    media_types: &'static [&'static str],
    /// Whether the content shows it; asked in the order of the table.
    recognise: fn(&[u8]) -> bool,
    read: Reader,
    clean: Cleaner,
}

/// How the texts of an unpacked file are found.
#[derive(Clone, Copy)]
pub(super) enum Cleaner {
    /// Their places.
    Places(fn(&[u8]) -> Result<Vec<Place>, Error>),
    /// Overwritten and counted, for a format that packs them.
    Whole(fn(&mut Vec<u8>, &Limits) -> Result<u64, Error>),
}

const FORMATS: &[Row] = &[
    Row {
        format: Format::Npy,
        name: "npy",
        endings: &["npy"],
        media_types: &["application/x-npy"],
        recognise: |bytes| bytes.starts_with(b"\x93NUMPY"),
        read: Reader::Points(npy::read),
        clean: Cleaner::Places(npy::texts),
    },
    Row {
        format: Format::Nrrd,
        name: "nrrd",
        endings: &["nrrd"],
        media_types: &["application/x-nrrd", "image/x-nrrd"],
        recognise: medical::is_nrrd,
        read: Reader::Slices(medical::nrrd),
        clean: Cleaner::Places(medical::texts_of_nrrd),
    },
    Row {
        format: Format::Nifti,
        name: "nifti",
        endings: &["nii", "nifti"],
        media_types: &["application/x-nifti", "application/nifti", "image/x-nifti"],
        recognise: medical::is_nifti,
        read: Reader::Slices(medical::nifti),
        clean: Cleaner::Places(medical::texts_of_nifti),
    },
    Row {
        format: Format::Dicom,
        name: "dicom",
        endings: &["dcm", "dicom", "dic"],
        media_types: &["application/dicom"],
        recognise: medical::is_dicom,
        read: Reader::Slices(medical::dicom),
        clean: Cleaner::Whole(medical::clean_dicom),
    },
    Row {
        format: Format::Mha,
        name: "mha",
        endings: &["mha", "mhd"],
        media_types: &["application/x-metaimage"],
        recognise: medical::is_metaimage,
        read: Reader::Slices(medical::metaimage),
        clean: Cleaner::Places(medical::texts_of_metaimage),
    },
    Row {
        format: Format::Vtk,
        name: "vtk",
        endings: &["vtk"],
        media_types: &["application/x-vtk"],
        recognise: vtk::is_legacy,
        read: Reader::Points(vtk::read_legacy),
        clean: Cleaner::Places(|bytes| Ok(texts_of_vtk::of_legacy(bytes))),
    },
    Row {
        format: Format::Vtp,
        name: "vtp",
        endings: &["vtp"],
        media_types: &["application/x-vtp"],
        recognise: vtk::is_xml,
        read: Reader::Points(vtk::read_xml),
        clean: Cleaner::Places(|bytes| Ok(texts_of_vtk::of_xml(bytes))),
    },
    Row {
        format: Format::Ply,
        name: "ply",
        endings: &["ply"],
        media_types: &["application/x-ply", "application/ply", "model/ply"],
        recognise: |bytes| {
            bytes.starts_with(b"ply") && bytes.get(3).is_some_and(u8::is_ascii_whitespace)
        },
        read: Reader::Points(ply::read),
        clean: Cleaner::Places(ply::texts),
    },
    Row {
        format: Format::Stl,
        name: "stl",
        endings: &["stl"],
        media_types: &["model/stl", "application/sla", "application/vnd.ms-pki.stl"],
        recognise: |bytes| stl::has_binary_length(bytes) || is_text_of_stl(bytes),
        read: Reader::Points(stl::read),
        clean: Cleaner::Places(|bytes| Ok(lines::of_stl(bytes))),
    },
    Row {
        format: Format::Pcd,
        name: "pcd",
        endings: &["pcd"],
        media_types: &["application/x-pcd", "model/pcd"],
        recognise: |bytes| {
            const WORDS: [&[u8]; 4] = [b"VERSION", b"FIELDS", b"version", b"fields"];
            bytes.starts_with(b"# .PCD") || begins_with_word(bytes, |word| WORDS.contains(&word))
        },
        read: Reader::Points(pcd::read),
        clean: Cleaner::Places(pcd::texts),
    },
    Row {
        format: Format::Obj,
        name: "obj",
        endings: &["obj"],
        media_types: &["model/obj", "application/x-obj"],
        recognise: |bytes| {
            const WORDS: [&[u8]; 9] = [
                b"v", b"vn", b"vt", b"vp", b"o", b"g", b"s", b"mtllib", b"usemtl",
            ];
            begins_with_word(bytes, |word| WORDS.contains(&word))
        },
        read: Reader::Points(obj::read),
        clean: Cleaner::Places(|bytes| Ok(lines::of_obj(bytes))),
    },
    Row {
        format: Format::Off,
        name: "off",
        endings: &["off"],
        media_types: &["application/x-off", "model/off"],
        recognise: |bytes| begins_with_word(bytes, |word| off::keyword(word).is_some()),
        read: Reader::Points(off::read),
        clean: Cleaner::Places(|bytes| Ok(lines::of_off(bytes))),
    },
    Row {
        format: Format::Xyz,
        name: "xyz",
        endings: &[
            "xyz", "xyzn", "xyzrgb", "xyzi", "txt", "csv", "tsv", "asc", "pts", "ptx", "fcsv",
            "dat", "neu",
        ],
        media_types: &["text/csv", "text/tab-separated-values", "application/csv"],
        // Numbers are no mark: a table is what nothing else claims.
        recognise: |_| false,
        read: Reader::Points(xyz::read),
        clean: Cleaner::Places(table::texts),
    },
];

/// Looked at to tell formats apart; their marks stand at the very beginning.
const HEAD: usize = 4096;

/// Looked at to recognise a table, whose rows may stand below many lines of words.
const TABLE_HEAD: usize = 1 << 16;

impl Format {
    fn row(self) -> &'static Row {
        let row = FORMATS.iter().find(|row| row.format == self);
        // A test holds that each format has its row.
        row.unwrap_or(&FORMATS[0])
    }

    /// The format that a file name's ending stands for, `.gz` aside.
    pub fn from_extension(name: &str) -> Option<Self> {
        let name = name.to_ascii_lowercase();
        let name = name.strip_suffix(".gz").unwrap_or(&name);
        let ending = name.rsplit_once('.')?.1;
        let row = FORMATS.iter().find(|row| row.endings.contains(&ending));
        row.map(|row| row.format)
    }

    /// The format that a media type names, as far as it names one.
    pub fn from_media_type(essence: &str) -> Option<Self> {
        let essence = essence.trim().to_ascii_lowercase();
        let row = FORMATS
            .iter()
            .find(|row| row.media_types.contains(&essence.as_str()));
        row.map(|row| row.format)
    }

    /// Stable `snake_case` name.
    pub fn name(self) -> &'static str {
        self.row().name
    }

    /// The ending of a file's name.
    pub fn extension(self) -> &'static str {
        self.row().endings[0]
    }

    /// How a file of the format is read.
    pub(super) fn reader(self) -> Reader {
        self.row().read
    }

    /// How texts of a file of the format are overwritten.
    pub(super) fn cleaner(self) -> Cleaner {
        self.row().clean
    }

    /// Whether a file of the format holds slices of something, of which a part is to be chosen.
    pub fn has_slices(self) -> bool {
        matches!(self.reader(), Reader::Slices(_))
    }

    /// The format of a file: by its content; where that leaves it open the one that is hinted at; and
    /// if there is no hint, or it names a format whose mark is not there, a table if there are
    /// rows of numbers.
    pub(in crate::reconstruction) fn detect(
        bytes: &[u8],
        hint: Option<Self>,
    ) -> Result<Self, Error> {
        if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
            let detail = "the file is UTF-16 text; save it as UTF-8 or ASCII";
            return Err(Error::UnsupportedFormat(detail.to_owned()));
        }
        if let Some(format) = Self::seen(bytes) {
            return Ok(format);
        }
        if let Some(detail) = foreign::refusal(bytes) {
            return Err(Error::UnsupportedFormat(detail));
        }
        match hint {
            // OFF needs no mark.
            Some(format @ (Self::Xyz | Self::Off)) if foreign::is_text(bytes) => Ok(format),
            named => {
                let head = &bytes[..bytes.len().min(TABLE_HEAD)];
                let table = xyz::is_table(head).then_some(Self::Xyz);
                // What is no text can only be a format with a mark.
                let named = named.filter(|named| !matches!(named, Self::Xyz | Self::Off));
                let unknown = || Error::UnsupportedFormat(foreign::unknown(bytes));
                table.or(named).ok_or_else(unknown)
            }
        }
    }

    /// The format that the beginning of an unpacked file shows.
    pub fn seen(bytes: &[u8]) -> Option<Self> {
        let row = FORMATS.iter().find(|row| (row.recognise)(bytes));
        row.map(|row| row.format)
    }
}

/// Whether the first word of a text is one that is looked for.
fn begins_with_word(bytes: &[u8], is: impl Fn(&[u8]) -> bool) -> bool {
    let head = &bytes[..bytes.len().min(HEAD)];
    let line = Lines::new(head, 0).content().next();
    line.and_then(|line| line.tokens().next()).is_some_and(is)
}

/// Whether a text begins as an STL and goes on as one.
fn is_text_of_stl(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(HEAD)];
    let line = Lines::new(head, 0).content().next();
    line.is_some_and(|line| stl::starts_as_text(line.bytes)) && has_facet(head)
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
    fn each_format_has_one_row() {
        for (i, row) in FORMATS.iter().enumerate() {
            assert_eq!(row.format.name(), row.name);
            let named = Format::from_extension(&format!("cloud.{}", row.name));
            assert_eq!(named, Some(row.format), "its name is an ending");
            let others = || FORMATS.iter().skip(i + 1);
            assert!(others().all(|other| other.format != row.format));
            for ending in row.endings {
                assert!(
                    others().all(|other| !other.endings.contains(ending)),
                    "{ending}"
                );
            }
        }
        let json = |format| serde_json::to_value(format).unwrap();
        assert!(FORMATS.iter().all(|row| json(row.format) == row.name));
    }

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
        let format = |bytes: &[u8], name: Option<&str>| {
            Format::detect(bytes, name.and_then(Format::from_extension)).ok()
        };
        assert_eq!(format(b"ply\nformat", Some("a.txt")), Some(Format::Ply));
        assert_eq!(format(b"# note\nOFF\n", Some("a.txt")), Some(Format::Off));
        assert_eq!(format(b"# note\n\nv 1 2 3\n", None), Some(Format::Obj));
        assert_eq!(format(b"1 2 3\n", Some("a.off")), Some(Format::Off));
        assert_eq!(format(b"x,y,z\n1,2,3\n", None), Some(Format::Xyz));
        assert_eq!(format(b"PK\x03\x04\0\0", Some("a.zip")), None);
        assert_eq!(format(b"\xff\xfe1\0 \0", Some("a.xyz")), None);
    }
}
