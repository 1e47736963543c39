//! What the reading of a file found.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::MAX_EXPANSION;
use crate::reconstruction::cloud::{self, Format};
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::Bounds;

/// What the reading of a file found; kept with the cloud.
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
    /// What the user should know: objects with `code` and `message`.
    pub warnings: Vec<Value>,
}

/// Reads and checks a file.
///
/// # Errors
/// Everything of [`cloud::Error`].
pub fn inspect(
    bytes: &[u8],
    hint: Option<Format>,
    limits: &cloud::Limits,
) -> Result<Summary, cloud::Error> {
    let name = hint.map(|format| format!("cloud.{}", format.name()));
    let (cloud, source) = cloud::read(bytes, name.as_deref(), limits)?;
    cloud.validate()?;
    Ok(Summary {
        format: source.format,
        gzipped: source.gzipped,
        points: cloud.points.len() as u64,
        bounds: cloud.bounds().ok_or(cloud::Error::Empty)?,
        normals: cloud.normals.is_some(),
        labels: cloud.counts(),
        space: cloud.space,
        dropped_non_finite: source.dropped_non_finite as u64,
        warnings: source
            .warnings
            .iter()
            .map(|warning| serde_json::json!(warning))
            .collect(),
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
    /// It is none, or none that can be used.
    Refused {
        /// Stable name of the reason.
        code: String,
        /// One sentence.
        detail: String,
    },
}

impl From<Result<Summary, cloud::Error>> for Verdict {
    fn from(result: Result<Summary, cloud::Error>) -> Self {
        match result {
            Ok(summary) => Self::Cloud(summary),
            Err(error) => Self::Refused {
                code: error.code().to_owned(),
                detail: error.to_string(),
            },
        }
    }
}
