//! From the bytes of a file to a cloud: unpacking, choice of the format, limits.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::MultiGzDecoder;
use serde::Serialize;

use super::{Error, Format, PointCloud, npy, obj, off, pcd, ply, stl, xyz};
use crate::reconstruction::Warning;
use crate::reconstruction::slices::{Grid, Identifiers, Record};

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
    let unpacked = unpack(bytes, limits)?;
    let gzipped = matches!(unpacked, Cow::Owned(_));
    let bytes = content(&unpacked)?;
    let format = Format::detect(bytes, name)?;
    let mut collector = match format {
        Format::Ply => ply::read(bytes, limits),
        Format::Xyz => xyz::read(bytes, limits),
        Format::Obj => obj::read(bytes, limits),
        Format::Off => off::read(bytes, limits),
        Format::Stl => stl::read(bytes, limits),
        Format::Pcd => pcd::read(bytes, limits),
        Format::Npy => npy::read(bytes, limits),
    }?;
    let named = name.and_then(Format::from_extension);
    if let (Format::Xyz, Some(named)) = (format, named.filter(|&named| named != format)) {
        let message = format!(
            "the file has no mark of {}, though its name says so; it was read as a table of numbers",
            named.name().to_uppercase()
        );
        collector.warn("format_by_content", message);
    }
    let (cloud, dropped_non_finite, warnings) = collector.finish()?;
    let source = Source {
        format,
        gzipped,
        dropped_non_finite,
        warnings,
        slices: None,
        grid: None,
        identifiers: None,
    };
    Ok((cloud, source))
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
    let limit = limits.expanded(packed.len());
    let mut expanded = Vec::new();
    // One byte more shows that there are too many; a limit may be the largest number there is.
    let one_more = (limit as u64).saturating_add(1);
    let mut reader = MultiGzDecoder::new(packed).take(one_more);
    reader.read_to_end(&mut expanded).map_err(|error| {
        Error::Compression(match error.kind() {
            std::io::ErrorKind::UnexpectedEof => "the file is cut short".to_owned(),
            _ => format!("the file is damaged ({error})"),
        })
    })?;
    if expanded.len() > limit {
        return Err(Error::ExpandsTooFar { limit });
    }
    Ok(expanded)
}
