//! Numbers of VTK's arrays, however they are written.

use std::io::Read;

use flate2::read::ZlibDecoder;

use super::{ByteOrder, Scalar};
use crate::reconstruction::cloud::Error;

/// Numbers one behind the other, three for each point.
pub(super) type Numbers = Vec<f64>;

/// The type of a name in legacy files.
pub(super) fn scalar(name: &[u8]) -> Option<Scalar> {
    Some(match name.to_ascii_lowercase().as_slice() {
        b"float" => Scalar::F32,
        b"double" => Scalar::F64,
        b"char" => Scalar::I8,
        b"unsigned_char" => Scalar::U8,
        b"short" => Scalar::I16,
        b"unsigned_short" => Scalar::U16,
        b"int" => Scalar::I32,
        b"unsigned_int" => Scalar::U32,
        b"vtktypeint64" | b"long" => Scalar::I64,
        b"vtktypeuint64" | b"unsigned_long" => Scalar::U64,
        _ => return None,
    })
}

/// All numbers of a type in `data`.
pub(super) fn numbers(data: &[u8], scalar: Scalar, order: ByteOrder) -> Numbers {
    let pieces = data.chunks_exact(scalar.size());
    pieces
        .filter_map(|piece| scalar.read(order, piece))
        .collect()
}

/// The bytes of a base64 text up to `most`; it may hold several texts, each with its padding.
pub(super) fn of_base64(text: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    let (mut bits, mut count) = (0_u32, 0);
    for &letter in text.iter().filter(|b| !b.is_ascii_whitespace()) {
        if bytes.len() >= most {
            break;
        }
        let value = match letter {
            b'A'..=b'Z' => letter - b'A',
            b'a'..=b'z' => letter - b'a' + 26,
            b'0'..=b'9' => letter - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            b'=' => {
                (bits, count) = (0, 0);
                continue;
            }
            // What is appended ends with a tag.
            b'<' => break,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
            bits &= (1 << count) - 1;
        }
    }
    Some(bytes)
}

/// How an array's bytes are packed.
#[derive(Debug, Clone, Copy)]
pub(super) struct Packing {
    /// Type of the numbers in front of the data.
    pub(super) head: Scalar,
    pub(super) order: ByteOrder,
    pub(super) zlib: bool,
}

impl Packing {
    /// The data of an array that is to have `length` bytes.
    ///
    /// # Errors
    /// [`Error::Truncated`], [`Error::Compression`].
    pub(super) fn unpack(self, bytes: &[u8], length: usize) -> Result<Vec<u8>, Error> {
        let width = self.head.size();
        let head = |i: usize| {
            let number = bytes
                .get(i * width..)
                .and_then(|bytes| self.head.read(self.order, bytes));
            number
                .map(|number| number as usize)
                .ok_or_else(|| truncated(length, 0))
        };
        if !self.zlib {
            let data = bytes.get(width..).unwrap_or_default();
            let data = data
                .get(..length)
                .ok_or_else(|| truncated(length, data.len()))?;
            return Ok(data.to_vec());
        }
        // Number of blocks, their size, that of the last one, then the packed size of each.
        let blocks = head(0)?;
        let heads = blocks
            .checked_add(3)
            .and_then(|heads| heads.checked_mul(width));
        let mut left = heads
            .and_then(|heads| bytes.get(heads..))
            .unwrap_or_default();
        let mut data = Vec::new();
        for block in 0..blocks {
            if data.len() >= length {
                break;
            }
            let packed = head(3 + block)?;
            let (piece, rest) = left
                .split_at_checked(packed)
                .ok_or_else(|| truncated(length, data.len()))?;
            left = rest;
            let most = (length - data.len()) as u64;
            let read = ZlibDecoder::new(piece).take(most).read_to_end(&mut data);
            read.map_err(|error| Error::Compression(format!("an array is damaged ({error})")))?;
        }
        if data.len() < length {
            return Err(truncated(length, data.len()));
        }
        Ok(data)
    }
}

fn truncated(declared: usize, found: usize) -> Error {
    Error::Truncated {
        what: "the bytes of an array".to_owned(),
        declared: declared as u64,
        found: found as u64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_may_be_padded_in_the_middle() {
        assert_eq!(of_base64(b"TWE=TWFu\nTQ==", usize::MAX).unwrap(), b"MaManM");
        assert_eq!(of_base64(b"TW*u", usize::MAX), None);
        assert_eq!(of_base64(b"TWFuTWFu", 2).unwrap(), b"Ma");
    }
}
