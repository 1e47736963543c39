//! Lines, tokens and numbers of text files, read in place: nothing is allocated for a line.

use super::Error;
use crate::reconstruction::vector::Vec3;

/// A line of a file without its end and without blanks around it.
#[derive(Debug, Clone, Copy)]
pub(in crate::reconstruction) struct Line<'a> {
    /// Number in the file, from 1.
    pub(in crate::reconstruction) number: usize,
    /// Its bytes, of any encoding.
    pub(in crate::reconstruction) bytes: &'a [u8],
}

impl<'a> Line<'a> {
    /// Values between blanks, commas and semicolons, up to a comment that starts with `#`.
    ///
    /// Two commas in a row enclose an empty token, so that a missing value shifts no other; a
    /// separator at the end of the line is ignored.
    pub(in crate::reconstruction) fn tokens(self) -> Tokens<'a> {
        Tokens { rest: self.bytes }
    }

    /// The token as a number: decimal or scientific, `nan` and `inf` included.
    pub(in crate::reconstruction) fn number(self, token: &[u8]) -> Result<f64, Error> {
        parse(token)
            .ok_or_else(|| self.error(format!("expected a number, found \"{}\"", excerpt(token))))
    }

    /// The next three of its tokens as numbers.
    pub(in crate::reconstruction) fn vector(self, tokens: &mut Tokens<'_>) -> Result<Vec3, Error> {
        let mut vector = [0.0; 3];
        for value in &mut vector {
            let Some(token) = tokens.next() else {
                let found = excerpt(self.bytes);
                return Err(self.error(format!("expected three numbers in \"{found}\"")));
            };
            *value = self.number(token)?;
        }
        Ok(vector)
    }

    /// An error in this line.
    pub(in crate::reconstruction) fn error(self, detail: impl Into<String>) -> Error {
        Error::Row {
            line: self.number,
            detail: detail.into(),
        }
    }

    /// The text of a comment line (`#` or `//`); `None` for other lines.
    pub(in crate::reconstruction) fn comment(self) -> Option<&'a [u8]> {
        self.bytes
            .strip_prefix(b"#")
            .or_else(|| self.bytes.strip_prefix(b"//"))
    }
}

/// The lines of a text, whichever way they end (`\n`, `\r\n`, `\r`).
#[derive(Debug, Clone)]
pub(in crate::reconstruction) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
}

impl<'a> Lines<'a> {
    /// The lines of `text`; `before` lines stood above it.
    pub(in crate::reconstruction) fn new(text: &'a [u8], before: usize) -> Self {
        Self {
            rest: text,
            number: before,
        }
    }

    /// Only lines that hold something besides a comment.
    pub(in crate::reconstruction) fn content(self) -> impl Iterator<Item = Line<'a>> + Clone {
        self.filter(|line| !line.bytes.is_empty() && line.comment().is_none())
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let is_end = |&b: &u8| b == b'\n' || b == b'\r';
        let end = self.rest.iter().position(is_end).unwrap_or(self.rest.len());
        let bytes = self.rest[..end].trim_ascii();
        let skip = if self.rest[end..].starts_with(b"\r\n") {
            2
        } else {
            1
        };
        self.rest = self.rest.get(end + skip..).unwrap_or_default();
        self.number += 1;
        Some(Line {
            number: self.number,
            bytes,
        })
    }
}

/// The tokens of a line.
#[derive(Debug, Clone)]
pub(in crate::reconstruction) struct Tokens<'a> {
    rest: &'a [u8],
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let text = self.rest.trim_ascii_start();
        if text.is_empty() || text[0] == b'#' {
            self.rest = &[];
            return None;
        }
        let is_end = |&b: &u8| b.is_ascii_whitespace() || is_separator(b);
        let end = text.iter().position(is_end).unwrap_or(text.len());
        let after = text[end..].trim_ascii_start();
        self.rest = match after.first() {
            Some(&b) if is_separator(b) => &after[1..],
            _ => after,
        };
        Some(&text[..end])
    }
}

fn is_separator(byte: u8) -> bool {
    byte == b',' || byte == b';'
}

/// The number that a token spells.
pub(in crate::reconstruction) fn parse(token: &[u8]) -> Option<f64> {
    std::str::from_utf8(token).ok()?.parse().ok()
}

/// The start of something that a user wrote, fit for a message: short and printable.
pub(in crate::reconstruction) fn excerpt(bytes: &[u8]) -> String {
    const LONGEST: usize = 40;
    let printable = |&b: &u8| match b {
        b' '..=b'~' => char::from(b),
        _ => '?',
    };
    let mut text: String = bytes.iter().take(LONGEST).map(printable).collect();
    if bytes.len() > LONGEST {
        text.push_str("...");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tokens(line: &str) -> Vec<&str> {
        let line = Line {
            number: 1,
            bytes: line.as_bytes(),
        };
        let text = |token| std::str::from_utf8(token).unwrap();
        line.tokens().map(text).collect()
    }

    #[test]
    fn separators_may_be_blanks_commas_and_semicolons() {
        assert_eq!(tokens("1 2\t3"), ["1", "2", "3"]);
        assert_eq!(tokens("1, 2 ,3;"), ["1", "2", "3"]);
        assert_eq!(tokens("1,,3 # note"), ["1", "", "3"]);
        assert_eq!(tokens(",2"), ["", "2"]);
        assert_eq!(tokens(" # 1 2"), Vec::<&str>::new());
    }

    #[test]
    fn lines_end_in_any_way_and_keep_their_numbers() {
        let lines: Vec<_> = Lines::new(b"a\r\n\nb\rc\n\n# d\n e", 2)
            .content()
            .map(|line| (line.number, line.bytes))
            .collect();
        let expected: [(usize, &[u8]); 4] = [(3, b"a"), (5, b"b"), (6, b"c"), (9, b"e")];
        assert_eq!(lines, expected);
    }

    #[test]
    fn excerpts_are_short_and_printable() {
        assert_eq!(excerpt(b"a\x1b[31m\xff"), "a?[31m?");
        assert_eq!(excerpt(&[b'x'; 1000]).len(), 43);
    }
}
