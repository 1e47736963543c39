//! From the bytes of a file to a cloud: unpacking, choice of the format, limits.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::MultiGzDecoder;
use serde::Serialize;

use super::format::Reader;
use super::{Error, Format, PointCloud};
use crate::reconstruction::Warning;
use crate::reconstruction::medical::{self, Choice, Contents, Reading, Segmentation};
use crate::reconstruction::slices::{Builder, Grid, Identifiers, Record};
use crate::reconstruction::space::Space;

/// Bytes that show what a packed file is.
const HEAD: u64 = 1 << 12;

/// What a file may cost.
#[derive(Debug, Clone, PartialEq)]
pub struct Limits {
    /// Most points.
    pub max_points: usize,
    /// Most bytes after decompression.
    pub max_expanded_bytes: usize,
    /// Most bytes after decompression for each byte before; files that expand to less than 1 MiB
    /// are exempt.
    pub max_expansion: f64,
}

impl Default for Limits {
    /// 5 million points and 512 MiB, which fit a small server, and a factor of 100: measurements
    /// compress by 2 to 10, even regular grids written as text seldom by more than 50.
    fn default() -> Self {
        Self {
            max_points: 5_000_000,
            max_expanded_bytes: 512 << 20,
            max_expansion: 100.0,
        }
    }
}

impl Limits {
    /// Most bytes that `packed` compressed bytes may expand to.
    pub(super) fn expanded(&self, packed: usize) -> usize {
        const ALWAYS_ALLOWED: usize = 1 << 20;
        let by_ratio = (packed as f64 * self.max_expansion) as usize;
        by_ratio.max(ALWAYS_ALLOWED).min(self.max_expanded_bytes)
    }
}

/// How a cloud was read.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Source {
    /// Format of the file.
    pub format: Format,
    /// Whether it was gzipped.
    pub gzipped: bool,
    /// Points that were left out because a coordinate is NaN or infinite.
    pub dropped_non_finite: usize,
    /// What the user should know.
    pub warnings: Vec<Warning>,
    /// The slices that the points were made of.
    #[serde(skip)]
    pub slices: Option<Record>,
    /// The voxels of a label map.
    pub grid: Option<Grid>,
    /// Patient and study, where they are to be kept.
    pub identifiers: Option<Identifiers>,
}

/// What is known of a file besides its bytes.
#[derive(Debug, Clone, Copy)]
pub struct Options<'a> {
    /// Its format, where its content leaves that open.
    pub hint: Option<Format>,
    /// What it may cost.
    pub limits: &'a Limits,
    /// Takes a label map that does not say how it lies in the patient as it lies in its own axes.
    pub assume_orientation: bool,
}

/// What a file holds.
#[derive(Debug)]
pub enum Found {
    /// Points.
    Points(PointCloud),
    /// Labels, segments or regions of interest, one of which is to be chosen.
    Slices(Box<Contents>),
}

/// Reads a cloud from the bytes of a file; `name` is the file's name, if known.
///
/// Declared counts are believed only as far as there are bytes for them: memory stays below a small
/// multiple of the (expanded) input, about 20 for the densest encoding.
///
/// # Errors
/// Everything of [`Error`] except what [`PointCloud::validate`] is there for.
pub fn read(
    bytes: &[u8],
    name: Option<&str>,
    limits: &Limits,
) -> Result<(PointCloud, Source), Error> {
    let options = Options {
        hint: name.and_then(Format::from_extension),
        limits,
        assume_orientation: false,
    };
    read_part(bytes, &options, None)
}

/// Reads a cloud, of a file with several parts the one that is chosen.
///
/// # Errors
/// As [`read`], and [`Error::SourceMissing`] and [`Error::SourceUnknown`] for the choice.
pub fn read_part(
    bytes: &[u8],
    options: &Options<'_>,
    choice: Option<&Choice>,
) -> Result<(PointCloud, Source), Error> {
    let ((cloud, slices), mut source) = open(bytes, options, |opened, warnings| match opened {
        Opened::Points(cloud) if choice.is_some() => {
            let detail = format!(
                "the file holds {} points and no parts to choose from; leave the choice out",
                cloud.points.len()
            );
            Err(Error::SourceUnknown(detail))
        }
        Opened::Points(cloud) => Ok((cloud, None)),
        Opened::Slices(segmentation) => {
            let grid = segmentation.contents().grid();
            let (cloud, record) = points_of(&segmentation, choice, warnings)?;
            Ok((cloud, Some((record, grid))))
        }
    })?;
    if let Some((record, grid)) = slices {
        source.slices = Some(record);
        source.grid = grid;
    }
    Ok((cloud, source))
}

/// Looks what a file holds.
///
/// # Errors
/// As [`read`].
pub fn look(bytes: &[u8], options: &Options<'_>) -> Result<(Found, Source), Error> {
    open(bytes, options, |opened, _| {
        Ok(match opened {
            Opened::Points(cloud) => Found::Points(cloud),
            Opened::Slices(segmentation) => {
                Found::Slices(Box::new(segmentation.contents().clone()))
            }
        })
    })
}

