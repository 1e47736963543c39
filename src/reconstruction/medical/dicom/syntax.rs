//! How a data set is written: the transfer syntaxes, and the group of elements that names one.

use std::io::Read;

use flate2::read::DeflateDecoder;

use super::parser::{self, starts_explicit};
use super::tags;
use crate::reconstruction::cloud::Error;

/// A way of writing a data set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Syntax {
    /// Without types, little endian.
    Implicit,
    /// With types, little endian.
    Explicit,
    /// As [`Syntax::Explicit`], and deflated.
    Deflated,
    /// As [`Syntax::Explicit`], with pixels packed by runs.
    Runs,
    /// As [`Syntax::Explicit`], with each frame deflated.
    DeflatedFrames,
    /// As [`Syntax::Explicit`], with pixels packed in a way that is not read.
    Packed(&'static str),
}

/// Ways of packing pixels, by their identifiers below `1.2.840.10008.1.2`.
const PACKED: &[(&str, &str)] = &[
    (".4.50", "JPEG Baseline"),
    (".4.51", "JPEG Extended"),
    (".4.57", "JPEG Lossless"),
    (".4.70", "JPEG Lossless"),
    (".4.80", "JPEG-LS Lossless"),
    (".4.81", "JPEG-LS"),
    (".4.90", "JPEG 2000 Lossless"),
    (".4.91", "JPEG 2000"),
    (".4.201", "High-Throughput JPEG 2000 Lossless"),
    (".4.202", "High-Throughput JPEG 2000 Lossless RPCL"),
    (".4.203", "High-Throughput JPEG 2000"),
];

impl Syntax {
    pub(super) fn is_explicit(self) -> bool {
        self != Self::Implicit
    }

    fn of(uid: &str) -> Result<Self, Error> {
        let below = uid.strip_prefix("1.2.840.10008.1.2");
        Ok(match below {
            Some("") => Self::Implicit,
            Some(".1") => Self::Explicit,
            Some(".1.99") => Self::Deflated,
            Some(".5") => Self::Runs,
            Some(".8.1") => Self::DeflatedFrames,
            Some(below) if PACKED.iter().any(|(end, _)| *end == below) => {
                let found = PACKED.iter().find(|(end, _)| *end == below);
                Self::Packed(found.map_or("", |(_, name)| name))
            }
            _ => {
                let name = match below {
                    Some(".2") => "Explicit VR Big Endian, retired",
                    _ => "unknown",
                };
                return Err(Error::UnsupportedFormat(format!(
                    "the transfer syntax {uid:.64} ({name}) is not read; {ADVICE}"
                )));
            }
        })
    }
}

/// What to do with a transfer syntax that is not read.
pub(super) const ADVICE: &str =
    "convert the file to Explicit VR Little Endian, for instance with dcmconv or gdcmconv --raw";

/// The transfer syntax that the elements of group 2 name, and what comes behind them. A data set
/// without them shows its own.
///
/// # Errors
/// [`Error::UnsupportedFormat`] for a transfer syntax that is not read.
pub(super) fn meta(bytes: &[u8]) -> Result<(Syntax, &[u8]), Error> {
    let own = |bytes| {
        if starts_explicit(bytes) {
            Syntax::Explicit
        } else {
            Syntax::Implicit
        }
    };
    if !bytes.starts_with(&[2, 0]) {
        return Ok((own(bytes), bytes));
    }
    let (group, rest) = parser::group(bytes, 2)?;
    match group.text(tags::TRANSFER_SYNTAX).as_str() {
        "" => Ok((own(rest), rest)),
        uid => Ok((Syntax::of(uid)?, rest)),
    }
}

/// The bytes of a deflated data set.
///
/// # Errors
/// [`Error::Compression`], [`Error::ExpandsTooFar`].
pub(super) fn inflated(bytes: &[u8], limit: usize) -> Result<Vec<u8>, Error> {
    let mut inflated = Vec::new();
    DeflateDecoder::new(bytes)
        .take((limit as u64).saturating_add(1))
        .read_to_end(&mut inflated)
        .map_err(|error| Error::Compression(format!("the data set is damaged ({error})")))?;
    if inflated.len() > limit {
        return Err(Error::ExpandsTooFar { limit });
    }
    Ok(inflated)
}
