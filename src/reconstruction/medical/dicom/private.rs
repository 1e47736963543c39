//! What may name somebody in a data set: everything but geometry, and what segments are called.
//!
//! The names of patients, physicians, places and devices, all dates, and what programs keep in elements of
//! their own are overwritten; identifiers become others, so that what refers to one another still does.

use std::io::Write;

use flate2::Compression;
use flate2::write::DeflateEncoder;

use super::parser::{self, Leaf};
use super::syntax::{self, Syntax};
use super::{MARK, PREAMBLE, has_mark, tags};
use crate::reconstruction::cloud::private::{Fill, Place, overwrite};
use crate::reconstruction::cloud::{Error, Limits};

/// Types of text.
const TEXTS: [&[u8; 2]; 13] = [
    b"PN", b"LO", b"SH", b"ST", b"LT", b"UT", b"UC", b"AE", b"AS", b"DA", b"DT", b"TM", b"UR",
];

/// Types of words and of numbers in text, which name nobody outside of some groups.
const WORDS: [&[u8; 2]; 3] = [b"CS", b"DS", b"IS"];

/// Types that may hold anything.
const ANYTHING: [&[u8; 2]; 2] = [b"OB", b"UN"];

/// The group of the patient.
const PATIENT: u32 = 0x0010;

/// Labels that whoever made the file could choose, as words.
const CHOSEN: [u32; 1] = [0x0070_0080];

/// What is kept of any type: what is read, and what other programs need to read the same.
const KEPT: [u32; 54] = [
    0x0002_0001, // FileMetaInformationVersion
    tags::TRANSFER_SYNTAX,
    0x0002_0012, // ImplementationClassUID
    tags::CHARACTER_SET,
    0x0008_0008, // ImageType
    tags::SOP_CLASS,
    tags::MODALITY,
    0x0008_1160, // ReferencedFrameNumber
    tags::SLICE_THICKNESS,
    0x0018_0088, // SpacingBetweenSlices
    tags::IMAGE_POSITION,
    tags::IMAGE_ORIENTATION,
    0x0020_9157, // DimensionIndexValues
    0x0020_9165, // DimensionIndexPointer
    0x0020_9167, // FunctionalGroupPointer
    0x0028_0002, // SamplesPerPixel
    0x0028_0004, // PhotometricInterpretation
    tags::FRAMES,
    tags::ROWS,
    tags::COLUMNS,
    tags::PIXEL_SPACING,
    tags::BITS_ALLOCATED,
    0x0028_0101, // BitsStored
    0x0028_0102, // HighBit
    0x0028_0103, // PixelRepresentation
    tags::PIXEL_PADDING,
    0x0028_2110, // LossyImageCompression
    tags::TOTAL_PIXEL_MATRIX_COLUMNS,
    0x0048_0007, // TotalPixelMatrixRows
    tags::SEGMENTATION_TYPE,
    tags::SEGMENT_NUMBER,
    tags::SEGMENT_LABEL,
    0x0062_0008, // SegmentAlgorithmType
    0x0062_0009, // SegmentAlgorithmName
    tags::REFERENCED_SEGMENT,
    tags::RECOMMENDED_COLOR,
    tags::MAXIMUM_FRACTION,
    0x0062_0010, // SegmentationFractionalType
    0x0062_0013, // SegmentsOverlap
    tags::ROI_NUMBER,
    tags::ROI_NAME,
    tags::ROI_COLOR,
    0x3006_002c, // ROIVolume
    0x3006_0036, // ROIGenerationAlgorithm
    tags::CONTOUR_TYPE,
    0x3006_0044, // ContourSlabThickness
    0x3006_0046, // NumberOfContourPoints
    0x3006_0048, // ContourNumber
    tags::CONTOUR_DATA,
    0x3006_0082, // ObservationNumber
    tags::REFERENCED_ROI,
    0x3006_0085, // ROIObservationLabel
    0x3006_00a4, // RTROIInterpretedType
    tags::PIXEL_DATA,
];

/// Codes, which are kept where they tell what a segment or a region is.
const CODES: [u32; 7] = [
    0x0008_0100, // CodeValue
    0x0008_0102, // CodingSchemeDesignator
    0x0008_0103, // CodingSchemeVersion
    0x0008_0104, // CodeMeaning
    0x0008_0119, // LongCodeValue
    0x0008_0120, // URNCodeValue
    0x0008_0105, // MappingResource
];

/// Sequences of codes of the anatomy.
const ANATOMY: [u32; 4] = [0x0008_2218, 0x0008_2220, 0x0008_2228, 0x0008_2230];

/// Groups of segments and of regions of interest.
const NAMED: [u32; 2] = [0x0062, 0x3006];

/// The longest value that is a number or a few, where no types are told.
const LONGEST_NUMBERS: usize = 16;

