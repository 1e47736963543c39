//! Decompression of LZF, the scheme of `PCD`'s compressed form (Lehmann's LibLZF).
//!
//! A control byte below 32 is followed by that many literal bytes and one more. Any other starts a
//! copy of 3 or more bytes (high 3 bits plus 2; 7 there adds the next byte) from up to 8192 bytes
//! back (low 5 bits and one more byte).

/// The `size` bytes that `packed` stands for; `None` if it stands for anything else.
pub(super) fn expand(packed: &[u8], size: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(size);
    let mut rest = packed;
    while let Some((&control, after)) = rest.split_first() {
        let control = usize::from(control);
        rest = after;
        if control < 32 {
            let (literal, after) = rest.split_at_checked(control + 1)?;
            out.extend_from_slice(literal);
            rest = after;
        } else {
            let mut length = (control >> 5) + 2;
            if length == 9 {
                length += take(&mut rest)?;
            }
            let back = ((control & 31) << 8) + take(&mut rest)? + 1;
            let start = out.len().checked_sub(back)?;
            // The copy may overlap what it writes, which repeats the last bytes.
            for i in start..start + length {
                out.push(out[i]);
            }
        }
        if out.len() > size {
            return None;
        }
    }
    (out.len() == size).then_some(out)
}

fn take(rest: &mut &[u8]) -> Option<usize> {
    let (&first, after) = rest.split_first()?;
    *rest = after;
    Some(usize::from(first))
}

#[cfg(test)]
mod tests {
    use super::expand;

    #[test]
    fn literals_copies_and_overlapping_copies() {
        // "abc", then 3 bytes from 3 back, then 9 + 1 bytes from 1 back.
        let packed = [2, b'a', b'b', b'c', 1 << 5, 2, 7 << 5, 1, 0];
        assert_eq!(expand(&packed, 16).unwrap(), b"abcabccccccccccc");
        assert_eq!(expand(&packed, 15), None);
        assert_eq!(expand(&packed, 17), None);
    }

    #[test]
    fn a_copy_from_before_the_start_is_damage() {
        assert_eq!(expand(&[0, b'a', 1 << 5, 1], 4), None);
        assert_eq!(expand(&[5, b'a'], 6), None);
        assert_eq!(expand(&[7 << 5], 9), None);
    }
}
