//! Writes a body to a file; decodes, hashes and limits it on the way.
//!
//! Synchronous: the caller hands in batches on threads that may block.

use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::Path;

use flate2::write::MultiGzDecoder;
use sha2::{Digest, Sha256};
use tempfile::NamedTempFile;
use zstd::stream::raw::{DParameter, Decoder as ZstdDecoder};
use zstd::stream::zio;

use crate::folder::in_folder;
use crate::http::wire::download::hex;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::intake::MAX_EXPANSION;

/// Bodies that expand to less than this may expand by any factor.
const ALWAYS_ALLOWED: u64 = 1 << 20;

/// Largest window of zstd: 8 MiB, as RFC 9659 sets it for content encodings.
const ZSTD_WINDOW_LOG: u32 = 23;

/// Bytes that are read at once to hash a file.
const BLOCK: usize = 1 << 20;

/// How a body is encoded (RFC 9110 section 8.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::http) enum Encoding {
    Identity,
    Gzip,
    Zstd,
}

impl Encoding {
    /// The encoding of the value of `Content-Encoding`.
    ///
    /// # Errors
    /// [`Code::UnsupportedEncoding`] for any other, and for several at once.
    pub(in crate::http) fn of(value: Option<&str>) -> Result<Self> {
        match value
            .map(|value| value.trim().to_ascii_lowercase())
            .as_deref()
        {
            None | Some("" | "identity") => Ok(Self::Identity),
            Some("gzip" | "x-gzip") => Ok(Self::Gzip),
            Some("zstd") => Ok(Self::Zstd),
            Some(other) => Err(ApiError::new(
                Code::UnsupportedEncoding,
                format!("Content-Encoding {other:.40} is not known; gzip and zstd are"),
            )),
        }
    }
}

/// A complete body on disk, in a temporary file.
#[derive(Debug)]
pub(in crate::http) struct Spooled {
    /// The file. Dropping it removes it.
    pub(in crate::http) file: NamedTempFile,
    /// SHA-256 in hexadecimal digits.
    pub(in crate::http) sha256: String,
    /// Number of bytes after decoding.
    pub(in crate::http) bytes: u64,
}

impl Spooled {
    /// A file that was written already, brought to the disk.
    ///
    /// # Errors
    /// What is wrong with the disk.
    pub(in crate::http) fn of(file: NamedTempFile) -> io::Result<Self> {
        let bytes = file.as_file().metadata()?.len();
        let (mut hash, mut block, mut at) = (Sha256::new(), vec![0; BLOCK], 0);
        while at < bytes {
            let read = file.as_file().read_at(&mut block, at)?;
            if read == 0 {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            hash.update(&block[..read]);
            at += read as u64;
        }
        file.as_file().sync_all()?;
        Ok(Self {
            sha256: hex(hash.finalize()),
            bytes,
            file,
        })
    }
}

/// A body on its way to disk.
pub(in crate::http) struct Spool {
    decoder: Decoder,
    received: u64,
}

enum Decoder {
    Identity(Sink),
    Gzip(MultiGzDecoder<Sink>),
    Zstd(zio::Writer<Sink, ZstdDecoder<'static>>),
}

impl Spool {
    /// An empty file in `folder`, for a body of at most `limit` bytes both as sent and decoded.
    ///
    /// # Errors
    /// `Internal` when the file cannot be made.
    pub(in crate::http) fn new(folder: &Path, encoding: Encoding, limit: u64) -> Result<Self> {
        let sink = Sink {
            file: in_folder(folder, || NamedTempFile::new_in(folder))
                .map_err(ApiError::internal)?,
            hash: Sha256::new(),
            bytes: 0,
            limit,
            allowed: 0,
            exceeded: false,
            failed: false,
        };
        let decoder = match encoding {
            Encoding::Identity => Decoder::Identity(sink),
            Encoding::Gzip => Decoder::Gzip(MultiGzDecoder::new(sink)),
            Encoding::Zstd => {
                let mut zstd = ZstdDecoder::new().map_err(ApiError::internal)?;
                zstd.set_parameter(DParameter::WindowLogMax(ZSTD_WINDOW_LOG))
                    .map_err(ApiError::internal)?;
                Decoder::Zstd(zio::Writer::new(sink, zstd))
            }
        };
        Ok(Self {
            decoder,
            received: 0,
        })
    }

