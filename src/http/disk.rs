//! The guard of the disk: new work is refused before the disk is full, so that what is under way
//! can be finished and its result kept.

use std::io;
use std::path::PathBuf;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use super::error::{ApiError, Code};
use crate::config::Config;

/// How long an answer of the file system is believed.
const BELIEVED_FOR: Duration = Duration::from_secs(1);

const MIB: u64 = 1024 * 1024;

/// Watches the file system of the data folder.
#[derive(Debug)]
pub struct Disk {
    folder: PathBuf,
    reserve_bytes: u64,
    reserve_percent: u64,
    last: Mutex<Option<(Instant, Space)>>,
}

/// Space of a file system in bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Space {
    /// All of it.
    pub total_bytes: u64,
    /// What a process without privileges can still write.
    pub free_bytes: u64,
}

impl Disk {
    /// Watches the data folder of the configuration with the reserves set there.
    pub fn new(config: &Config) -> Self {
        Self {
            folder: config.data_dir.clone(),
            reserve_bytes: config.disk_reserve_mib.saturating_mul(MIB),
            reserve_percent: u64::from(config.disk_reserve_percent),
            last: Mutex::new(None),
        }
    }

    /// The space as it was within the last second.
    ///
    /// # Errors
    /// When the file system cannot be asked.
    pub fn space(&self) -> io::Result<Space> {
        let mut last = self
            .last
            .lock()
            .unwrap_or_else(std::sync::PoisonError::into_inner);
        if let Some((at, space)) = *last
            && at.elapsed() < BELIEVED_FOR
        {
            return Ok(space);
        }
        let found = rustix::fs::statvfs(&self.folder)?;
        let space = Space {
            total_bytes: found.f_blocks * found.f_frsize,
            free_bytes: found.f_bavail * found.f_frsize,
        };
        *last = Some((Instant::now(), space));
        Ok(space)
    }

    /// Free bytes below which new work is refused, on a disk of the given size.
    pub fn reserve_bytes(&self, total_bytes: u64) -> u64 {
        self.reserve_bytes
            .max(total_bytes / 100 * self.reserve_percent)
    }

    /// Whether the reserve is still there after writing so many bytes more.
    ///
    /// # Errors
    /// [`Code::InsufficientStorage`].
    pub fn check(&self, more_bytes: u64) -> Result<(), ApiError> {
        let space = self.space().map_err(ApiError::internal)?;
        let reserve = self.reserve_bytes(space.total_bytes);
        if space.free_bytes >= reserve.saturating_add(more_bytes) {
            return Ok(());
        }
        Err(ApiError::new(
            Code::InsufficientStorage,
            format!(
                "{} MiB of the disk are free and {} MiB are kept free; erase jobs or clouds",
                space.free_bytes / MIB,
                reserve / MIB
            ),
        ))
    }
}
