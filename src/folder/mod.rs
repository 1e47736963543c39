//! The data folder of a service: its places, the names of the files in them, the space that is left.

mod disk;
pub mod names;

pub use disk::{Disk, Shortage, Space};

/// Folder of the uploaded bytes, by their SHA-256.
pub const CLOUDS: &str = "clouds";
/// Folder of uploads under way.
pub const UPLOADS: &str = "tmp";
/// Folder of encoded meshes.
pub const CACHE: &str = "cache";
