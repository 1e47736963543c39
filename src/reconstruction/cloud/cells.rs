//! The cells of a row of a table, parted in one of the ways that are in use.

use super::text::{Line, Tokens, parse};

/// What parts the cells of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Separator {
    /// Blanks, commas and semicolons, mixed at will: the data of formats with a header of their own.
    Any,
    /// Blanks and tabs, any number of them.
    Blanks,
    /// One byte; nothing between two of them is an empty cell.
    Byte(u8),
}

impl Separator {
    /// The ways that tables are written in; of two that fit a file alike the first is taken.
    pub(super) const OF_TABLES: [Self; 5] = [
        Self::Byte(b','),
        Self::Byte(b';'),
        Self::Byte(b'\t'),
        Self::Byte(b'|'),
        Self::Blanks,
    ];
}

/// What a cell is, as far as its spelling tells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cell {
    /// A number, finite or not.
    Number(f64),
    /// Nothing, or a word that stands for nothing.
    Missing,
    /// Anything else.
    Text,
}

impl Cell {
    /// What `cell` is.
    pub(super) fn of(cell: &[u8]) -> Self {
        match parse(cell) {
            Some(value) => Self::Number(value),
            None if is_missing(cell) => Self::Missing,
            None => Self::Text,
        }
    }
}

/// Whether a cell says that there is no value.
pub(super) fn is_missing(cell: &[u8]) -> bool {
    const WORDS: [&str; 12] = [
        "", "na", "n/a", "#n/a", "none", "null", "nil", "nodata", "-", "--", "?", "*",
    ];
    let is_word = |word: &&str| cell.eq_ignore_ascii_case(word.as_bytes());
    WORDS.iter().any(is_word)
}

/// The cells of a line, without quotes and blanks around them, up to a comment.
#[derive(Debug, Clone)]
pub(super) enum Cells<'a> {
    /// Parted by anything.
    Any(Tokens<'a>),
    /// Parted by blanks.
    Blanks(&'a [u8]),
    /// Parted by one byte; `None` behind the last cell.
    Byte(Option<&'a [u8]>, u8),
}

impl<'a> Cells<'a> {
    /// The cells of `line`.
    pub(super) fn of(line: Line<'a>, separator: Separator) -> Self {
        match separator {
            Separator::Any => Self::Any(line.tokens()),
            Separator::Blanks => Self::Blanks(line.bytes),
            Separator::Byte(byte) => Self::Byte(Some(line.bytes), byte),
        }
    }
}

impl<'a> Iterator for Cells<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        match self {
            Self::Any(tokens) => tokens.next(),
            Self::Blanks(rest) => {
                let text = rest.trim_ascii_start();
                if text.is_empty() || text[0] == b'#' {
                    *rest = b"";
                    return None;
                }
                let (cell, after) = quoted(text).unwrap_or_else(|| {
                    let end = text.iter().position(u8::is_ascii_whitespace);
                    text.split_at(end.unwrap_or(text.len()))
                });
                *rest = after;
                Some(cell)
            }
            Self::Byte(rest, separator) => {
                let text = (*rest)?;
                let start = text.iter().position(|&b| b != b' ').unwrap_or(text.len());
                if start > 0 && text[start..].starts_with(b"#") {
                    *rest = None;
                    return None;
                }
                let text = &text[start..];
                let (cell, after) = quoted(text).unwrap_or((b"", text));
                let ends = |i: &usize| after[*i] == *separator || after[*i..].starts_with(b" #");
                let end = (0..after.len()).find(ends).unwrap_or(after.len());
                *rest = after[end..].strip_prefix(&[*separator]);
                let unquoted = after[..end].trim_ascii();
                Some(if cell.is_empty() { unquoted } else { cell })
            }
        }
    }
}

/// The inside of the quotes that a text begins with, and what follows them.
fn quoted(text: &[u8]) -> Option<(&[u8], &[u8])> {
    let (quote @ (b'"' | b'\''), inside) = text.split_first()? else {
        return None;
    };
    let end = inside.iter().position(|b| b == quote)?;
    Some((inside[..end].trim_ascii(), &inside[end + 1..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cells(line: &str, separator: Separator) -> Vec<&str> {
        let line = Line {
            number: 1,
            bytes: line.as_bytes(),
        };
        let text = |cell| std::str::from_utf8(cell).unwrap();
        Cells::of(line, separator).map(text).collect()
    }

    #[test]
    fn cells_may_be_empty_quoted_and_followed_by_a_comment() {
        let comma = Separator::Byte(b',');
        assert_eq!(cells("1, 2 ,,3,", comma), ["1", "2", "", "3", ""]);
        assert_eq!(cells("\"a, b\",'2', \"3\" # c", comma), ["a, b", "2", "3"]);
        assert_eq!(cells("1,#N/A,3 #4", comma), ["1", "#N/A", "3"]);
        assert_eq!(
            cells("\t1\t\t3", Separator::Byte(b'\t')),
            ["", "1", "", "3"]
        );
        assert_eq!(
            cells(" 1\t 2 \"a b\" # c", Separator::Blanks),
            ["1", "2", "a b"]
        );
        assert_eq!(cells("\"open,1", comma), ["\"open", "1"]);
    }

    #[test]
    fn words_for_nothing_are_missing() {
        assert_eq!(Cell::of(b"-"), Cell::Missing);
        assert_eq!(Cell::of(b"NULL"), Cell::Missing);
        assert_eq!(Cell::of(b"-1"), Cell::Number(-1.0));
        assert_eq!(Cell::of(b"P1"), Cell::Text);
    }
}