    /// Takes the next bytes as they were sent.
    ///
    /// # Errors
    /// [`Code::BodyTooLarge`], [`Code::UnsupportedEncoding`] for damaged streams,
    /// [`Code::InsufficientStorage`].
    pub(in crate::http) fn push(&mut self, batch: &[u8]) -> Result<()> {
        self.received += batch.len() as u64;
        let received = self.received;
        let encoded = !matches!(self.decoder, Decoder::Identity(_));
        let sink = self.sink();
        if received > sink.limit {
            return Err(too_large(sink.limit));
        }
        sink.allowed = if encoded {
            sink.limit
                .min(ALWAYS_ALLOWED.max(received.saturating_mul(MAX_EXPANSION)))
        } else {
            sink.limit
        };
        let written = match &mut self.decoder {
            Decoder::Identity(sink) => sink.write_all(batch),
            Decoder::Gzip(decoder) => decoder.write_all(batch),
            Decoder::Zstd(decoder) => decoder.write_all(batch),
        };
        written.map_err(|error| self.refusal(&error))
    }

    /// Ends the body: the file is complete and on disk.
    ///
    /// # Errors
    /// As [`Spool::push`].
    pub(in crate::http) fn finish(mut self) -> Result<Spooled> {
        let ended = match &mut self.decoder {
            Decoder::Identity(sink) => sink.flush(),
            Decoder::Gzip(decoder) => decoder.try_finish(),
            Decoder::Zstd(decoder) => decoder.finish(),
        };
        ended.map_err(|error| self.refusal(&error))?;
        let sink = self.sink();
        let synced = sink.file.as_file().sync_all();
        synced.map_err(|error| storage(&error))?;
        let (sha256, bytes) = (hex(sink.hash.finalize_reset()), sink.bytes);
        Ok(Spooled {
            file: self.into_sink()?.file,
            sha256,
            bytes,
        })
    }

    fn sink(&mut self) -> &mut Sink {
        match &mut self.decoder {
            Decoder::Identity(sink) => sink,
            Decoder::Gzip(decoder) => decoder.get_mut(),
            Decoder::Zstd(decoder) => decoder.writer_mut(),
        }
    }

    fn into_sink(self) -> Result<Sink> {
        match self.decoder {
            Decoder::Identity(sink) => Ok(sink),
            Decoder::Gzip(decoder) => decoder.finish().map_err(ApiError::internal),
            Decoder::Zstd(decoder) => Ok(decoder.into_inner().0),
        }
    }

    /// Why a write failed: the limit, the disk, or the stream.
    fn refusal(&mut self, error: &io::Error) -> ApiError {
        let sink = self.sink();
        if sink.exceeded && sink.allowed < sink.limit {
            let detail = format!("the body expands to more than {MAX_EXPANSION} times its size");
            ApiError::new(Code::BodyTooLarge, detail)
        } else if sink.exceeded {
            too_large(sink.limit)
        } else if sink.failed {
            storage(error)
        } else {
            ApiError::new(
                Code::UnsupportedEncoding,
                "the body is not what its Content-Encoding says, or is damaged or cut short",
            )
        }
    }
}

/// A body larger than the limit.
pub(in crate::http) fn too_large(limit: u64) -> ApiError {
    ApiError::new(
        Code::BodyTooLarge,
        format!("the body has more than {limit} bytes"),
    )
    .with("limit_bytes", limit.into())
}

/// A file that cannot be written.
pub(in crate::http) fn storage(error: &io::Error) -> ApiError {
    if error.kind() == io::ErrorKind::StorageFull {
        return ApiError::new(Code::InsufficientStorage, "the disk is full");
    }
    ApiError::internal(error)
}

/// Where decoded bytes go.
struct Sink {
    file: NamedTempFile,
    hash: Sha256,
    bytes: u64,
    /// Most bytes.
    limit: u64,
    /// Most bytes for what was received so far.
    allowed: u64,
    exceeded: bool,
    failed: bool,
}

impl Write for Sink {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        if self.bytes + data.len() as u64 > self.allowed {
            self.exceeded = true;
            return Err(io::Error::other("more than allowed"));
        }
        let written = self.file.write(data).inspect_err(|_| self.failed = true)?;
        self.hash.update(&data[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}
