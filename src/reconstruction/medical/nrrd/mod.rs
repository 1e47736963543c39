//! NRRD, and segmentations of 3D Slicer in it (`.seg.nrrd`), with their data in the same file.

pub(super) mod fields;

use std::borrow::Cow;

use flate2::read::MultiGzDecoder;

use super::affine::header;
use super::contents::{color, name};
use super::raster::{Described, Raster, unpacked, values};
use super::{Affine, Reading, Segmentation};
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar};
use crate::reconstruction::cloud::text::{excerpt, parse};
use crate::reconstruction::vector::{Vec3, along};
use fields::Fields;

/// Most axes: three of space and one that lists.
const MOST_AXES: usize = 4;

/// Most segments that a header is asked for.
const MOST_SEGMENTS: usize = 2048;

/// Whether a file begins as NRRD does.
pub(in crate::reconstruction) fn is_nrrd(bytes: &[u8]) -> bool {
    bytes.starts_with(b"NRRD000")
}

/// Opens a label map.
///
/// # Errors
/// What is wrong with it, or is not read.
pub(in crate::reconstruction) fn read<'a>(
    bytes: &'a [u8],
    reading: &Reading,
) -> Result<Segmentation<'a>, Error> {
    let (fields, data) = Fields::of(bytes)?;
    let sizes = sizes(&fields)?;
    let mut scalar = scalar(&fields.needed("type")?.to_ascii_lowercase())?;
    let mut order = byte_order(&fields, scalar)?;
    let mut warnings = Vec::new();
    let (axes, affine, assumed) = place(&fields, &sizes, reading, &mut warnings)?;
    let data = match fields.needed("encoding")?.to_ascii_lowercase().as_str() {
        "raw" => Cow::Borrowed(skipped(data, &fields, &sizes, scalar)?),
        "gzip" | "gz" => Cow::Owned(unpacked(
            MultiGzDecoder::new(data),
            &sizes,
            scalar,
            reading,
        )?),
        "ascii" | "text" | "txt" => {
            (scalar, order) = (Scalar::F64, ByteOrder::Little);
            Cow::Owned(typed(data))
        }
        other => {
            return Err(Error::UnsupportedFormat(format!(
                "NRRD with the encoding {} is not read; save it as raw or gzip, for instance with 3D Slicer, or \
                 with unu save -e gzip",
                excerpt(other.as_bytes())
            )));
        }
    };
    let count = values(&sizes, scalar, data.len())?;
    debug_assert!(data.len() >= count * scalar.size());
    let stride = |axis: usize| sizes[..axis].iter().product::<usize>();
    let list = (0..sizes.len()).find(|axis| !axes.contains(axis));
    if let Some(axis) = list {
        layered(&fields, axis, sizes[axis])?;
    }
    let size = axes.map(|axis| sizes[axis]);
    let layers = list.map_or([1, count], |axis| [sizes[axis], stride(axis)]);
    let raster = Raster {
        data,
        scalar,
        order,
        slope: 1.0,
        intercept: 0.0,
        size,
        strides: axes.map(stride),
        layers,
        affine: affine.checked(size)?,
    };
    let mut segmentation = raster.open(&described(&fields, layers[0]), warnings)?;
    segmentation.contents.assumed_orientation = assumed;
    Ok(segmentation)
}

fn sizes(fields: &Fields) -> Result<Vec<usize>, Error> {
    let dimension = fields.needed("dimension")?.parse::<usize>();
    let sizes = fields.needed("sizes")?.split_ascii_whitespace();
    let sizes: Result<Vec<usize>, _> = sizes.map(str::parse).collect();
    match (dimension, sizes) {
        (Ok(dimension), Ok(sizes)) if sizes.len() == dimension => {
            if (3..=MOST_AXES).contains(&dimension) {
                Ok(sizes)
            } else {
                let detail = format!(
                    "the file has {dimension} axes, 3 are needed, or 4 with a list of layers"
                );
                Err(Error::UnsupportedFormat(detail))
            }
        }
        _ => Err(header(
            "sizes must be as many whole numbers as dimension says",
        )),
    }
}

