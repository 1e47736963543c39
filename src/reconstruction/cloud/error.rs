//! What can be wrong with an uploaded cloud, each with a stable code.

use thiserror::Error;

/// Why a cloud is refused.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// No points at all.
    #[error("the cloud has no points")]
    Empty,
    /// Fewer points than a surface needs.
    #[error("the cloud has {found} surface points; at least {needed} are needed")]
    TooFewPoints {
        /// Surface points that are there.
        found: usize,
        /// Fewest that are accepted.
        needed: usize,
    },
    /// More points than the limit.
    #[error("the cloud has more than {limit} points; thin it out")]
    TooManyPoints {
        /// Most that are accepted.
        limit: usize,
    },
    /// The points span no volume.
    #[error(
        "the points {0}, so there is no surface around them; give points on all sides of a solid, \
         not far from the origin"
    )]
    Degenerate(&'static str),
    /// The points are all through a body.
    #[error(
        "the points fill a solid volume, but the points of its surface are needed; give those, or all voxels of a \
         segmentation, whose centres lie on a regular lattice along the axes"
    )]
    Filled,
    /// Slices from which no surface can be made.
    #[error("no surface can be made from these slices: {0}")]
    Slices(String),
    /// Coordinates are NaN or infinite: in a file all of them, in memory any.
    #[error("{dropped} of {total} points have coordinates that are not finite; give finite ones")]
    NotFinite {
        /// Points that are not finite.
        dropped: usize,
        /// Points in all.
        total: usize,
    },
    /// Coordinates so large that distances between them are lost or overflow.
    #[error(
        "coordinate {value:e} is beyond ±{limit:e}; give the points in a unit in which they are smaller"
    )]
    TooLarge {
        /// The coordinate of the largest magnitude.
        value: f64,
        /// Largest accepted magnitude.
        limit: f64,
    },
    /// The file ends before what its header declares.
    #[error("{what} is cut short: {declared} declared, {found} found")]
    Truncated {
        /// What is missing, with line or byte.
        what: String,
        /// Declared number.
        declared: u64,
        /// Number that is there.
        found: u64,
    },
    /// The header cannot be understood.
    #[error("header{}: {detail}", line_of_header(*line))]
    Header {
        /// Line of the header, from 1; 0 where the header is binary.
        line: usize,
        /// What is wrong and what is expected.
        detail: String,
    },
    /// A row cannot be understood.
    #[error("line {line}: {detail}")]
    Row {
        /// Line of the file, from 1; for binary data the number of the record.
        line: usize,
        /// What is wrong and what is expected.
        detail: String,
    },
    /// There are no x, y, z.
    #[error("{0}")]
    NoCoordinates(String),
    /// Normals are given but cannot be used.
    #[error("{0}")]
    NormalsInvalid(String),
    /// Not one of the formats.
    #[error("{0}")]
    UnsupportedFormat(String),
    /// A label map does not say how it lies in the patient.
    #[error(
        "{0}; left and right could be swapped: give the file its orientation, or read it with assume_orientation"
    )]
    OrientationMissing(String),
    /// The file has several parts, and none is chosen.
    #[error("{0}")]
    SourceMissing(String),
    /// The part that is chosen is not there.
    #[error("{0}")]
    SourceUnknown(String),
    /// The compressed stream is damaged.
    #[error("gzip: {0}")]
    Compression(String),
    /// The compressed data are larger inside than they may be.
    #[error("compressed: expands to more than {limit} bytes")]
    ExpandsTooFar {
        /// Most bytes that they may expand to.
        limit: usize,
    },
}

impl Error {
    /// Stable `snake_case` name, the same in reports, logs and over HTTP.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Empty => "cloud_empty",
            Self::TooFewPoints { .. } => "cloud_too_few_points",
            Self::TooManyPoints { .. } => "too_many_points",
            Self::Degenerate(_) => "cloud_degenerate",
            Self::Filled => "cloud_filled",
            Self::Slices(_) => "slices_unusable",
            Self::NotFinite { .. } => "cloud_not_finite",
            Self::TooLarge { .. } => "cloud_too_large",
            Self::Truncated { .. } => "cloud_truncated",
            Self::Header { .. } => "cloud_header",
            Self::Row { .. } => "cloud_row",
            Self::NoCoordinates(_) => "cloud_no_coordinates",
            Self::NormalsInvalid(_) => "normals_invalid",
            Self::UnsupportedFormat(_) => "unsupported_format",
            Self::OrientationMissing(_) => "orientation_missing",
            Self::SourceMissing(_) => "source_missing",
            Self::SourceUnknown(_) => "source_unknown",
            Self::Compression(_) => "unsupported_encoding",
            Self::ExpandsTooFar { .. } => "body_too_large",
        }
    }
}

fn line_of_header(line: usize) -> String {
    match line {
        0 => String::new(),
        line => format!(", line {line}"),
    }
}
