//! The data behind the header, record by record.

use super::element::{Element, Kind, Property};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar};
use crate::reconstruction::cloud::text::{Line, Lines, Tokens};

/// What has not been read yet.
pub(in crate::reconstruction) enum Body<'a> {
    Text(Text<'a>),
    Binary(Binary<'a>),
}

/// Text: one line a record, blank lines aside.
pub(in crate::reconstruction) struct Text<'a> {
    lines: Lines<'a>,
    line: Line<'a>,
    tokens: Tokens<'a>,
}

/// Numbers without anything between them.
pub(in crate::reconstruction) struct Binary<'a> {
    pub(super) rest: &'a [u8],
    pub(super) order: ByteOrder,
}

impl<'a> Text<'a> {
    /// The text behind `before` lines of header.
    pub(super) fn new(text: &'a [u8], before: usize) -> Self {
        let line = Line {
            number: before,
            bytes: b"",
        };
        Self {
            lines: Lines::new(text, before),
            line,
            tokens: line.tokens(),
        }
    }

    /// The records that follow, without the comments that some programs put between them.
    pub(super) fn records(&mut self) -> impl Iterator<Item = Line<'a>> {
        let is_comment = |line: &Line<'_>| {
            let word = line.bytes.split(u8::is_ascii_whitespace).next();
            matches!(word, Some(b"comment" | b"obj_info"))
        };
        let lines = self.lines.by_ref();
        lines.filter(move |line| !line.bytes.is_empty() && !is_comment(line))
    }

    fn value(&mut self) -> Result<f64, Error> {
        let token = self.tokens.next();
        self.line
            .number(token.ok_or_else(|| self.line.error("expected more values"))?)
    }
}

impl<'a> Binary<'a> {
    /// The bytes of all records of an element whose records have `size` bytes.
    pub(super) fn records(&mut self, element: &Element, size: usize) -> Result<&'a [u8], Error> {
        let left = self.rest.len() / size.max(1);
        if left < element.count {
            return Err(element.truncated(left));
        }
        let (records, rest) = self.rest.split_at(element.count * size);
        self.rest = rest;
        Ok(records)
    }

    fn value(&mut self, scalar: Scalar) -> Option<f64> {
        let value = scalar.read(self.order, self.rest)?;
        self.rest = &self.rest[scalar.size()..];
        Some(value)
    }
}

impl Body<'_> {
    /// Reads record `i` of `element`: gives `take` each value with the index of its property, all
    /// items of a list with the same. Returns the line of the record, in binary data its number.
    pub(in crate::reconstruction) fn record(
        &mut self,
        element: &Element,
        i: usize,
        mut take: impl FnMut(usize, f64),
    ) -> Result<usize, Error> {
        let mut line = i + 1;
        if let Self::Text(text) = self {
            let next = text.records().next();
            text.line = next.ok_or_else(|| element.truncated(i))?;
            text.tokens = text.line.tokens();
            line = text.line.number;
        }
        let mut value = |scalar| match self {
            Self::Text(text) => text.value(),
            Self::Binary(binary) => binary.value(scalar).ok_or_else(|| element.truncated(i)),
        };
        for (column, Property { kind, .. }) in element.properties.iter().enumerate() {
            match *kind {
                Kind::Scalar(scalar) => take(column, value(scalar)?),
                // A length beyond the file is found out by the items that are not there.
                Kind::List(length, item) => {
                    for _ in 0..list_length(value(length)?, line)? {
                        take(column, value(item)?);
                    }
                }
            }
        }
        Ok(line)
    }

    /// Passes over the records of `element`.
    pub(in crate::reconstruction) fn skip(&mut self, element: &Element) -> Result<(), Error> {
        match (self, element.record_bytes()) {
            (Self::Text(text), _) => {
                let found = text.records().take(element.count).count();
                if found < element.count {
                    return Err(element.truncated(found));
                }
            }
            (Self::Binary(binary), Some(size)) => {
                binary.records(element, size)?;
            }
            (body, None) => {
                for i in 0..element.count {
                    body.record(element, i, |_, _| ())?;
                }
            }
        }
        Ok(())
    }
}

fn list_length(value: f64, line: usize) -> Result<u64, Error> {
    if value >= 0.0 && value.fract() <= 0.0 {
        return Ok(value as u64);
    }
    let detail = format!("{value} is not the length of a list");
    Err(Error::Row { line, detail })
}
