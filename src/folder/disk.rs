//! Guards the disk: new work is refused before the disk is full, so that running work can be finished
//! and its results stored.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How long an answer of the file system is used.
const BELIEVED_FOR: Duration = Duration::from_secs(1);

const MIB: u64 = 1024 * 1024;

/// Space of a file system in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// All of it.
    pub total_bytes: u64,
    /// What a process without privileges can still write.
    pub free_bytes: u64,
}

impl Space {
    /// The space of the file system of a folder.
    ///
    /// # Errors
    /// When the file system cannot be asked.
    pub fn around(folder: &Path) -> io::Result<Self> {
        let found = rustix::fs::statvfs(folder)?;
        Ok(Self {
            total_bytes: found.f_blocks * found.f_frsize,
            free_bytes: found.f_bavail * found.f_frsize,
        })
    }
}

/// Why new work is refused.
#[derive(Debug, thiserror::Error)]
pub enum Shortage {
    /// The reserve would be used up.
    #[error(
        "{} MiB of the disk are free and {} MiB are kept free; erase jobs or clouds",
        free_bytes / MIB,
        reserve_bytes / MIB
    )]
    Reserve {
        /// What is free.
        free_bytes: u64,
        /// What is to stay free.
        reserve_bytes: u64,
    },
    /// The file system cannot be asked.
    #[error(transparent)]
    Unknown(#[from] io::Error),
}

/// Watches the file system of the data folder.
#[derive(Debug)]
pub struct Disk {
    folder: PathBuf,
    reserve_bytes: u64,
    reserve_percent: u64,
    /// Bytes that were promised to uploads and are not written yet.
    promised_bytes: AtomicU64,
    last: Mutex<Option<(Instant, Space)>>,
}

impl Disk {
    /// Watches the file system of a folder. The larger of the two reserves shall stay free.
    pub fn new(folder: PathBuf, reserve_mib: u64, reserve_percent: u32) -> Self {
        Self {
            folder,
            reserve_bytes: reserve_mib.saturating_mul(MIB),
            reserve_percent: u64::from(reserve_percent),
            promised_bytes: AtomicU64::new(0),
            last: Mutex::new(None),
        }
    }

    /// The space as it was within the last second.
    ///
    /// # Errors
    /// When the file system cannot be asked.
    pub fn space(&self) -> io::Result<Space> {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((at, space)) = *last
            && at.elapsed() < BELIEVED_FOR
        {
            return Ok(space);
        }
        let space = Space::around(&self.folder)?;
        *last = Some((Instant::now(), space));
        Ok(space)
    }

    /// Free bytes below which new work is refused, on a disk of the given size.
    pub fn reserve_bytes(&self, total_bytes: u64) -> u64 {
        self.reserve_bytes
            .max(total_bytes / 100 * self.reserve_percent)
    }

    /// Sets how many bytes are promised to uploads and not written yet: nobody else may have them.
    pub fn promise(&self, bytes: u64) {
        self.promised_bytes.store(bytes, Ordering::Relaxed);
    }

    /// Checks that the reserve stays free after writing this many bytes more, and all that was
    /// promised.
    ///
    /// # Errors
    /// Why not.
    pub fn check(&self, more_bytes: u64) -> Result<(), Shortage> {
        let promised = self.promised_bytes.load(Ordering::Relaxed);
        self.check_promised(more_bytes.saturating_add(promised))
    }

    /// [`Disk::check`] for bytes that are among the promised ones.
    ///
    /// # Errors
    /// Why not.
    pub fn check_promised(&self, more_bytes: u64) -> Result<(), Shortage> {
        let space = self.space()?;
        let reserve_bytes = self.reserve_bytes(space.total_bytes);
        if space.free_bytes >= reserve_bytes.saturating_add(more_bytes) {
            return Ok(());
        }
        Err(Shortage::Reserve {
            free_bytes: space.free_bytes,
            reserve_bytes,
        })
    }
}
