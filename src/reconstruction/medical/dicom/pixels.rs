//! Pixels of frames: bit by bit, in bytes, or packed by runs.

use std::borrow::Cow;
use std::io::Read;

use flate2::read::DeflateDecoder;

use super::element::{DataSet, Value};
use super::syntax::{ADVICE, Syntax};
use super::tags;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::enough;
use crate::reconstruction::medical::Reading;
use crate::reconstruction::medical::affine::header;

/// All frames, one behind the other.
#[derive(Debug)]
pub(super) struct Pixels<'a> {
    data: Cow<'a, [u8]>,
    /// Bits of a pixel: 1, 8 or 16.
    bits: usize,
    /// Bits from one frame to the next.
    stride: usize,
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) frames: usize,
}

impl<'a> Pixels<'a> {
    /// The pixels of a data set, whose size is checked against the bytes.
    ///
    /// # Errors
    /// [`Error::Header`], [`Error::Truncated`], [`Error::UnsupportedFormat`] for how they are packed.
    pub(super) fn of<'d>(
        data_set: &DataSet<'d>,
        syntax: &Syntax,
        reading: &Reading,
        keep: impl Fn(&'d [u8]) -> Cow<'a, [u8]>,
    ) -> Result<Self, Error> {
        let size = |tag, what: &str| {
            let size = data_set.short(tag).map_or(0, usize::from);
            if size == 0 {
                Err(header(format!("{what} are missing")))
            } else {
                Ok(size)
            }
        };
        let (rows, columns) = (size(tags::ROWS, "Rows")?, size(tags::COLUMNS, "Columns")?);
        let frames = match data_set.bytes(tags::FRAMES) {
            [] => 1,
            _ => data_set
                .integer(tags::FRAMES)
                .and_then(|frames| usize::try_from(frames).ok())
                .unwrap_or(0),
        };
        if frames == 0 {
            return Err(header("NumberOfFrames must be 1 at least"));
        }
        let bits = data_set.short(tags::BITS_ALLOCATED).map_or(0, usize::from);
        if ![1, 8, 16].contains(&bits) {
            return Err(header(format!(
                "BitsAllocated is {bits}, must be 1, 8 or 16"
            )));
        }
        let plain = rows * columns * bits;
        let mut pixels = Self {
            data: Cow::Borrowed(&[]),
            bits,
            stride: plain,
            columns,
            rows,
            frames,
        };
        let what = "the pixels of the frames";
        match data_set.get(tags::PIXEL_DATA) {
            Some(&Value::Bytes(data)) => {
                // Whole bytes are counted, since frames need not begin with one.
                let needed = frames
                    .checked_mul(plain)
                    .map_or(usize::MAX, |bits| bits.div_ceil(8));
                enough(what, needed, 1, data.len())?;
                pixels.data = keep(&data[..needed]);
            }
            Some(Value::Fragments(fragments))
                if matches!(syntax, Syntax::Runs | Syntax::DeflatedFrames) =>
            {
                enough(what, frames, 1, fragments.len())?;
                pixels.stride = plain.next_multiple_of(8);
                pixels.data = Cow::Owned(pixels.unpacked(fragments, *syntax, reading)?);
            }
            Some(Value::Fragments(_)) => {
                let name = match syntax {
                    Syntax::Packed(name) => name,
                    _ => "a way that the transfer syntax does not name",
                };
                let detail = format!("pixels packed by {name} are not read; {ADVICE}");
                return Err(Error::UnsupportedFormat(detail));
            }
            _ => return Err(header("PixelData is missing")),
        }
        Ok(pixels)
    }

    /// The frames of fragments, each of which has one.
    fn unpacked(
        &self,
        fragments: &[&[u8]],
        syntax: Syntax,
        reading: &Reading,
    ) -> Result<Vec<u8>, Error> {
        let frame = self.stride / 8;
        let limit = reading.max_expanded_bytes;
        if frame.saturating_mul(self.frames) > limit {
            return Err(Error::ExpandsTooFar { limit });
        }
        let mut data = Vec::new();
        let samples = if self.bits == 16 { 2 } else { 1 };
        for fragment in &fragments[..self.frames] {
            if syntax == Syntax::DeflatedFrames {
                data.extend(inflated_frame(fragment, frame)?);
                continue;
            }
            let planes = byte_planes(fragment, samples, frame / samples)?;
            match &planes[..] {
                [plane] => data.extend(plane),
                // The more significant bytes come first.
                planes => {
                    let pairs = planes[1].iter().zip(&planes[0]);
                    data.extend(pairs.flat_map(|(&low, &high)| [low, high]));
                }
            }
        }
        Ok(data)
    }

