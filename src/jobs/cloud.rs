//! An uploaded cloud as the service knows it: the bytes are a file, the rest is a row.

use super::CloudId;
use crate::intake::Summary;

/// A cloud as its row has it; its bytes are the file `clouds/<sha256>` of the data folder, or an object.
#[derive(Debug, Clone, PartialEq)]
pub struct Cloud {
    /// Its name.
    pub id: CloudId,
    /// Hash of the bytes, in lower-case hexadecimal digits.
    pub sha256: String,
    /// Number of bytes.
    pub bytes: u64,
    /// Names the bytes in the object store, and never names others; none: they are the file.
    pub object: Option<String>,
    /// What the upload found.
    pub summary: Summary,
    /// When it was first uploaded, in milliseconds since the epoch.
    pub created_at: i64,
    /// When it is erased; none where it is kept for ever.
    pub expires_at: Option<i64>,
    /// Whether it must not be erased.
    pub hold: bool,
}

/// A cloud whose file is in place and whose row is to be written.
#[derive(Debug, Clone, PartialEq)]
pub struct NewCloud {
    /// Hash of the bytes, in lower-case hexadecimal digits.
    pub sha256: String,
    /// Number of bytes.
    pub bytes: u64,
    /// What the upload found.
    pub summary: Summary,
    /// How long it is kept, in milliseconds; none: for ever.
    pub keep_ms: Option<i64>,
}

/// What became of the wish to erase a cloud.
#[derive(Debug, Clone, PartialEq)]
pub enum CloudDeletion {
    /// The row is gone; the file may go.
    Deleted(Box<Cloud>),
    /// A job that has not ended needs it.
    InUse,
    /// There is no such cloud.
    Missing,
}
