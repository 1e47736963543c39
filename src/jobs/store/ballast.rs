//! Room that is set aside on the disk, so that erasing works on a full one: it writes to the logs
//! before it gives any space back.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use crate::folder::Space;

/// Its file in the data folder.
const FILE: &str = "ballast";

/// Bytes that are written at a time.
static BLOCK: [u8; 64 * 1024] = [0; 64 * 1024];

/// A file that is there to be removed.
pub(super) struct Ballast {
    path: PathBuf,
    bytes: u64,
}

impl Ballast {
    /// One of so many bytes; of none, there is no file.
    pub(super) fn new(data_dir: &Path, bytes: u64) -> Self {
        let ballast = Self {
            path: data_dir.join(FILE),
            bytes,
        };
        ballast.fill();
        ballast
    }

    /// Sets the room aside where as much is left besides: what has just come free on a full disk is for others, and
    /// SQLite dies where a page of its index of the log finds no room.
    pub(super) fn fill(&self) {
        let there = fs::metadata(&self.path).is_ok_and(|file| file.len() >= self.bytes);
        if self.bytes == 0 || there || !self.has_room() {
            return;
        }
        if let Err(error) = self.write() {
            tracing::warn!(error.message = %error, "no room can be set aside for erasing");
            self.release();
        }
    }

    fn has_room(&self) -> bool {
        let folder = self.path.parent().unwrap_or(Path::new("."));
        Space::around(folder).is_ok_and(|space| space.free_bytes >= 2 * self.bytes)
    }

    /// Gives the room away; whether there was any.
    pub(super) fn release(&self) -> bool {
        self.bytes > 0 && fs::remove_file(&self.path).is_ok()
    }

    fn write(&self) -> io::Result<()> {
        // Written, because a file of a length alone takes no room.
        let mut file = File::create(&self.path)?;
        let mut left = self.bytes as usize;
        while left > 0 {
            let part = left.min(BLOCK.len());
            file.write_all(&BLOCK[..part])?;
            left -= part;
        }
        file.sync_all()
    }
}
