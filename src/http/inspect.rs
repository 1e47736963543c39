//! What an uploaded file is: read once, checked, and summed up.
//!
//! Files that are small when they are unpacked are read by this process, on a thread that may block.
//! Large ones, and those that unpack to who knows what, are read by a child of the same program:
//! should memory run out there, the service goes on.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use flate2::read::MultiGzDecoder;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::process::Command;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use super::AppState;
use super::error::{ApiError, Code, Result};
use super::spool::MAX_EXPANSION;
use super::state::{CHILDREN_KIB, PARSED_KIB};
use super::upload::{Upload, blocking};
use crate::reconstruction::cloud::{self, Format, Found, PointCloud};
use crate::reconstruction::space::Space;

/// Largest file, unpacked, that is read in this process. The allocator keeps what reading took, once for each
/// of its arenas: with larger files, many uploads at once would leave hundreds of megabytes.
const IN_PROCESS_BYTES: u64 = 1 << 20;

/// Memory that a child may take besides its file: program and libraries.
const CHILD_BASE_BYTES: u64 = 512 << 20;

/// Memory that reading may take for each byte of a file when it is unpacked: some more than a parsed
/// cloud was seen to take.
const MEMORY_PER_BYTE: u64 = 32;

/// The same for label maps and contours, which are kept as they are: the file, what is packed in it,
/// and some more.
const MEMORY_PER_BYTE_OF_SLICES: u64 = 8;

/// Most bytes that a gzipped byte can become.
const MOST_OF_GZIP: u64 = 1032;

/// Looked at to tell which process is to read a file.
const LOOKED_AT: u64 = 1 << 12;

/// What the header of a PCD file has whose points are packed.
const PACKED_PCD: &[u8] = b"binary_compressed";

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
    /// Frame and unit of the coordinates, as far as the file says them.
    #[serde(flatten)]
    pub space: Space,
    /// Points that were left out because a coordinate is not finite.
    pub dropped_non_finite: u64,
    /// What the user should know: objects with `code` and `message`.
    pub warnings: Vec<Value>,
    /// Labels, segments or regions of interest, and how they lie in the patient; points are made of
    /// one of them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub segmentation: Option<Value>,
}

