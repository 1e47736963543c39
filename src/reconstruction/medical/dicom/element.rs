//! Elements of a data set, and their values by type.

use crate::reconstruction::cloud::text::parse;

/// A value as it lies in the bytes.
#[derive(Debug)]
pub(super) enum Value<'a> {
    /// Of an element without parts.
    Bytes(&'a [u8]),
    /// The items of a sequence.
    Items(Vec<DataSet<'a>>),
    /// Packed pixels.
    Fragments(Vec<&'a [u8]>),
}

/// Elements in the order of the file.
#[derive(Debug, Default)]
pub(super) struct DataSet<'a>(pub(super) Vec<(u32, Value<'a>)>);

impl<'a> DataSet<'a> {
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    pub(super) fn get(&self, tag: u32) -> Option<&Value<'a>> {
        let found = self.0.iter().find(|(found, _)| *found == tag);
        found.map(|(_, value)| value)
    }

    /// The bytes of an element; none of one that is not there.
    pub(super) fn bytes(&self, tag: u32) -> &'a [u8] {
        match self.get(tag) {
            Some(Value::Bytes(bytes)) => bytes,
            _ => &[],
        }
    }

    /// The items of a sequence; none of one that is not there.
    pub(super) fn items(&self, tag: u32) -> &[Self] {
        match self.get(tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }

    /// The first item of a sequence.
    pub(super) fn item(&self, tag: u32) -> Option<&Self> {
        self.items(tag).first()
    }

    /// A short text without its padding.
    pub(super) fn text(&self, tag: u32) -> String {
        let bytes = self.bytes(tag);
        let text = bytes.iter().take(256).map(|&b| char::from(b));
        let text: String = text
            .filter(|c| c.is_ascii() && !c.is_ascii_control())
            .collect();
        text.trim().to_owned()
    }

    /// A number of 16 bits.
    pub(super) fn short(&self, tag: u32) -> Option<u16> {
        let bytes = self.bytes(tag).first_chunk()?;
        Some(u16::from_le_bytes(*bytes))
    }

    /// Numbers of 16 bits.
    pub(super) fn shorts(&self, tag: u32) -> Vec<u16> {
        let pairs = self.bytes(tag).chunks_exact(2);
        pairs
            .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
            .collect()
    }

    /// Numbers in text; what is no number is not finite.
    pub(super) fn numbers(&self, tag: u32) -> Vec<f64> {
        let bytes = self.bytes(tag);
        if bytes.is_empty() {
            return Vec::new();
        }
        let words = bytes.split(|&b| b == b'\\');
        let number = |word: &[u8]| {
            let word = word.strip_suffix(b"\0").unwrap_or(word);
            parse(word.trim_ascii()).unwrap_or(f64::NAN)
        };
        words.map(number).collect()
    }

    /// Exactly `N` finite numbers in text.
    pub(super) fn vector<const N: usize>(&self, tag: u32) -> Option<[f64; N]> {
        let numbers = <[f64; N]>::try_from(self.numbers(tag)).ok()?;
        numbers.iter().all(|v| v.is_finite()).then_some(numbers)
    }

    /// A whole number in text.
    pub(super) fn integer(&self, tag: u32) -> Option<i64> {
        self.text(tag).parse().ok()
    }
}