/// Patient and study of a DICOM file, for those who ask for them; none of other files.
///
/// # Errors
/// As [`read`].
pub fn identifiers(bytes: &[u8], limits: &Limits) -> Result<Option<Identifiers>, Error> {
    let unpacked = unpack(bytes, limits)?;
    let bytes = content(&unpacked)?;
    if !medical::is_dicom(bytes) {
        return Ok(None);
    }
    medical::identifiers(bytes, limits.max_expanded_bytes).map(Some)
}

/// A file that was opened.
#[derive(Debug)]
pub enum Opened<'a> {
    /// All its points.
    Points(PointCloud),
    /// Parts, whose slices are read when they are asked for.
    Slices(Segmentation<'a>),
}

/// Unpacks and opens a file, and gives it to `take` with the warnings so far.
///
/// # Errors
/// As [`read`], and those of `take`.
pub fn open<T>(
    bytes: &[u8],
    options: &Options<'_>,
    take: impl FnOnce(Opened<'_>, &mut Vec<Warning>) -> Result<T, Error>,
) -> Result<(T, Source), Error> {
    let Options { hint, limits, .. } = *options;
    let unpacked = unpack(bytes, limits)?;
    let gzipped = matches!(unpacked, Cow::Owned(_));
    let bytes = content(&unpacked)?;
    let format = Format::detect(bytes, hint)?;
    let (opened, dropped_non_finite, mut warnings) = match format.reader() {
        Reader::Points(read) => {
            let mut collector = read(bytes, limits)?;
            if let (Format::Xyz, Some(named)) = (format, hint.filter(|&named| named != format)) {
                let message = format!(
                    "the file has no mark of {}, though its name says so; it was read as a table of numbers",
                    named.name().to_uppercase()
                );
                collector.warn("format_by_content", message);
            }
            let (cloud, dropped, warnings) = collector.finish()?;
            (Opened::Points(cloud), dropped, warnings)
        }
        Reader::Slices(read) => {
            let reading = Reading {
                assume_orientation: options.assume_orientation,
                max_expanded_bytes: limits.max_expanded_bytes,
            };
            let segmentation = read(bytes, &reading)?;
            let warnings = segmentation.contents().warnings.clone();
            (Opened::Slices(segmentation), 0, warnings)
        }
    };
    let taken = take(opened, &mut warnings)?;
    let source = Source {
        format,
        gzipped,
        dropped_non_finite,
        warnings,
        slices: None,
        grid: None,
        identifiers: None,
    };
    Ok((taken, source))
}

/// Makes points of the part that is chosen.
fn points_of(
    segmentation: &Segmentation<'_>,
    choice: Option<&Choice>,
    warnings: &mut Vec<Warning>,
) -> Result<(PointCloud, Record), Error> {
    let item = segmentation.contents().parts.choose(choice)?;
    let mut builder = Builder::new(&segmentation.geometry(item))?;
    for plane in segmentation.planes(item) {
        builder.push(plane)?;
    }
    let (mut cloud, record, told) = builder.finish()?;
    cloud.space = Space::PATIENT;
    warnings.extend(told);
    Ok((cloud, record))
}

/// The bytes, expanded if they are gzipped.
pub(in crate::reconstruction) fn unpack<'a>(
    bytes: &'a [u8],
    limits: &Limits,
) -> Result<Cow<'a, [u8]>, Error> {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        expand(bytes, limits).map(Cow::Owned)
    } else {
        Ok(Cow::Borrowed(bytes))
    }
}

/// The unpacked bytes without a byte order mark.
pub(in crate::reconstruction) fn content(unpacked: &[u8]) -> Result<&[u8], Error> {
    let bytes = unpacked.strip_prefix(b"\xef\xbb\xbf").unwrap_or(unpacked);
    if bytes.trim_ascii().is_empty() {
        return Err(Error::Empty);
    }
    Ok(bytes)
}

fn expand(packed: &[u8], limits: &Limits) -> Result<Vec<u8>, Error> {
    let damaged = |error: std::io::Error| {
        Error::Compression(match error.kind() {
            std::io::ErrorKind::UnexpectedEof => "the file is cut short".to_owned(),
            _ => format!("the file is damaged ({error})"),
        })
    };
    let mut expanded = Vec::new();
    let mut reader = MultiGzDecoder::new(packed);
    let head = reader.by_ref().take(HEAD).read_to_end(&mut expanded);
    head.map_err(damaged)?;
    let limit = match Format::seen(&expanded) {
        // Labels are the same over long stretches and pack hundreds of times smaller.
        Some(format) if format.has_slices() => limits.max_expanded_bytes,
        _ => limits.expanded(packed.len()),
    };
    // One byte more shows that there are too many; a limit may be the largest number there is.
    let one_more = (limit as u64).saturating_add(1).saturating_sub(HEAD);
    reader
        .take(one_more)
        .read_to_end(&mut expanded)
        .map_err(damaged)?;
    if expanded.len() > limit {
        return Err(Error::ExpandsTooFar { limit });
    }
    Ok(expanded)
}
