//! Reads, checks and sums up uploaded files.
//!
//! This process reads files that are small when unpacked, on a blocking thread. A child process of
//! the same program reads large files and those that may unpack to large ones: if it runs out of
//! memory, the service continues.

mod size;
mod subset;
mod summary;

use std::ffi::OsString;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Arc;
use std::time::Duration;

use rustix::process::Signal;
use tokio::process::Command;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

use crate::reconstruction::cloud::{self, Format};
use size::Size;
use subset::middle;
pub use subset::{Subset, rows};
pub use summary::{Notice, Parsed, Summary, Verdict, limits, parse, sum_up};

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

/// The same for label maps and contours, which are kept as they are: the file, what is packed in it,
/// and some more.
const MEMORY_PER_BYTE_OF_SLICES: u64 = 8;

/// Longest time that a child may read: some 20 times what 512 MiB of text take.
const CHILD_TIMEOUT: Duration = Duration::from_mins(5);

/// Signals that end a child which needs too much memory.
const SIGABRT: i32 = Signal::ABORT.as_raw();
const SIGKILL: i32 = Signal::KILL.as_raw();

/// Why a file is not taken.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// It is not a usable cloud.
    #[error(transparent)]
    Cloud(#[from] cloud::Error),
    /// The same, found by a child process.
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
    #[error(
        "the file needs more memory to be read than there is for one of its size; unpack it, or send a part of it"
    )]
    OutOfMemory,
    /// There is no room for the file without its texts.
    #[error("the disk is full")]
    DiskFull,
    /// It could not be read for a reason of ours.
    #[error("{0}")]
    Failed(String),
}

impl Error {
    fn failed(error: impl std::fmt::Display) -> Self {
        Self::Failed(error.to_string())
    }

    fn of_disk(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::StorageFull => Self::DiskFull,
            _ => Self::failed(error),
        }
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
    /// A reader of files with at most so many points and unpacked bytes. `program` is the `meshway`
    /// that child processes run.
    pub fn new(max_points: u64, max_bytes: u64, program: PathBuf) -> Self {
        Self {
            max_points,
            max_bytes,
            program,
            parsing: Arc::new(Semaphore::new(PARSED_KIB as usize)),
            children: Arc::new(Semaphore::new(CHILDREN_KIB as usize)),
        }
    }

    /// Reads a file, once there is memory for it beside the others. Without the texts that may name
    /// somebody it is written to `clean_to`, if it has any.
    ///
    /// # Errors
    /// What is wrong with the cloud.
    pub async fn read(&self, file: File<'_>, clean_to: Option<&Path>) -> Result<Summary, Error> {
        let limits = limits(self.max_points, self.max_bytes);
        let to = clean_to.map(Path::to_owned);
        let sum_up = move |parsed: Parsed, bytes: &[u8]| {
            let mut summary = sum_up(&parsed)?;
            drop(parsed);
            if let Some(to) = to {
                summary.clean(bytes, &limits, &to)?;
            }
            Ok(summary)
        };
        let arguments = clean_to.map(|to| ["--clean-to".into(), to.into()]);
        let arguments = arguments.as_ref().map_or(&[][..], |arguments| arguments);
        match self.read_by(file, arguments, sum_up).await? {
            Reading::Here(summary) => Ok(summary),
            Reading::InChild(said) => verdict(&said),
        }
    }

    /// At most `most` points of a file that was read before.
    ///
    /// # Errors
    /// As for [`Self::read`].
    pub async fn subset(&self, file: File<'_>, most: usize) -> Result<Subset, Error> {
        let subset = move |parsed: Parsed, _: &[u8]| {
            Ok(Subset {
                origin: middle(parsed.bounds.as_ref()),
                rows: rows(&parsed.cloud, most),
            })
        };
        let arguments = [format!("--points={most}").into()];
        match self.read_by(file, &arguments, subset).await? {
            Reading::Here(subset) => Ok(subset),
            Reading::InChild(said) => {
                let end = said.iter().position(|&byte| byte == b'\n');
                let (line, rows) = said.split_at(end.map_or(said.len(), |end| end + 1));
                Ok(Subset {
                    origin: middle(Some(&verdict(line)?.bounds)),
                    rows: rows.to_vec(),
                })
            }
        }
    }

