//! Data sets from bytes: lengths are held against what is there, nesting against a depth.

use std::ops::Range;

use super::element::{DataSet, Value};
use super::syntax::Syntax;
use super::tags;
use crate::reconstruction::cloud::Error;

/// Deepest nesting of sequences.
const DEEPEST: usize = 16;

/// Length of a value that ends with a mark of its own.
const UNDEFINED: u32 = u32::MAX;

/// Types with a length of 16 bits; all others have one of 32.
const SHORT: &[&[u8; 2]] = &[
    b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FD", b"FL", b"IS", b"LO", b"LT", b"PN",
    b"SH", b"SL", b"SS", b"ST", b"TM", b"UI", b"UL", b"US",
];

const LONG: &[&[u8; 2]] = &[
    b"OB", b"OD", b"OF", b"OL", b"OV", b"OW", b"SQ", b"SV", b"UC", b"UN", b"UR", b"UT", b"UV",
];

/// Whether the first element has a type behind its tag.
pub(super) fn starts_explicit(bytes: &[u8]) -> bool {
    let kind = bytes
        .get(4..6)
        .and_then(|kind| <&[u8; 2]>::try_from(kind).ok());
    kind.is_some_and(|kind| SHORT.contains(&kind) || LONG.contains(&kind))
}

/// Whether bytes begin as a data set without a mark does: with an early element of group 2 or 8.
pub(super) fn starts_as_data_set(bytes: &[u8]) -> bool {
    let Some(&[group, 0, element, high, ..]) = bytes.first_chunk::<8>() else {
        return false;
    };
    let early = match group {
        2 => high == 0 && element <= 0x10,
        8 => high == 0 && element <= 0x60,
        _ => false,
    };
    let length = bytes.get(4..8).and_then(|length| length.first_chunk());
    let length = length.map_or(u32::MAX, |length| u32::from_le_bytes(*length));
    let fits = length.is_multiple_of(2) && length as usize <= bytes.len().min(1 << 10);
    early && (starts_explicit(bytes) || (group == 8 && fits))
}

/// A value without parts, or bytes that no element claims.
#[derive(Debug)]
pub(super) struct Leaf<'p> {
    /// Tags of the sequences that it is in, the outermost first.
    pub(super) path: &'p [u32],
    /// None of what no element claims.
    pub(super) tag: Option<u32>,
    /// Its type, where one is told.
    pub(super) kind: Option<[u8; 2]>,
    /// Where it lies.
    pub(super) range: Range<usize>,
}

/// The elements of one group at the beginning, which are explicit, and the bytes behind them.
///
/// # Errors
/// [`Error::Truncated`], [`Error::Header`].
pub(super) fn group(bytes: &[u8], group: u16) -> Result<(DataSet<'_>, &[u8]), Error> {
    let mut ignore = |_: Leaf<'_>| {};
    let mut parser = Parser::new(bytes, true, &mut ignore);
    let mut elements = Vec::new();
    while parser
        .left()
        .first_chunk()
        .map(|group| u16::from_le_bytes(*group))
        == Some(group)
    {
        let tag = parser.tag()?;
        elements.push((tag, parser.value(tag, 0)?));
    }
    Ok((DataSet(elements), parser.left()))
}

/// The whole data set.
///
/// # Errors
/// [`Error::Truncated`], [`Error::Header`].
pub(super) fn data_set(bytes: &[u8], syntax: Syntax) -> Result<DataSet<'_>, Error> {
    let mut ignore = |_: Leaf<'_>| {};
    let mut parser = Parser::new(bytes, syntax.is_explicit(), &mut ignore);
    parser.elements(bytes.len(), 0)
}

