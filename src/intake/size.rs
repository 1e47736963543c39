//! How much memory the reading of a file may need.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::Path;

use flate2::read::MultiGzDecoder;

use super::{IN_PROCESS_BYTES, MAX_EXPANSION};
use crate::reconstruction::cloud::Format;

/// Most bytes that a gzipped byte can become.
const MOST_OF_GZIP: u64 = 1032;

/// Bytes that show which process is to read a file.
const LOOKED_AT: u64 = 1 << 12;

/// What the header of a PCD file has whose points are packed.
const PACKED_PCD: &[u8] = b"binary_compressed";

/// How many bytes a file has when unpacked.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Size {
    /// Exactly this many, at most [`IN_PROCESS_BYTES`], and nothing in them is packed again.
    Known(u64),
    /// At most this many.
    UpTo(u64),
    /// At most this many, of a format that a child always reads.
    Slices(u64),
}

impl Size {
    /// Looks at a file of `bytes` bytes, which may unpack to at most `limit`. Takes memory for
    /// [`IN_PROCESS_BYTES`].
    pub(super) fn of(
        path: &Path,
        bytes: u64,
        limit: u64,
        hint: Option<Format>,
    ) -> io::Result<Self> {
        let file = || File::open(path);
        let mut magic = Vec::new();
        file()?.take(2).read_to_end(&mut magic)?;
        let gzipped = magic == [0x1f, 0x8b];
        let expanded = |bytes: u64| Self::UpTo(limit.min(bytes.saturating_mul(MAX_EXPANSION)));
        let mut head = Vec::new();
        let looked_at = if gzipped {
            let reader = MultiGzDecoder::new(BufReader::new(file()?));
            reader.take(LOOKED_AT).read_to_end(&mut head)
        } else {
            file()?.take(LOOKED_AT).read_to_end(&mut head)
        };
        match Format::seen(&head).or(hint) {
            Some(format) if format.has_slices() => {
                // Whether it is packed, or what is in it.
                let most = bytes.saturating_mul(MOST_OF_GZIP);
                return Ok(Self::Slices(limit.min(most)));
            }
            Some(Format::Vtk | Format::Vtp) => return Ok(expanded(bytes)),
            // Whoever reads the file reports damage.
            _ if looked_at.is_err() => return Ok(expanded(bytes)),
            _ => {}
        }
        if bytes > IN_PROCESS_BYTES {
            return Ok(if gzipped {
                expanded(bytes)
            } else {
                Self::UpTo(bytes)
            });
        }
        let mut content = Vec::new();
        let one_more = IN_PROCESS_BYTES + 1;
        let unpacked = if gzipped {
            // Whoever reads the file reports damage; only what comes before it counts here.
            let mut reader = MultiGzDecoder::new(BufReader::new(file()?)).take(one_more);
            let read = reader.read_to_end(&mut content);
            read.or::<io::Error>(Ok(content.len()))
        } else {
            file()?.take(one_more).read_to_end(&mut content)
        };
        let unpacked = unpacked? as u64;
        if unpacked > IN_PROCESS_BYTES {
            Ok(expanded(bytes))
        } else if content
            .windows(PACKED_PCD.len())
            .any(|part| part == PACKED_PCD)
        {
            Ok(expanded(unpacked))
        } else {
            Ok(Self::Known(unpacked))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use flate2::Compression;
    use flate2::write::GzEncoder;

    use super::*;

    fn size(content: &[u8], times_packed: usize) -> (u64, Size) {
        let mut content = content.to_vec();
        for _ in 0..times_packed {
            let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
            encoder.write_all(&content).unwrap();
            content = encoder.finish().unwrap();
        }
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(&content).unwrap();
        let bytes = content.len() as u64;
        (bytes, Size::of(file.path(), bytes, 1 << 30, None).unwrap())
    }

    #[test]
    fn what_can_expand_is_weighed_by_what_it_may_become() {
        assert_eq!(size(b"1 2 3\n", 0).1, Size::Known(6));
        assert_eq!(size(b"1 2 3\n", 1).1, Size::Known(6));
        let zeros = vec![b'0'; 3 << 20];
        assert_eq!(size(&zeros, 0).1, Size::UpTo(3 << 20));
        let (bytes, found) = size(&zeros, 1);
        assert!(bytes < 10_000, "{bytes}");
        assert_eq!(found, Size::UpTo(100 * bytes));
        let pcd = b"# .PCD v0.7\nDATA binary_compressed\n";
        for times_packed in [0, 1] {
            assert_eq!(
                size(pcd, times_packed).1,
                Size::UpTo(100 * pcd.len() as u64)
            );
        }
    }
}
