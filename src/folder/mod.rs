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
/// Folder of uploads that may go on after they were cut, by their ids.
pub const RESUMABLE: &str = "uploads";
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
    let places = [CLOUDS, UPLOADS, RESUMABLE, CACHE];
    places.iter().try_for_each(|place| make(&path.join(place)))
}

/// Makes a file in a folder of the data folder, and the folder again where somebody has removed it;
/// not the data folder itself, without which nothing can be kept.
///
/// # Errors
/// Those of making it.
pub fn in_folder<T>(folder: &Path, make: impl Fn() -> io::Result<T>) -> io::Result<T> {
    match make() {
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            match DirBuilder::new().mode(0o700).create(folder) {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => Err(error),
                _ => make(),
            }
        }
        made => made,
    }
}
