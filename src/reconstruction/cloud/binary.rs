//! Numbers in binary files: their types, and tables of records or of whole columns.

use super::Error;
use super::collector::Collector;

/// Which byte of a number comes first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::reconstruction) enum ByteOrder {
    /// The least significant.
    Little,
    /// The most significant.
    Big,
}

/// Type of a number in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::reconstruction) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F16,
    F32,
    F64,
}

impl Scalar {
    /// The type of a kind letter (`f`loat, `i`nteger, `u`nsigned) and a size in bytes.
    pub(in crate::reconstruction) fn of(kind: u8, size: usize) -> Option<Self> {
        Some(match (kind, size) {
            (b'i', 1) => Self::I8,
            (b'u', 1) => Self::U8,
            (b'i', 2) => Self::I16,
            (b'u', 2) => Self::U16,
            (b'i', 4) => Self::I32,
            (b'u', 4) => Self::U32,
            (b'i', 8) => Self::I64,
            (b'u', 8) => Self::U64,
            (b'f', 2) => Self::F16,
            (b'f', 4) => Self::F32,
            (b'f', 8) => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of one number.
    pub(in crate::reconstruction) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 | Self::F16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Whether the numbers are integers.
    pub(in crate::reconstruction) fn is_integer(self) -> bool {
        !matches!(self, Self::F16 | Self::F32 | Self::F64)
    }

    /// The number that `bytes` start with; `None` if there are too few.
    pub(in crate::reconstruction) fn read(self, order: ByteOrder, bytes: &[u8]) -> Option<f64> {
        macro_rules! number {
            ($type:ty) => {{
                let bytes = *bytes.first_chunk()?;
                match order {
                    ByteOrder::Little => <$type>::from_le_bytes(bytes),
                    ByteOrder::Big => <$type>::from_be_bytes(bytes),
                }
            }};
        }
        Some(match self {
            Self::I8 => f64::from(number!(i8)),
            Self::U8 => f64::from(number!(u8)),
            Self::I16 => f64::from(number!(i16)),
            Self::U16 => f64::from(number!(u16)),
            Self::I32 => f64::from(number!(i32)),
            Self::U32 => f64::from(number!(u32)),
            Self::I64 => number!(i64) as f64,
            Self::U64 => number!(u64) as f64,
            Self::F16 => half(number!(u16)),
            Self::F32 => f64::from(number!(f32)),
            Self::F64 => number!(f64),
        })
    }
}

/// The number that the bits of a float of 16 bits stand for: a sign, 5 bits of exponent, 10 of the
/// fraction.
fn half(bits: u16) -> f64 {
    let fraction = f64::from(bits & 0x3ff);
    let magnitude = match i32::from(bits >> 10 & 0x1f) {
        0 => fraction * 2f64.powi(-24),
        31 if fraction > 0.0 => f64::NAN,
        31 => f64::INFINITY,
        exponent => (1024.0 + fraction) * 2f64.powi(exponent - 25),
    };
    if bits >> 15 == 1 {
        -magnitude
    } else {
        magnitude
    }
}

/// Where the values of one slot of a [`super::collector::Row`] lie: the first at `start`, the next
/// ones `stride` bytes apart. Serves records (one stride for all) and whole columns (stride of one
/// number) alike.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    pub(super) slot: usize,
    pub(super) scalar: Scalar,
    pub(super) order: ByteOrder,
    pub(super) start: usize,
    pub(super) stride: usize,
}

/// Reads `count` rows whose values lie in `bytes` as the fields say.
///
/// # Errors
/// Bytes that end too early: the caller checks first that they do not, so that `count` is worth its
/// memory.
pub(super) fn collect(
    bytes: &[u8],
    fields: &[Field],
    count: usize,
    collector: &mut Collector<'_>,
) -> Result<(), Error> {
    collector.reserve(count)?;
    for i in 0..count {
        let mut row = [0.0; 7];
        for field in fields {
            let value = bytes
                .get(field.start + i * field.stride..)
                .and_then(|bytes| field.scalar.read(field.order, bytes));
            row[field.slot] = value.ok_or_else(|| Error::Truncated {
                what: format!("record {}", i + 1),
                declared: count as u64,
                found: i as u64,
            })?;
        }
        collector.push(&row, i + 1)?;
    }
    Ok(())
}

/// Checks that `count` records of `size` bytes lie in what is left of a file.
pub(in crate::reconstruction) fn enough(
    what: &str,
    count: usize,
    size: usize,
    left: usize,
) -> Result<(), Error> {
    if count.checked_mul(size).is_some_and(|needed| needed <= left) {
        return Ok(());
    }
    Err(Error::Truncated {
        what: what.to_owned(),
        declared: count as u64,
        found: (left / size.max(1)) as u64,
    })
}

#[cfg(test)]
mod tests {
    use super::{ByteOrder, Scalar};

    #[test]
    fn halves_are_read_exactly() {
        for (bits, value) in [
            (0x0000_u16, 0.0),
            (0x0001, 2f64.powi(-24)),
            (0x0400, 2f64.powi(-14)),
            (0x3c00, 1.0),
            (0xc580, -5.5),
            (0x7bff, 65504.0),
            (0xfc00, f64::NEG_INFINITY),
        ] {
            let read = Scalar::F16.read(ByteOrder::Little, &bits.to_le_bytes());
            assert_eq!(
                read.map(f64::to_bits),
                Some(f64::to_bits(value)),
                "{bits:04x}"
            );
        }
        let nan = Scalar::F16.read(ByteOrder::Big, &[0x7e, 0]);
        assert!(nan.is_some_and(f64::is_nan));
    }
}
