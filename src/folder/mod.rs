//! The data folder of a service: its places, the names of the files in them, the space that is left.

mod disk;
pub mod names;

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::Path;

pub use disk::{Disk, Shortage, Space};

/// Folder of the uploaded bytes, by their SHA-256.
pub const CLOUDS: &str = "clouds";
/// Folder of uploads under way.
pub const UPLOADS: &str = "tmp";
/// Folder of encoded meshes.
pub const CACHE: &str = "cache";

/// Makes a folder where it is missing, readable by the user of the service only: a cloud may be
/// somebody's body.
///
/// # Errors
/// When it cannot be made.
pub fn make(path: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(0o700).create(path)
}

/// Makes the places in a data folder.
///
/// # Errors
/// When one cannot be made.
pub fn make_places(path: &Path) -> io::Result<()> {
    let places = [CLOUDS, UPLOADS, CACHE];
    places.iter().try_for_each(|place| make(&path.join(place)))
}
