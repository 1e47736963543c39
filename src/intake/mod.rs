//! The intake: what an uploaded file is, read once, checked, and summed up.
//!
//! Files that are small when they are unpacked are read by this process, on a thread that may block.
//! Large ones, and those that unpack to who knows what, are read by a child of the same program:
//! should memory run out there, the service goes on.

mod size;
mod summary;

use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use tokio::process::Command;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::reconstruction::cloud::{self, Format};
use size::Size;
pub use summary::{Summary, Verdict, inspect, limits};

/// Most bytes that one received byte may become, of an encoded body and of a gzipped file in it.
pub const MAX_EXPANSION: u64 = 100;

/// Largest file, unpacked, that is read in this process. The allocator keeps what reading took, once for each
/// of its arenas: with larger files, many uploads at once would leave hundreds of megabytes.
const IN_PROCESS_BYTES: u64 = 1 << 20;

/// Memory for the files that this process reads at the same time, in KiB.
const PARSED_KIB: u32 = 96 * 1024;

/// Most bytes of files, unpacked, that children read at the same time, in KiB: a parsed cloud
/// takes up to about 20 times its file.
const CHILDREN_KIB: u32 = 64 * 1024;

/// Memory that a child may take besides its file: program and libraries.
const CHILD_BASE_BYTES: u64 = 512 << 20;

/// Memory that reading may take for each byte of a file when it is unpacked: some more than a parsed
/// cloud was seen to take.
const MEMORY_PER_BYTE: u64 = 32;

/// Longest time that a child may read: some 20 times what 512 MiB of text take.
const CHILD_TIMEOUT: Duration = Duration::from_mins(5);

/// Why a file is not taken.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// It is no cloud, or none that can be used.
    #[error(transparent)]
    Cloud(#[from] cloud::Error),
    /// The same, said by a child.
    #[error("{detail}")]
    Refused {
        /// Stable name of the reason: one of [`cloud::Error::code`].
        code: String,
        /// One sentence.
        detail: String,
    },
    /// Reading took too long.
    #[error("the file cannot be read within {} seconds", CHILD_TIMEOUT.as_secs())]
    TooSlow,
    /// Reading took too much memory.
    #[error("the file needs more memory to be read than there is")]
    OutOfMemory,
    /// It could not be read for a reason of ours.
    #[error("{0}")]
    Failed(String),
}

impl Error {
    fn failed(error: impl std::fmt::Display) -> Self {
        Self::Failed(error.to_string())
    }
}

/// Reads files within a total of memory.
#[derive(Debug)]
pub struct Reader {
    max_points: u64,
    max_bytes: u64,
    program: PathBuf,
    /// Memory, in KiB, for the files that this process reads at the same time.
    parsing: Arc<Semaphore>,
    /// Bytes, in KiB, of the files that children read at the same time.
    children: Arc<Semaphore>,
}

impl Reader {
    /// One that takes so many points and bytes, unpacked; `program` is the `meshway` to start
    /// children of.
    pub fn new(max_points: u64, max_bytes: u64, program: PathBuf) -> Self {
        Self {
            max_points,
            max_bytes,
            program,
            parsing: Arc::new(Semaphore::new(PARSED_KIB as usize)),
            children: Arc::new(Semaphore::new(CHILDREN_KIB as usize)),
        }
    }

    /// Reads a file of so many bytes, once there is room for it beside the others.
    ///
    /// # Errors
    /// What is wrong with the cloud.
    pub async fn read(
        &self,
        path: &Path,
        bytes: u64,
        hint: Option<Format>,
    ) -> Result<Summary, Error> {
        let room = take(&self.parsing, IN_PROCESS_BYTES, PARSED_KIB).await?;
        let size = blocking({
            let (path, limit) = (path.to_owned(), self.max_bytes);
            move || Size::of(&path, bytes, limit).map_err(Error::failed)
        })
        .await?;
        drop(room);
        let unpacked = match size {
            Size::Known(unpacked) => unpacked,
            Size::UpTo(unpacked) => {
                let _room = take(&self.children, unpacked, CHILDREN_KIB).await?;
                let memory = CHILD_BASE_BYTES + unpacked * MEMORY_PER_BYTE;
                return self.read_in_child(path, hint, memory).await;
            }
        };
        let _room = take(&self.parsing, unpacked * MEMORY_PER_BYTE, PARSED_KIB).await?;
        let (path, limits) = (path.to_owned(), limits(self.max_points, self.max_bytes));
        blocking(move || {
            let bytes = std::fs::read(&path).map_err(Error::failed)?;
            Ok(inspect(&bytes, hint, &limits)?)
        })
        .await
    }

    async fn read_in_child(
        &self,
        path: &Path,
        hint: Option<Format>,
        memory_bytes: u64,
    ) -> Result<Summary, Error> {
        let mut command = Command::new(&self.program);
        command
            .arg("inspect")
            .arg(path)
            .arg(format!("--max-points={}", self.max_points))
            .arg(format!("--max-bytes={}", self.max_bytes))
            .arg(format!("--memory-bytes={memory_bytes}"))
            .stdin(Stdio::null())
            .stderr(Stdio::null())
            .kill_on_drop(true);
        if let Some(format) = hint {
            command.arg(format!("--hint={}", format.name()));
        }
        let output = tokio::time::timeout(CHILD_TIMEOUT, command.output())
            .await
            .map_err(|_| Error::TooSlow)?
            .map_err(Error::failed)?;
        if output.status.code().is_none() {
            // Ended by a signal: an allocation that was refused aborts, and the kernel kills.
            tracing::warn!(child.status = %output.status, "a file could not be read for want of memory");
            return Err(Error::OutOfMemory);
        }
        match serde_json::from_slice(&output.stdout).map_err(Error::failed)? {
            Verdict::Cloud(summary) => Ok(summary),
            Verdict::Refused { code, detail } => Err(Error::Refused { code, detail }),
        }
    }
}

/// Room for so many bytes, or all that there is.
async fn take(
    room: &Arc<Semaphore>,
    bytes: u64,
    all_kib: u32,
) -> Result<OwnedSemaphorePermit, Error> {
    let kib = u32::try_from(bytes.div_ceil(1 << 10)).unwrap_or(all_kib);
    let taken = Arc::clone(room).acquire_many_owned(kib.min(all_kib));
    taken.await.map_err(Error::failed)
}

/// Runs work that blocks.
async fn blocking<T: Send + 'static>(
    work: impl FnOnce() -> Result<T, Error> + Send + 'static,
) -> Result<T, Error> {
    tokio::task::spawn_blocking(work)
        .await
        .map_err(Error::failed)?
}