/// Reads and checks a file.
///
/// # Errors
/// Everything of [`cloud::Error`].
pub fn inspect(
    bytes: &[u8],
    hint: Option<Format>,
    limits: &cloud::Limits,
    assume_orientation: bool,
) -> std::result::Result<Summary, cloud::Error> {
    let name = hint.map(|format| format!("cloud.{}", format.name()));
    let options = cloud::Options {
        name: name.as_deref(),
        limits,
        assume_orientation,
    };
    let (found, source) = cloud::look(bytes, &options)?;
    let (cloud, bounds, segmentation) = match found {
        Found::Points(cloud) => {
            cloud.validate()?;
            let bounds = cloud.bounds();
            (cloud, bounds, None)
        }
        Found::Slices(contents) => {
            let json = contents.to_json();
            let none = PointCloud {
                space: Space::PATIENT,
                ..PointCloud::default()
            };
            (none, contents.bounds, Some(json))
        }
    };
    Ok(Summary {
        format: source.format,
        gzipped: source.gzipped,
        points: cloud.points.len() as u64,
        bounds: bounds.ok_or(cloud::Error::Empty)?,
        normals: cloud.normals.is_some(),
        labels: cloud.counts(),
        segmentation,
        space: cloud.space,
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
    let (bytes, limit) = (upload.spooled.bytes, app.config.body_limit_bytes());
    let room = take(&app.parsing, IN_PROCESS_BYTES, PARSED_KIB).await?;
    let (hint, assume_orientation) = (upload.hint, upload.assume_orientation);
    let size = blocking({
        let path = path.clone();
        move || Size::of(&path, bytes, limit, hint)
    })
    .await??;
    drop(room);
    let unpacked = match size {
        Size::Known(unpacked) => unpacked,
        Size::UpTo(unpacked) => {
            let _room = take(&app.children, unpacked, CHILDREN_KIB).await?;
            let memory = CHILD_BASE_BYTES + unpacked * MEMORY_PER_BYTE;
            return read_in_child(app, upload, memory).await;
        }
        Size::Slices(unpacked) => {
            let _room = take(&app.children, unpacked, CHILDREN_KIB).await?;
            let memory = CHILD_BASE_BYTES + unpacked * MEMORY_PER_BYTE_OF_SLICES;
            return read_in_child(app, upload, memory).await;
        }
    };
    let _room = take(&app.parsing, unpacked * MEMORY_PER_BYTE, PARSED_KIB).await?;
    let limits = limits(app.config.max_points, limit);
    let read = move || -> Result<Summary> {
        let bytes = std::fs::read(&path).map_err(ApiError::internal)?;
        Ok(inspect(&bytes, hint, &limits, assume_orientation)?)
    };
    blocking(read).await?
}

/// Room for so many bytes, or all that there is.
async fn take(room: &Arc<Semaphore>, bytes: u64, all_kib: u32) -> Result<OwnedSemaphorePermit> {
    let kib = u32::try_from(bytes.div_ceil(1 << 10)).unwrap_or(all_kib);
    let taken = Arc::clone(room).acquire_many_owned(kib.min(all_kib));
    taken.await.map_err(ApiError::internal)
}

/// How many bytes a file has when it is unpacked.
#[derive(Debug, PartialEq, Eq)]
enum Size {
    /// So many, at most [`IN_PROCESS_BYTES`], and nothing in them is packed again.
    Known(u64),
    /// At most so many.
    UpTo(u64),
    /// At most so many, of a format that is always read by a child.
    Slices(u64),
}

impl Size {
    /// Looks at a file of so many bytes, of which `limit` may come. Takes memory for
    /// [`IN_PROCESS_BYTES`].
    fn of(path: &Path, bytes: u64, limit: u64, hint: Option<Format>) -> Result<Self> {
        let file = || File::open(path).map_err(ApiError::internal);
        let mut magic = Vec::new();
        let read = file()?.take(2).read_to_end(&mut magic);
        read.map_err(ApiError::internal)?;
        let gzipped = magic == [0x1f, 0x8b];
        let expanded = |bytes: u64| Self::UpTo(limit.min(bytes.saturating_mul(MAX_EXPANSION)));
        let mut head = Vec::new();
        let looked_at = if gzipped {
            let reader = MultiGzDecoder::new(BufReader::new(file()?));
            reader.take(LOOKED_AT).read_to_end(&mut head)
        } else {
            file()?.take(LOOKED_AT).read_to_end(&mut head)
        };
        // A damaged file is told by who reads it.
        match Format::seen(&head).or(hint) {
            Some(format) if format.has_slices() => {
                // Whether it is packed, or what is in it.
                let most = bytes.saturating_mul(MOST_OF_GZIP);
                return Ok(Self::Slices(limit.min(most)));
            }
            Some(Format::Vtk | Format::Vtp) => return Ok(expanded(bytes)),
            _ if looked_at.is_err() => return Ok(expanded(bytes)),
            _ => {}
        }
        if bytes > IN_PROCESS_BYTES {
            return Ok(if gzipped {
                expanded(bytes)
            } else {
                Self::UpTo(bytes)
            });
        }
        let mut content = Vec::new();
        let one_more = IN_PROCESS_BYTES + 1;
        let unpacked = if gzipped {
            // A damaged file is told by who reads it; what comes before the damage counts.
            let mut reader = MultiGzDecoder::new(BufReader::new(file()?)).take(one_more);
            let read = reader.read_to_end(&mut content);
            read.or(Ok(content.len()))
        } else {
            file()?.take(one_more).read_to_end(&mut content)
        };
        let unpacked = unpacked.map_err(|error: io::Error| ApiError::internal(error))? as u64;
        if unpacked > IN_PROCESS_BYTES {
            Ok(expanded(bytes))
        } else if content
            .windows(PACKED_PCD.len())
            .any(|part| part == PACKED_PCD)
        {
            Ok(expanded(unpacked))
        } else {
            Ok(Self::Known(unpacked))
        }
    }
}

async fn read_in_child(app: &AppState, upload: &Upload, memory_bytes: u64) -> Result<Summary> {
    let mut command = Command::new(&app.program);
    command
        .arg("inspect")
        .arg(upload.spooled.file.path())
        .arg(format!("--max-points={}", app.config.max_points))
        .arg(format!("--max-bytes={}", app.config.body_limit_bytes()))
        .arg(format!("--memory-bytes={memory_bytes}"))
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .kill_on_drop(true);
    if upload.assume_orientation {
        command.arg("--assume-orientation");
    }
    if let Some(format) = upload.hint {
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

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;

    fn size(content: &[u8], times_packed: usize) -> (u64, Size) {
        let mut content = content.to_vec();
        for _ in 0..times_packed {
            let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
            encoder.write_all(&content).unwrap();
            content = encoder.finish().unwrap();
        }
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&content).unwrap();
        let bytes = content.len() as u64;
        (bytes, Size::of(file.path(), bytes, 1 << 30, None).unwrap())
    }

    #[test]
    fn what_can_expand_is_weighed_by_what_it_may_become() {
        assert_eq!(size(b"1 2 3\n", 0).1, Size::Known(6));
        assert_eq!(size(b"1 2 3\n", 1).1, Size::Known(6));
        let zeros = vec![b'0'; 3 << 20];
        assert_eq!(size(&zeros, 0).1, Size::UpTo(3 << 20));
        let (bytes, found) = size(&zeros, 1);
        assert!(bytes < 10_000, "{bytes}");
        assert_eq!(found, Size::UpTo(100 * bytes));
        let pcd = b"# .PCD v0.7\nDATA binary_compressed\n";
        for times_packed in [0, 1] {
            assert_eq!(
                size(pcd, times_packed).1,
                Size::UpTo(100 * pcd.len() as u64)
            );
        }
    }
}