    /// Reads a file and makes something of it by `here` or, where reading may take much memory, by a child process
    /// with these further arguments.
    async fn read_by<T: Send + 'static>(
        &self,
        file: File<'_>,
        arguments: &[OsString],
        here: impl FnOnce(Parsed, &[u8]) -> Result<T, Error> + Send + 'static,
    ) -> Result<Reading<T>, Error> {
        let room = take(&self.parsing, IN_PROCESS_BYTES, PARSED_KIB).await?;
        let size = blocking({
            let (path, bytes, limit) = (file.path.to_owned(), file.bytes, self.max_bytes);
            move || Size::of(&path, bytes, limit, file.hint).map_err(Error::failed)
        })
        .await?;
        drop(room);
        let (most, per_byte) = match size {
            Size::Known(unpacked) => (unpacked, None),
            Size::UpTo(unpacked) => (unpacked, Some(MEMORY_PER_BYTE)),
            Size::Slices(unpacked) => (unpacked, Some(MEMORY_PER_BYTE_OF_SLICES)),
        };
        if let Some(per_byte) = per_byte {
            let _room = take(&self.children, most, CHILDREN_KIB).await?;
            let memory = CHILD_BASE_BYTES + most * per_byte;
            let said = self.read_in_child(file, arguments, memory).await?;
            return Ok(Reading::InChild(said));
        }
        let _room = take(&self.parsing, most * MEMORY_PER_BYTE, PARSED_KIB).await?;
        let (path, hint) = (file.path.to_owned(), file.hint);
        let assume_orientation = file.assume_orientation;
        let limits = limits(self.max_points, self.max_bytes);
        blocking(move || {
            let bytes = std::fs::read(&path).map_err(Error::failed)?;
            let parsed = parse(&bytes, hint, &limits, assume_orientation)?;
            Ok(Reading::Here(here(parsed, &bytes)?))
        })
        .await
    }

    /// What a child process prints of the file.
    async fn read_in_child(
        &self,
        file: File<'_>,
        arguments: &[OsString],
        memory_bytes: u64,
    ) -> Result<Vec<u8>, Error> {
        let mut command = Command::new(&self.program);
        command
            .arg("inspect")
            .arg(file.path)
            .args(arguments)
            .arg(format!("--max-points={}", self.max_points))
            .arg(format!("--max-bytes={}", self.max_bytes))
            .arg(format!("--memory-bytes={memory_bytes}"))
            .arg("--until-input-ends")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .kill_on_drop(true);
        if file.assume_orientation {
            command.arg("--assume-orientation");
        }
        if let Some(format) = file.hint {
            command.arg(format!("--hint={}", format.name()));
        }
        let mut child = command.spawn().map_err(Error::failed)?;
        // Ends with this process, however that is ended.
        let _input = child.stdin.take();
        let output = tokio::time::timeout(CHILD_TIMEOUT, child.wait_with_output())
            .await
            .map_err(|_| Error::TooSlow)?
            .map_err(Error::failed)?;
        match output.status.signal() {
            None => Ok(output.stdout),
            // An allocation that was refused aborts, and the kernel kills.
            Some(SIGABRT | SIGKILL) => {
                tracing::warn!(child.status = %output.status, "a file could not be read for want of memory");
                Err(Error::OutOfMemory)
            }
            Some(signal) => Err(Error::failed(format!(
                "signal {signal} ended the reader of a file"
            ))),
        }
    }
}

/// A file to be read.
#[derive(Debug, Clone, Copy)]
pub struct File<'a> {
    /// Where it is.
    pub path: &'a Path,
    /// Number of its bytes.
    pub bytes: u64,
    /// Its format, where its content leaves that open.
    pub hint: Option<Format>,
    /// Whether a label map without an orientation is taken as it lies.
    pub assume_orientation: bool,
}

/// Who read a file, and what came of it.
enum Reading<T> {
    /// This process, with what it made of the cloud.
    Here(T),
    /// A child process, with what it printed.
    InChild(Vec<u8>),
}

/// What a child process said of a file.
fn verdict(said: &[u8]) -> Result<Summary, Error> {
    match serde_json::from_slice(said).map_err(Error::failed)? {
        Verdict::Cloud(summary) => Ok(summary),
        Verdict::DiskFull => Err(Error::DiskFull),
        Verdict::Refused { code, detail } => Err(Error::Refused { code, detail }),
    }
}

/// Waits for the given memory, or for all there is if it is more.
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
