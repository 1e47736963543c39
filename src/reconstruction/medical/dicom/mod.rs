//! DICOM: segmentations (SEG) and radiotherapy structure sets (RT-STRUCT).
//!
//! Of the data set only the geometry and what segments are called is looked at, and patient and study where the
//! user asks for them.

mod charset;
mod contours;
mod element;
mod frames;
mod identity;
mod parser;
mod pixels;
mod planes;
mod private;
mod segments;
mod structures;
mod syntax;
mod tags;

use std::borrow::Cow;

use super::{Reading, Segmentation};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::slices::Identifiers;
use element::DataSet;
use syntax::Syntax;

pub(in crate::reconstruction) use private::clean;

/// Behind this many bytes of anything the mark of a file stands.
const PREAMBLE: usize = 128;

const MARK: &[u8] = b"DICM";

/// What a data set is of, by its SOP class.
const CLASSES: &[(&str, Class)] = &[
    ("1.2.840.10008.5.1.4.1.1.66.4", Class::Segments),
    ("1.2.840.10008.5.1.4.1.1.66.7", Class::Segments),
    ("1.2.840.10008.5.1.4.1.1.481.3", Class::Structures),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Class {
    Segments,
    Structures,
}

/// Whether a file is DICOM, with its mark or, as some programs write it, a data set alone.
pub(in crate::reconstruction) fn is_dicom(bytes: &[u8]) -> bool {
    has_mark(bytes) || parser::starts_as_data_set(bytes)
}

fn has_mark(bytes: &[u8]) -> bool {
    bytes
        .get(PREAMBLE..)
        .is_some_and(|rest| rest.starts_with(MARK))
}

/// Opens a segmentation or a structure set.
///
/// # Errors
/// What is wrong with it, or is not read.
pub(in crate::reconstruction) fn read<'a>(
    bytes: &'a [u8],
    reading: &Reading,
) -> Result<Segmentation<'a>, Error> {
    let (syntax, body) = syntax::meta(unmarked(bytes))?;
    if syntax == Syntax::Deflated {
        let inflated = syntax::inflated(body, reading.max_expanded_bytes)?;
        let data_set = parser::data_set(&inflated, syntax)?;
        return open(&data_set, &syntax, reading, |pixels| {
            Cow::Owned(pixels.to_vec())
        });
    }
    let data_set = parser::data_set(body, syntax)?;
    open(&data_set, &syntax, reading, Cow::Borrowed)
}

/// Patient and study of a file; what is packed in it may expand to so many bytes.
///
/// # Errors
/// What is wrong with it, or is not read.
pub(in crate::reconstruction) fn identifiers(
    bytes: &[u8],
    max_expanded_bytes: usize,
) -> Result<Identifiers, Error> {
    let (syntax, body) = syntax::meta(unmarked(bytes))?;
    let body = match syntax {
        Syntax::Deflated => Cow::Owned(syntax::inflated(body, max_expanded_bytes)?),
        _ => Cow::Borrowed(body),
    };
    let data_set = parser::data_set(&body, syntax)?;
    Ok(identity::identifiers(&data_set))
}

/// The bytes behind the mark, if there is one.
fn unmarked(bytes: &[u8]) -> &[u8] {
    if has_mark(bytes) {
        &bytes[PREAMBLE + MARK.len()..]
    } else {
        bytes
    }
}

/// Opens what a data set is of; `keep` takes over the bytes of pixels.
fn open<'d, 'a>(
    data_set: &DataSet<'d>,
    syntax: &Syntax,
    reading: &Reading,
    keep: impl Fn(&'d [u8]) -> Cow<'a, [u8]>,
) -> Result<Segmentation<'a>, Error> {
    match class(data_set)? {
        Class::Segments => segments::open(data_set, syntax, reading, keep),
        Class::Structures => structures::open(data_set),
    }
}

fn class(data_set: &DataSet<'_>) -> Result<Class, Error> {
    let uid = data_set.text(tags::SOP_CLASS);
    let known = CLASSES.iter().find(|(class, _)| *class == uid);
    if let Some(&(_, class)) = known {
        return Ok(class);
    }
    let modality = data_set.text(tags::MODALITY);
    match modality.as_str() {
        "SEG" => return Ok(Class::Segments),
        "RTSTRUCT" => return Ok(Class::Structures),
        _ => {}
    }
    let what = match modality.as_str() {
        "" if data_set.is_empty() => "no data set".to_owned(),
        "" => "an object of no modality".to_owned(),
        modality => format!("an object of the modality {modality:.16}"),
    };
    Err(Error::UnsupportedFormat(format!(
        "this is DICOM, but {what}, not a segmentation (SEG) or a structure set (RTSTRUCT); segment the \
         images first, for instance with 3D Slicer or TotalSegmentator, and send the segmentation"
    )))
}