/// Overwrites the texts of a file, and counts them.
///
/// # Errors
/// As [`super::read`].
pub(in crate::reconstruction) fn clean(bytes: &mut Vec<u8>, limits: &Limits) -> Result<u64, Error> {
    let start = if has_mark(bytes) {
        PREAMBLE + MARK.len()
    } else {
        0
    };
    let (syntax, body) = syntax::meta(&bytes[start..])?;
    let body = bytes.len() - body.len();
    let mut places = texts(&bytes[start..body], true)?;
    shift(&mut places, start);
    if start > 0 {
        places.push(Place::new(0..PREAMBLE, Fill::Zeros));
    }
    if syntax == Syntax::Deflated {
        let mut inflated = syntax::inflated(&bytes[body..], limits.max_expanded_bytes)?;
        let inside = texts(&inflated, true)?;
        let count = overwrite(&mut inflated, &inside);
        if count > 0 {
            bytes.truncate(body);
            deflate(&inflated, bytes)?;
        }
        return Ok(count + overwrite(bytes, &places));
    }
    let mut inside = texts(&bytes[body..], syntax.is_explicit())?;
    shift(&mut inside, body);
    places.append(&mut inside);
    Ok(overwrite(bytes, &places))
}

fn shift(places: &mut [Place], by: usize) {
    for Place { range, .. } in places {
        *range = range.start + by..range.end + by;
    }
}

fn deflate(bytes: &[u8], into: &mut Vec<u8>) -> Result<(), Error> {
    let mut encoder = DeflateEncoder::new(&mut *into, Compression::default());
    let ended = encoder.write_all(bytes).and_then(|()| encoder.finish());
    ended.map_err(|error| Error::Compression(error.to_string()))?;
    if !into.len().is_multiple_of(2) {
        into.push(0);
    }
    Ok(())
}

/// The texts of a data set.
fn texts(bytes: &[u8], explicit: bool) -> Result<Vec<Place>, Error> {
    let mut places = Vec::new();
    parser::leaves(bytes, explicit, &mut |leaf| add(&leaf, bytes, &mut places))?;
    Ok(places)
}

fn add(leaf: &Leaf<'_>, bytes: &[u8], places: &mut Vec<Place>) {
    let Some(tag) = leaf.tag.filter(|tag| !is_kept(*tag, leaf.path)) else {
        if leaf.tag.is_none() {
            places.push(Place::new(leaf.range.clone(), Fill::Zeros));
        }
        return;
    };
    let value = &bytes[leaf.range.clone()];
    let is_closed = is_private(tag) || tag >> 16 == PATIENT || CHOSEN.contains(&tag);
    let fill = match leaf.kind {
        Some(kind) if TEXTS.contains(&&kind) => Some(Fill::Blanks),
        Some(kind) if kind == *b"UI" => Some(Fill::Identifier),
        Some(kind) if WORDS.contains(&&kind) => is_closed.then_some(Fill::Blanks),
        Some(kind) => (is_closed || ANYTHING.contains(&&kind)).then_some(Fill::Zeros),
        None if value.starts_with(&[0xfe, 0xff, 0x00, 0xe0]) => {
            return add_items(leaf, tag, bytes, places);
        }
        None if is_identifier(value) => Some(Fill::Identifier),
        None if is_text(value) => Some(Fill::Blanks),
        None => (is_closed || value.len() > LONGEST_NUMBERS).then_some(Fill::Zeros),
    };
    places.extend(fill.map(|fill| Place::new(leaf.range.clone(), fill)));
}

/// The texts of a sequence that is not told to be one.
fn add_items(leaf: &Leaf<'_>, tag: u32, bytes: &[u8], places: &mut Vec<Place>) {
    let value = &bytes[leaf.range.clone()];
    let path: Vec<u32> = leaf.path.iter().copied().chain([tag]).collect();
    let mut inside = Vec::new();
    let walked = parser::leaves_of_items(value, &path, &mut |leaf| add(&leaf, value, &mut inside));
    if walked.is_ok() {
        shift(&mut inside, leaf.range.start);
        places.append(&mut inside);
    } else {
        places.push(Place::new(leaf.range.clone(), Fill::Zeros));
    }
}

fn is_kept(tag: u32, path: &[u32]) -> bool {
    // Lengths of groups are numbers that no program needs any more, and must be right.
    let is_length = tag.trailing_zeros() >= 16;
    let is_named = |tag: &u32| NAMED.contains(&(tag >> 16)) || ANATOMY.contains(tag);
    is_length || KEPT.contains(&tag) || CODES.contains(&tag) && path.iter().any(is_named)
}

fn is_private(tag: u32) -> bool {
    tag >> 16 & 1 == 1
}

/// Whether a value of no type is an identifier: numbers with points between them.
fn is_identifier(value: &[u8]) -> bool {
    let numbers = value.split(|&byte| byte == b'.').count();
    let is_of_one = |byte: &u8| byte.is_ascii_digit() || b".\\\0 ".contains(byte);
    numbers > 2 && value.iter().all(is_of_one)
}

/// Whether a value of no type may be text.
fn is_text(value: &[u8]) -> bool {
    let value = value.strip_suffix(b"\0").unwrap_or(value);
    let is_of_text = |byte: &u8| *byte >= b' ' || b"\t\n\x0c\r\x1b".contains(byte);
    value.iter().all(is_of_text)
}