/// Shows `see` all leaves of a data set, but for packed pixels.
///
/// # Errors
/// As [`data_set`].
pub(super) fn leaves(
    bytes: &[u8],
    explicit: bool,
    see: &mut dyn FnMut(Leaf<'_>),
) -> Result<(), Error> {
    let mut parser = Parser::new(bytes, explicit, see);
    parser.elements(bytes.len(), 0)?;
    parser.unclaimed(bytes.len());
    Ok(())
}

/// The same of the items of a sequence in an implicit data set, which does not tell that it is one.
///
/// # Errors
/// As [`data_set`].
pub(super) fn leaves_of_items(
    bytes: &[u8],
    path: &[u32],
    see: &mut dyn FnMut(Leaf<'_>),
) -> Result<(), Error> {
    let mut parser = Parser::new(bytes, false, see);
    parser.path.extend(path);
    parser.items(bytes.len(), false, path.len()).map(drop)
}

struct Parser<'a, 's> {
    bytes: &'a [u8],
    at: usize,
    explicit: bool,
    /// Tags of the sequences around.
    path: Vec<u32>,
    see: &'s mut dyn FnMut(Leaf<'_>),
}

impl<'a, 's> Parser<'a, 's> {
    fn new(bytes: &'a [u8], explicit: bool, see: &'s mut dyn FnMut(Leaf<'_>)) -> Self {
        Self {
            bytes,
            at: 0,
            explicit,
            path: Vec::new(),
            see,
        }
    }

    fn saw(&mut self, tag: Option<u32>, kind: Option<[u8; 2]>, range: Range<usize>) {
        (self.see)(Leaf {
            path: &self.path,
            tag,
            kind,
            range,
        });
    }

    /// Moves on to byte `end`, over what no element claims.
    fn unclaimed(&mut self, end: usize) {
        if self.at < end {
            self.saw(None, None, self.at..end);
        }
        self.at = end;
    }

    fn left(&self) -> &'a [u8] {
        &self.bytes[self.at..]
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], Error> {
        let left = self.left();
        let taken = left.get(..length).ok_or_else(|| Error::Truncated {
            what: format!("the element at byte {}", self.at),
            declared: length as u64,
            found: left.len() as u64,
        })?;
        self.at += length;
        Ok(taken)
    }

    fn word(&mut self) -> Result<u16, Error> {
        let bytes = self.take(2)?;
        Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    fn long(&mut self) -> Result<u32, Error> {
        let bytes = self.take(4)?;
        Ok(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    fn tag(&mut self) -> Result<u32, Error> {
        let group = u32::from(self.word()?);
        Ok(group << 16 | u32::from(self.word()?))
    }

    /// Elements up to byte `end`, or up to the end of an item.
    fn elements(&mut self, end: usize, depth: usize) -> Result<DataSet<'a>, Error> {
        if depth > DEEPEST {
            return Err(self.fault(&format!("sequences are nested more than {DEEPEST} deep")));
        }
        let mut elements = Vec::new();
        // What is left over at the end of a file is padding.
        while self.at + 8 <= end {
            let tag = self.tag()?;
            if tag == tags::ITEM_END {
                self.long()?;
                break;
            }
            elements.push((tag, self.value(tag, depth)?));
        }
        if depth > 0 && self.at > end {
            return Err(self.fault("an element is longer than its item"));
        }
        Ok(DataSet(elements))
    }

    fn value(&mut self, tag: u32, depth: usize) -> Result<Value<'a>, Error> {
        let (length, kind) = self.length(tag)?;
        if length == UNDEFINED {
            return if tag == tags::PIXEL_DATA {
                self.fragments()
            } else {
                // What a writer did not know lies there without types.
                let explicit = self.explicit && kind != Some(*b"UN");
                let explicit = std::mem::replace(&mut self.explicit, explicit);
                self.path.push(tag);
                let items = self.items(self.bytes.len(), true, depth);
                self.path.pop();
                self.explicit = explicit;
                items
            };
        }
        let length = length as usize;
        let is_sequence = match kind {
            Some(kind) => kind == *b"SQ",
            None => tags::SEQUENCES.contains(&tag),
        };
        let start = self.at;
        let value = self.take(length)?;
        if !is_sequence {
            self.saw(Some(tag), kind, start..self.at);
            return Ok(Value::Bytes(value));
        }
        self.at = start;
        self.path.push(tag);
        let items = self.items(start + length, false, depth);
        self.path.pop();
        items
    }

    /// Length of a value, and its type where one is told.
    fn length(&mut self, tag: u32) -> Result<(u32, Option<[u8; 2]>), Error> {
        if !self.explicit || tag >> 16 == 0xfffe {
            return Ok((self.long()?, None));
        }
        let kind = self.take(2)?;
        let kind = [kind[0], kind[1]];
        if SHORT.contains(&&kind) {
            return Ok((self.word()?.into(), Some(kind)));
        }
        if !kind.iter().all(u8::is_ascii_uppercase) {
            return Err(self.fault(&format!("{tag:08x} has no type")));
        }
        self.word()?;
        Ok((self.long()?, Some(kind)))
    }

    /// The items of a sequence up to byte `end`, or to the mark that ends it.
    fn items(&mut self, end: usize, marked: bool, depth: usize) -> Result<Value<'a>, Error> {
        let mut items = Vec::new();
        while self.at + 8 <= end {
            let tag = self.tag()?;
            let length = self.long()?;
            match tag {
                tags::SEQUENCE_END if marked => return Ok(Value::Items(items)),
                tags::ITEM if length == UNDEFINED => items.push(self.elements(end, depth + 1)?),
                tags::ITEM => {
                    let item_end = self.at.saturating_add(length as usize);
                    if item_end > end {
                        return Err(Error::Truncated {
                            what: format!("the item at byte {}", self.at),
                            declared: length.into(),
                            found: (end - self.at) as u64,
                        });
                    }
                    items.push(self.elements(item_end, depth + 1)?);
                    self.unclaimed(item_end);
                }
                _ => return Err(self.fault(&format!("{tag:08x} stands where an item should"))),
            }
        }
        if marked {
            return Err(self.fault("a sequence has no end"));
        }
        self.unclaimed(end);
        Ok(Value::Items(items))
    }

    /// Packed pixels: the first fragment, a table of offsets, is left out.
    fn fragments(&mut self) -> Result<Value<'a>, Error> {
        let mut fragments = Vec::new();
        loop {
            let tag = self.tag()?;
            let length = self.long()?;
            match tag {
                tags::ITEM => fragments.push(self.take(length as usize)?),
                tags::SEQUENCE_END => break,
                _ => return Err(self.fault(&format!("{tag:08x} stands where pixels should"))),
            }
        }
        if !fragments.is_empty() {
            fragments.remove(0);
        }
        Ok(Value::Fragments(fragments))
    }

    fn fault(&self, detail: &str) -> Error {
        Error::Header {
            line: 0,
            detail: format!("at byte {}: {detail}", self.at),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nesting_is_limited() {
        let mut bytes = Vec::new();
        for _ in 0..1000 {
            bytes.extend([0x62, 0, 2, 0, 0xff, 0xff, 0xff, 0xff]);
            bytes.extend([0xfe, 0xff, 0, 0xe0, 0xff, 0xff, 0xff, 0xff]);
        }
        let error = data_set(&bytes, Syntax::Implicit).unwrap_err();
        assert!(error.to_string().contains("16 deep"), "{error}");
    }

    #[test]
    fn lengths_are_held_against_the_bytes() {
        let bytes = [8, 0, 0x16, 0, 0xf0, 0xff, 0xff, 0x7f, b'1', b'2'];
        assert!(matches!(
            data_set(&bytes, Syntax::Implicit),
            Err(Error::Truncated { .. })
        ));
    }
}