    /// A pixel of a frame; zero outside.
    pub(super) fn at(&self, frame: usize, column: usize, row: usize) -> u16 {
        let pixel = row * self.columns + column;
        let bit = frame * self.stride + pixel * self.bits;
        let byte = |at: usize| self.data.get(at).copied().unwrap_or(0);
        match self.bits {
            1 => u16::from(byte(bit / 8) >> (bit % 8) & 1),
            8 => u16::from(byte(bit / 8)),
            _ => u16::from_le_bytes([byte(bit / 8), byte(bit / 8 + 1)]),
        }
    }
}

fn inflated_frame(fragment: &[u8], length: usize) -> Result<Vec<u8>, Error> {
    let mut frame = Vec::new();
    let read = DeflateDecoder::new(fragment)
        .take(length as u64)
        .read_to_end(&mut frame);
    read.map_err(|error| Error::Compression(format!("a frame is damaged ({error})")))?;
    enough("the pixels of a frame", length, 1, frame.len())?;
    Ok(frame)
}

/// The bytes of a frame, those of one significance after the other.
fn byte_planes(fragment: &[u8], count: usize, length: usize) -> Result<Vec<Vec<u8>>, Error> {
    let word = |at: usize| {
        let bytes = fragment.get(4 * at..).and_then(|bytes| bytes.first_chunk());
        bytes.map(|bytes| u32::from_le_bytes(*bytes) as usize)
    };
    if word(0) != Some(count) {
        return Err(header(format!(
            "a frame packed by runs must have {count} segments"
        )));
    }
    let plane = |i: usize| {
        let start = word(1 + i)?;
        let end = if i + 1 < count {
            word(2 + i)?
        } else {
            fragment.len()
        };
        runs(fragment.get(start..end)?, length)
    };
    let planes: Option<Vec<_>> = (0..count).map(plane).collect();
    planes.ok_or_else(|| Error::Compression("a frame packed by runs is damaged".to_owned()))
}

/// `PackBits` with a known result; `None` where there is less.
fn runs(mut bytes: &[u8], length: usize) -> Option<Vec<u8>> {
    let mut unpacked = Vec::new();
    while unpacked.len() < length {
        let (&head, rest) = bytes.split_first()?;
        bytes = match head {
            0..=127 => {
                let (piece, rest) = rest.split_at_checked(usize::from(head) + 1)?;
                unpacked.extend(piece);
                rest
            }
            128 => rest,
            129..=255 => {
                let (&byte, rest) = rest.split_first()?;
                unpacked.extend(std::iter::repeat_n(byte, 257 - usize::from(head)));
                rest
            }
        };
    }
    unpacked.truncate(length);
    Some(unpacked)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_unpacked() {
        let packed = [0xfe, 0xaa, 2, 0x80, 0, 0x2a, 0xfd, 0xaa];
        let unpacked = [0xaa, 0xaa, 0xaa, 0x80, 0, 0x2a, 0xaa, 0xaa, 0xaa, 0xaa];
        assert_eq!(runs(&packed, 10).unwrap(), unpacked);
        assert_eq!(runs(&packed[..3], 10), None);
    }

    #[test]
    fn frames_of_bits_need_not_begin_with_a_byte() {
        // Two frames of three pixels: 1 0 1, 0 1 1.
        let pixels = Pixels {
            data: Cow::Owned(vec![0b11_0101]),
            bits: 1,
            stride: 3,
            columns: 3,
            rows: 1,
            frames: 2,
        };
        let frame = |frame| [0, 1, 2].map(|column| pixels.at(frame, column, 0));
        assert_eq!(frame(0), [1, 0, 1]);
        assert_eq!(frame(1), [0, 1, 1]);
    }
}