fn scalar(name: &str) -> Result<Scalar, Error> {
    Ok(match name {
        "signed char" | "int8" | "int8_t" => Scalar::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => Scalar::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            Scalar::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => Scalar::U16,
        "int" | "signed int" | "int32" | "int32_t" => Scalar::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => Scalar::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => Scalar::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            Scalar::U64
        }
        "float" => Scalar::F32,
        "double" => Scalar::F64,
        other => {
            let name = excerpt(other.as_bytes());
            return Err(header(format!("type {name} is read no labels from")));
        }
    })
}

fn byte_order(fields: &Fields, scalar: Scalar) -> Result<ByteOrder, Error> {
    let encoding = fields.word("encoding");
    let packs_bytes = !matches!(encoding.as_deref(), Some("ascii" | "text" | "txt"));
    match fields.word("endian").as_deref() {
        Some("little") => Ok(ByteOrder::Little),
        Some("big") => Ok(ByteOrder::Big),
        None if scalar.size() == 1 || !packs_bytes => Ok(ByteOrder::Little),
        _ => Err(header("endian must be little or big")),
    }
}

/// Which three axes are those of space, how the voxels lie in the patient, and whether that had to
/// be assumed.
fn place(
    fields: &Fields,
    sizes: &[usize],
    reading: &Reading,
    warnings: &mut Vec<Warning>,
) -> Result<([usize; 3], Affine, bool), Error> {
    let mut directions = match fields.get("space directions") {
        Some(text) => fields::vectors(text)
            .filter(|directions| directions.len() == sizes.len())
            .ok_or_else(|| header("space directions must be one vector or none for each axis"))?,
        None => Vec::new(),
    };
    let origin = fields.get("space origin").and_then(fields::vectors);
    let mut origin: Vec<f64> = origin
        .and_then(|all| all.into_iter().next()?)
        .unwrap_or_default();
    let by_slicer = fields.keys().any(|key| key.starts_with("Segmentation_"));
    let of_four = directions
        .iter()
        .flatten()
        .any(|direction| direction.len() == 4);
    if of_four && sizes.len() == 4 {
        // Old files of 3D Slicer count the layers as a fourth axis of space.
        directions[3] = None;
        directions
            .iter_mut()
            .flatten()
            .for_each(|direction| direction.truncate(3));
        origin.truncate(3);
    }
    if directions.is_empty() {
        return unplaced(fields, sizes, reading);
    }
    let axes: Vec<usize> = (0..sizes.len())
        .filter(|&axis| directions[axis].is_some())
        .collect();
    let vector = |values: &[f64]| <Vec3>::try_from(values).ok();
    let steps: Option<Vec<Vec3>> = directions
        .iter()
        .flatten()
        .map(|values| vector(values))
        .collect();
    let steps = steps.and_then(|steps| <[Vec3; 3]>::try_from(steps).ok());
    let (Some(steps), Ok(axes)) = (steps, <[usize; 3]>::try_from(axes)) else {
        return Err(header(
            "space directions must be three vectors of three numbers",
        ));
    };
    let origin = vector(&origin).unwrap_or_default();
    let mut affine = Affine { steps, origin };
    if of_four && let Some(extent) = fields.key("Segmentation_Extent") {
        // There the origin is that of the whole image, of which a part is stored.
        let first: Vec<f64> = extent
            .split_ascii_whitespace()
            .step_by(2)
            .filter_map(|n| n.parse().ok())
            .collect();
        for (step, first) in steps.into_iter().zip(first) {
            affine.origin = along(affine.origin, first, step);
        }
    }
    let space = fields.word("space");
    let signs = match space.as_deref() {
        Some("left-posterior-superior" | "lps") => [1.0, 1.0, 1.0],
        Some("right-anterior-superior" | "ras") => [-1.0, -1.0, 1.0],
        Some("left-anterior-superior" | "las") => [1.0, -1.0, 1.0],
        None if by_slicer => {
            let message =
                "the file of 3D Slicer names no space; it was taken as left-posterior-superior";
            warnings.push(Warning::new("space_missing", message));
            [1.0, 1.0, 1.0]
        }
        _ if reading.assume_orientation => return Ok((axes, affine, true)),
        other => return Err(orientation_missing(other)),
    };
    Ok((axes, affine.signed(signs), false))
}

