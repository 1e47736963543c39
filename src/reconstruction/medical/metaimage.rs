//! MetaImage (`.mha`), with the data in the same file.

use std::borrow::Cow;
use std::collections::HashMap;

use flate2::read::ZlibDecoder;

use super::affine::header;
use super::raster::{Raster, unpacked, values};
use super::{Affine, Reading, Segmentation};
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar};
use crate::reconstruction::cloud::text::excerpt;
use crate::reconstruction::vector::{Vec3, scale};

/// Longest header.
const LONGEST: usize = 1 << 16;

/// The last key, behind which the data begin.
pub(super) const LAST: &str = "ElementDataFile";

/// Whether a file begins as MetaImage does.
pub(in crate::reconstruction) fn is_metaimage(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(4096)];
    let first = head.split(|&b| b == b'\n').next().unwrap_or_default();
    let begins = |word: &[u8]| {
        let start = first.get(..word.len());
        let rest = first.get(word.len()..).unwrap_or_default();
        start.is_some_and(|start| start.eq_ignore_ascii_case(word))
            && rest.trim_ascii_start().starts_with(b"=")
    };
    begins(b"ObjectType") || begins(b"NDims") || begins(b"Comment")
}

/// What the header says, by the names of its keys.
struct Header<'a>(HashMap<&'a str, &'a str>);

impl<'a> Header<'a> {
    /// The header, and the data behind it.
    fn of(bytes: &'a [u8]) -> Result<(Self, &'a [u8]), Error> {
        let mut keys = HashMap::new();
        let mut rest = bytes;
        loop {
            let end = rest.iter().take(LONGEST).position(|&b| b == b'\n');
            let end =
                end.ok_or_else(|| header("ElementDataFile is missing at the end of the header"))?;
            let line = std::str::from_utf8(&rest[..end]).unwrap_or_default();
            rest = &rest[end + 1..];
            let Some((key, value)) = line.split_once('=') else {
                continue;
            };
            let (key, value) = (key.trim(), value.trim());
            keys.insert(key, value);
            if key == LAST {
                break;
            }
        }
        Ok((Self(keys), rest))
    }

    fn get(&self, names: &[&str]) -> Option<&'a str> {
        names.iter().find_map(|name| self.0.get(name).copied())
    }

    fn says(&self, names: &[&str]) -> bool {
        let value = self.get(names);
        value.is_some_and(|value| value.eq_ignore_ascii_case("true") || value == "1")
    }

    /// Numbers of a key; `None` where it is missing.
    fn numbers(&self, names: &[&str]) -> Result<Option<Vec<f64>>, Error> {
        let Some(text) = self.get(names) else {
            return Ok(None);
        };
        let numbers: Result<Vec<f64>, _> = text.split_ascii_whitespace().map(str::parse).collect();
        numbers
            .map(Some)
            .map_err(|_| header(format!("{} must be numbers", names[0])))
    }
}

/// Opens a label map.
///
/// # Errors
/// What is wrong with it, or is not read.
pub(in crate::reconstruction) fn read<'a>(
    bytes: &'a [u8],
    reading: &Reading,
) -> Result<Segmentation<'a>, Error> {
    let (keys, data) = Header::of(bytes)?;
    let data_file = keys.get(&[LAST]).unwrap_or_default();
    if !data_file.eq_ignore_ascii_case("LOCAL") {
        return Err(Error::UnsupportedFormat(
            "the data lie in another file; save both as one .mha".to_owned(),
        ));
    }
    if keys
        .get(&["BinaryData"])
        .is_some_and(|value| value.eq_ignore_ascii_case("false"))
    {
        return Err(Error::UnsupportedFormat(
            "MetaImage with numbers in text is not read; save it as binary".to_owned(),
        ));
    }
    let channels = keys.get(&["ElementNumberOfChannels"]);
    if channels.is_some_and(|channels| channels != "1") {
        return Err(Error::UnsupportedFormat(
            "the voxels have several channels; save one with the labels".to_owned(),
        ));
    }
    let size = size(&keys)?;
    let scalar = scalar(keys.get(&["ElementType"]).unwrap_or_default())?;
    let data = if keys.says(&["CompressedData"]) {
        Cow::Owned(unpacked(ZlibDecoder::new(data), &size, scalar, reading)?)
    } else {
        Cow::Borrowed(data)
    };
    let count = values(&size, scalar, data.len())?;
    let big = keys.says(&["BinaryDataByteOrderMSB", "ElementByteOrderMSB"]);
    let mut warnings = Vec::new();
    let affine = place(&keys, &mut warnings)?;
    let raster = Raster {
        data,
        scalar,
        order: if big {
            ByteOrder::Big
        } else {
            ByteOrder::Little
        },
        slope: 1.0,
        intercept: 0.0,
        size,
        strides: [1, size[0], size[0] * size[1]],
        layers: [1, count],
        affine: affine.checked(size)?,
    };
    raster.open(&[], warnings)
}

