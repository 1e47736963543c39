//! What an uploaded file is: read once, checked, and summed up.
//!
//! Small files are read by this process, on a thread that may block. Large ones, and those that
//! unpack to who knows what, are read by a child of the same program: should memory run out there,
//! the service goes on.

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::process::Command;

use super::AppState;
use super::error::{ApiError, Code, Result};
use super::spool::MAX_EXPANSION;
use super::state::PARSED_KIB;
use super::upload::{Upload, blocking};
use crate::reconstruction::cloud::{self, Format};

/// Largest file that is read in this process. The allocator keeps what reading took, once for each
/// of its arenas: with larger files, many uploads at once would leave hundreds of megabytes.
const IN_PROCESS_BYTES: u64 = 1 << 20;

/// The same for gzipped files, which may unpack to a hundred times that.
const IN_PROCESS_GZIP_BYTES: u64 = 1 << 20;

/// Memory that a child may take besides its file: program and libraries.
const CHILD_BASE_BYTES: u64 = 512 << 20;

/// Memory that a child may take for each byte of a file when it is unpacked: some more than a
/// parsed cloud was seen to take.
const CHILD_BYTES_PER_BYTE: u64 = 32;

/// Longest time that a child may read: some 20 times what 512 MiB of text take.
const CHILD_TIMEOUT: Duration = Duration::from_mins(5);

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
    pub bounds: crate::reconstruction::vector::Bounds,
    /// Whether they have normals.
    pub normals: bool,
    /// Number of points by label; those without one lie on the surface.
    pub labels: cloud::Counts,
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
) -> std::result::Result<Summary, cloud::Error> {
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
        dropped_non_finite: source.dropped_non_finite as u64,
        warnings: source
            .warnings
            .iter()
            .map(|warning| serde_json::json!(warning))
            .collect(),
    })
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

impl From<std::result::Result<Summary, cloud::Error>> for Verdict {
    fn from(result: std::result::Result<Summary, cloud::Error>) -> Self {
        match result {
            Ok(summary) => Self::Cloud(summary),
            Err(error) => Self::Refused {
                code: error.code().to_owned(),
                detail: error.to_string(),
            },
        }
    }
}

/// The limits that the operator sets for files.
pub fn limits(max_points: u64, max_bytes: u64) -> cloud::Limits {
    cloud::Limits {
        max_points: max_points as usize,
        max_expanded_bytes: max_bytes as usize,
        max_expansion: MAX_EXPANSION as f64,
    }
}

/// Reads an upload, once there is room for it beside the others.
///
/// # Errors
/// What is wrong with the cloud.
pub(super) async fn read(app: &AppState, upload: &Upload) -> Result<Summary> {
    let path = upload.spooled.file.path().to_owned();
    let bytes = upload.spooled.bytes;
    let gzipped = blocking({
        let path = path.clone();
        move || is_gzipped(&path)
    })
    .await??;
    let in_process = bytes
        <= if gzipped {
            IN_PROCESS_GZIP_BYTES
        } else {
            IN_PROCESS_BYTES
        };
    let weight = if gzipped && !in_process {
        // It may unpack to anything.
        PARSED_KIB
    } else {
        let expanded = if gzipped { 16 } else { 1 };
        u32::try_from((bytes * expanded) >> 10).map_or(PARSED_KIB, |kib| kib + 1)
    };
    let room = Arc::clone(&app.parsing).acquire_many_owned(weight.min(PARSED_KIB));
    let _room = room.await.map_err(ApiError::internal)?;
    if !in_process {
        let limit = app.config.body_limit_bytes();
        let unpacked = if gzipped {
            limit.min(bytes.saturating_mul(MAX_EXPANSION))
        } else {
            bytes
        };
        let memory = CHILD_BASE_BYTES + unpacked * CHILD_BYTES_PER_BYTE;
        return read_in_child(app, &path, upload.hint, memory).await;
    }
    let (hint, limits) = (
        upload.hint,
        limits(app.config.max_points, app.config.body_limit_bytes()),
    );
    let read = move || -> Result<Summary> {
        let bytes = std::fs::read(&path).map_err(ApiError::internal)?;
        Ok(inspect(&bytes, hint, &limits)?)
    };
    blocking(read).await?
}

fn is_gzipped(path: &Path) -> Result<bool> {
    use std::io::Read;
    let mut magic = Vec::new();
    std::fs::File::open(path)
        .and_then(|file| file.take(2).read_to_end(&mut magic))
        .map_err(ApiError::internal)?;
    Ok(magic == [0x1f, 0x8b])
}

async fn read_in_child(
    app: &AppState,
    path: &PathBuf,
    hint: Option<Format>,
    memory_bytes: u64,
) -> Result<Summary> {
    let mut command = Command::new(&app.program);
    command
        .arg("inspect")
        .arg(path)
        .arg(format!("--max-points={}", app.config.max_points))
        .arg(format!("--max-bytes={}", app.config.body_limit_bytes()))
        .arg(format!("--memory-bytes={memory_bytes}"))
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .kill_on_drop(true);
    if let Some(format) = hint {
        command.arg(format!("--hint={}", format.name()));
    }
    let output = tokio::time::timeout(CHILD_TIMEOUT, command.output())
        .await
        .map_err(|_| {
            let seconds = CHILD_TIMEOUT.as_secs();
            let detail = format!("the file cannot be read within {seconds} seconds");
            ApiError::new(Code::BodyTooLarge, detail)
        })?
        .map_err(ApiError::internal)?;
    if output.status.code().is_none() {
        // Ended by a signal: an allocation that was refused aborts, and the kernel kills.
        tracing::warn!(child.status = %output.status, "a file could not be read for want of memory");
        let detail = "the file needs more memory to be read than there is";
        return Err(ApiError::new(Code::TooManyPoints, detail));
    }
    match serde_json::from_slice(&output.stdout).map_err(ApiError::internal)? {
        Verdict::Cloud(summary) => Ok(summary),
        Verdict::Refused { code, detail } => Err(ApiError::new(Code::from_name(&code), detail)),
    }
}
