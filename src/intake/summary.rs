//! The findings of reading a file.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::{Error, MAX_EXPANSION};
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::{self, Format, Found, PointCloud};
use crate::reconstruction::medical::Contents;
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::Bounds;

/// What the reading of a file found; kept with the cloud.
#[expect(
    clippy::struct_excessive_bools,
    reason = "they are members of a document and do not exclude each other"
)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Format of the file.
    pub format: Format,
    /// Whether it is gzipped.
    pub gzipped: bool,
    /// Number of points that are used.
    pub points: u64,
    /// Smallest box around them.
    pub bounds: Bounds,
    /// Whether they have normals.
    pub normals: bool,
    /// Number of points by label; those without one lie on the surface.
    pub labels: cloud::Counts,
    /// Frame and unit of the coordinates, as far as the file says them.
    #[serde(flatten)]
    pub space: Space,
    /// Points that were left out because a coordinate is not finite.
    pub dropped_non_finite: u64,
    /// What the user should know.
    pub warnings: Vec<Notice>,
    /// Whether patient and study are taken over into its meshes: whoever uploaded it asked for it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub keeps_identifiers: bool,
    /// Whether texts that may name somebody were looked for: not in files that are kept as they were sent,
    /// nor in those of earlier versions.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub cleaned: bool,
    /// How many there were; they are overwritten in the file that is kept.
    #[serde(default)]
    pub dropped_texts: u64,
    /// Labels, segments or regions of interest, and how they lie in the patient; points are made of
    /// one of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segmentation: Option<Box<Contents>>,
}

impl Summary {
    /// Writes the file that this sums up to `to`, without the texts that may name somebody, if it has any.
    ///
    /// # Errors
    /// What is wrong with the disk.
    pub fn clean(&mut self, bytes: &[u8], limits: &cloud::Limits, to: &Path) -> Result<(), Error> {
        let options = cloud::Options {
            hint: Some(self.format),
            limits,
            assume_orientation: true,
        };
        if let Some(cleaned) = cloud::cleaned(bytes, &options)? {
            std::fs::write(to, &cleaned.bytes).map_err(Error::of_disk)?;
            self.dropped_texts = cleaned.texts;
        }
        self.cleaned = true;
        Ok(())
    }

    /// Number of points by label; none of a file of which a part is yet to become points.
    pub fn point_labels(&self) -> Option<cloud::Counts> {
        self.segmentation.is_none().then_some(self.labels)
    }
}

/// A [`Warning`] as it is kept.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Notice {
    /// Stable `snake_case` name.
    pub code: String,
    /// One sentence.
    pub message: String,
}

impl From<&Warning> for Notice {
    fn from(warning: &Warning) -> Self {
        Self {
            code: warning.code.to_owned(),
            message: warning.message.clone(),
        }
    }
}

/// A file that was read and checked.
#[derive(Debug)]
pub struct Parsed {
    /// Its points; none of a segmentation, of which a part is yet to become points.
    pub cloud: PointCloud,
    /// The smallest box around what is in it.
    pub bounds: Option<Bounds>,
    /// The parts of a segmentation.
    pub segmentation: Option<Box<Contents>>,
    /// What its reading found.
    pub source: cloud::Source,
}

/// Reads and checks a file.
///
/// # Errors
/// Everything of [`cloud::Error`].
pub fn parse(
    bytes: &[u8],
    hint: Option<Format>,
    limits: &cloud::Limits,
    assume_orientation: bool,
) -> Result<Parsed, cloud::Error> {
    let options = cloud::Options {
        hint,
        limits,
        assume_orientation,
    };
    let (found, source) = cloud::look(bytes, &options)?;
    Ok(match found {
        Found::Points(cloud) => {
            cloud.validate()?;
            Parsed {
                bounds: cloud.bounds(),
                cloud,
                segmentation: None,
                source,
            }
        }
        Found::Slices(contents) => Parsed {
            cloud: PointCloud {
                space: contents.space,
                ..PointCloud::default()
            },
            bounds: contents.bounds,
            segmentation: Some(contents),
            source,
        },
    })
}

/// What is kept of a file that was read.
///
/// # Errors
/// [`cloud::Error::Empty`] for one with nothing in it.
pub fn sum_up(parsed: &Parsed) -> Result<Summary, cloud::Error> {
    let Parsed { cloud, source, .. } = parsed;
    Ok(Summary {
        format: source.format,
        gzipped: source.gzipped,
        points: cloud.points.len() as u64,
        bounds: parsed.bounds.ok_or(cloud::Error::Empty)?,
        normals: cloud.normals.is_some(),
        labels: cloud.counts(),
        space: cloud.space,
        dropped_non_finite: source.dropped_non_finite as u64,
        warnings: source.warnings.iter().map(Notice::from).collect(),
        keeps_identifiers: false,
        cleaned: false,
        dropped_texts: 0,
        segmentation: parsed.segmentation.clone(),
    })
}

/// The limits that the operator sets for files.
pub fn limits(max_points: u64, max_bytes: u64) -> cloud::Limits {
    cloud::Limits {
        max_points: max_points as usize,
        max_expanded_bytes: max_bytes as usize,
        max_expansion: MAX_EXPANSION as f64,
    }
}

/// What `meshway inspect` prints: one line of JSON.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// The file is a cloud.
    Cloud(Summary),
    /// There was no room for the file without its texts.
    DiskFull,
    /// The file is not a usable cloud.
    Refused {
        /// Stable name of the reason.
        code: String,
        /// One sentence.
        detail: String,
    },
}

impl From<cloud::Error> for Verdict {
    fn from(error: cloud::Error) -> Self {
        Self::Refused {
            code: error.code().to_owned(),
            detail: error.to_string(),
        }
    }
}
