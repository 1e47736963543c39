//! An upload that may go on after it was cut: the bytes are a file, the rest is a row.

use super::{CloudId, Problem, UploadId};
use crate::identity::Tenant;
use crate::reconstruction::cloud::Format;

/// An upload as its row has it; its bytes are the file `uploads/<id>` of the data folder until
/// something came of it. Times are milliseconds since the epoch.
#[derive(Debug, Clone, PartialEq)]
pub struct Upload {
    /// Its name.
    pub id: UploadId,
    /// Whose it is.
    pub tenant: Tenant,
    /// Number of all bytes, once it is known.
    pub length: Option<u64>,
    /// Number of bytes that are on the disk.
    pub bytes: u64,
    /// Whether no more will come.
    pub complete: bool,
    /// Format suggested by media type or file name, for contents that do not show theirs.
    pub hint: Option<Format>,
    /// Whether a label map without an orientation is taken as it lies.
    pub assume_orientation: bool,
    /// What came of it; none before it is complete, and while its bytes are read.
    pub end: Option<UploadEnd>,
    /// When it was begun.
    pub created_at: i64,
    /// When it is forgotten, unless bytes come before.
    pub expires_at: i64,
}

/// What came of a complete upload.
#[derive(Debug, Clone, PartialEq)]
pub enum UploadEnd {
    /// A cloud.
    Cloud(CloudId),
    /// Nothing, and why.
    Refused(Problem),
}

/// An upload that is begun. Its file is in place.
#[derive(Debug, Clone, PartialEq)]
pub struct NewUpload {
    /// Its name.
    pub id: UploadId,
    /// Number of all bytes, where it is known.
    pub length: Option<u64>,
    /// Format suggested by media type or file name.
    pub hint: Option<Format>,
    /// Whether a label map without an orientation is taken as it lies.
    pub assume_orientation: bool,
    /// How long it is kept without bytes, in milliseconds.
    pub keep_ms: i64,
}

/// How an upload went on. Its bytes are on the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Step {
    /// Number of bytes before.
    pub from: u64,
    /// Number of bytes now.
    pub to: u64,
    /// Number of all bytes, where it is known now.
    pub length: Option<u64>,
    /// Whether no more will come.
    pub complete: bool,
    /// How long it is kept without further bytes, in milliseconds.
    pub keep_ms: i64,
}