/// Of a file that gives the distances at most.
fn unplaced(
    fields: &Fields,
    sizes: &[usize],
    reading: &Reading,
) -> Result<([usize; 3], Affine, bool), Error> {
    if !reading.assume_orientation {
        return Err(orientation_missing(None));
    }
    if sizes.len() != 3 {
        return Err(header("a file with layers needs space directions"));
    }
    let spacings = fields
        .get("spacings")
        .unwrap_or("1 1 1")
        .split_ascii_whitespace();
    let spacings: Vec<f64> = spacings.filter_map(|n| n.parse().ok()).collect();
    let spacings =
        Vec3::try_from(spacings).map_err(|_| header("spacings must be three numbers"))?;
    Ok(([0, 1, 2], Affine::of_spacing(spacings.map(f64::abs)), true))
}

fn orientation_missing(space: Option<&str>) -> Error {
    Error::OrientationMissing(match space {
        Some(space) => {
            let space = excerpt(space.as_bytes());
            format!("the space {space} does not say which side of the patient is left")
        }
        None => "space and space directions are needed to say which side of the patient is left"
            .to_owned(),
    })
}

/// Refuses an axis of `size` components that are no layers: of vectors, colours, tensors.
fn layered(fields: &Fields, axis: usize, size: usize) -> Result<(), Error> {
    /// Kinds of axes whose samples can each be a label map; unknown ones have question marks.
    const LAYERS: [&str; 8] = [
        "list", "domain", "space", "time", "none", "???", "scalar", "stub",
    ];
    let kinds = fields.get("kinds").unwrap_or_default();
    match kinds.split_ascii_whitespace().nth(axis) {
        Some(kind) if size > 1 && !LAYERS.iter().any(|known| kind.eq_ignore_ascii_case(known)) => {
            let kind = excerpt(kind.as_bytes());
            Err(Error::UnsupportedFormat(format!(
                "the voxels have {size} components of the kind {kind}; save one number for each voxel, the label"
            )))
        }
        _ => Ok(()),
    }
}

/// The raw data behind what is to be skipped.
fn skipped<'a>(
    data: &'a [u8],
    fields: &Fields,
    sizes: &[usize],
    scalar: Scalar,
) -> Result<&'a [u8], Error> {
    let skip = |name| fields.get(name).map_or(Ok(0), str::parse::<i64>);
    let mut data = data;
    let lines = skip("line skip").map_err(|_| header("line skip must be a number"))?;
    for _ in 0..lines.max(0) {
        let end = data.iter().position(|&b| b == b'\n');
        let end = end.ok_or_else(|| header("line skip is more than there are lines"))?;
        data = &data[end + 1..];
    }
    let bytes = skip("byte skip").map_err(|_| header("byte skip must be a number"))?;
    if bytes == -1 {
        // The data are what the file ends with.
        let length = values(sizes, scalar, data.len())? * scalar.size();
        return Ok(&data[data.len() - length..]);
    }
    let bytes = usize::try_from(bytes).ok();
    bytes
        .and_then(|bytes| data.get(bytes..))
        .ok_or_else(|| header("byte skip is more than there are bytes"))
}

/// Numbers in text, as bytes.
fn typed(data: &[u8]) -> Vec<u8> {
    let words = data
        .split(u8::is_ascii_whitespace)
        .filter(|word| !word.is_empty());
    words
        .flat_map(|word| parse(word).unwrap_or(f64::NAN).to_le_bytes())
        .collect()
}

/// The segments that the header describes, as far as their layers are there.
fn described(fields: &Fields, layers: usize) -> Vec<Described> {
    let segment = |i: usize| {
        let get = |what: &str| fields.key(&format!("Segment{i}_{what}"));
        get("ID").or(get("Name"))?;
        let rgb = get("Color").or(get("DefaultColor")).map(|text| {
            let shares = text
                .split_ascii_whitespace()
                .filter_map(|share| share.parse().ok());
            shares.collect::<Vec<f64>>()
        });
        Some(Described {
            name: get("Name")
                .or(get("ID"))
                .and_then(|text| name(text.as_bytes())),
            color: rgb.and_then(|rgb| Some(color(rgb.try_into().ok()?))),
            // Old files have a layer for each segment, and 1 in it.
            layer: get("Layer").map_or(Some(i), |layer| layer.parse().ok())?,
            value: get("LabelValue").map_or(Some(1), |value| value.parse().ok())?,
        })
    };
    let all = (0..MOST_SEGMENTS).filter_map(segment);
    all.filter(|segment| segment.layer < layers).collect()
}