fn size(keys: &Header<'_>) -> Result<[usize; 3], Error> {
    let sizes = keys.numbers(&["DimSize"])?.unwrap_or_default();
    let is_count = |&n: &f64| (1.0..=1e9).contains(&n) && n.fract() == 0.0;
    if sizes.len() < 3 || !sizes.iter().all(is_count) {
        return Err(header("DimSize must be three whole numbers"));
    }
    if sizes[3..].iter().any(|&n| n > 1.0) {
        return Err(Error::UnsupportedFormat(
            "the file holds a series of volumes; save the one with the labels by itself".to_owned(),
        ));
    }
    Ok([0, 1, 2].map(|axis| sizes[axis] as usize))
}

fn scalar(name: &str) -> Result<Scalar, Error> {
    Ok(match name {
        "MET_CHAR" => Scalar::I8,
        "MET_UCHAR" => Scalar::U8,
        "MET_SHORT" => Scalar::I16,
        "MET_USHORT" => Scalar::U16,
        "MET_INT" | "MET_LONG" => Scalar::I32,
        "MET_UINT" | "MET_ULONG" => Scalar::U32,
        "MET_LONG_LONG" => Scalar::I64,
        "MET_ULONG_LONG" => Scalar::U64,
        "MET_FLOAT" => Scalar::F32,
        "MET_DOUBLE" => Scalar::F64,
        other => {
            let name = excerpt(other.as_bytes());
            return Err(header(format!("ElementType {name} is read no labels from")));
        }
    })
}

/// How the voxels lie in the patient: LPS, as all programs that build on ITK take it.
fn place(keys: &Header<'_>, warnings: &mut Vec<Warning>) -> Result<Affine, Error> {
    let dimensions = keys.numbers(&["DimSize"])?.map_or(3, |sizes| sizes.len());
    let three = |names: &[&str]| -> Result<Option<Vec3>, Error> {
        let numbers = keys.numbers(names)?;
        let first = |numbers: Vec<f64>| -> Option<Vec3> { numbers.get(..3)?.try_into().ok() };
        Ok(numbers.and_then(first))
    };
    let spacing = three(&["ElementSpacing", "ElementSize"])?.unwrap_or([1.0; 3]);
    let origin = three(&["Offset", "Position", "Origin"])?.unwrap_or_default();
    let matrix = keys.numbers(&["TransformMatrix", "Rotation", "Orientation"])?;
    let direction = |axis: usize| match &matrix {
        // The directions of the axes, one after the other.
        Some(matrix) => {
            let start = axis * dimensions;
            matrix
                .get(start..start + 3)
                .and_then(|row| row.try_into().ok())
        }
        None => Some(std::array::from_fn(|i| f64::from(i == axis))),
    };
    if matrix.is_none() {
        let message = "the file has no TransformMatrix; its axes were taken to lead to the left, the \
                       back and the head, as ITK does";
        warnings.push(Warning::new("directions_missing", message));
    }
    let mut steps = [[0.0; 3]; 3];
    for (axis, step) in steps.iter_mut().enumerate() {
        let direction =
            direction(axis).ok_or_else(|| header("TransformMatrix must be nine numbers"))?;
        *step = scale(direction, spacing[axis].abs());
    }
    Ok(Affine { steps, origin })
}
