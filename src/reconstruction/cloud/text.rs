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

    /// The token as a number, as [`parse`] takes it.
    pub(in crate::reconstruction) fn number(self, token: &[u8]) -> Result<f64, Error> {
        parse(token).ok_or_else(|| {
            let comma = if has_decimal_comma(token) {
                "; write decimal points, not decimal commas"
            } else {
                ""
            };
            let found = excerpt(token);
            self.error(format!("expected a number, found \"{found}\"{comma}"))
        })
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

    /// The text of a comment line (`#`, `//`, `%` or `!`); `None` for other lines.
    pub(in crate::reconstruction) fn comment(self) -> Option<&'a [u8]> {
        let text = self.bytes.trim_ascii_start();
        let marks: [&[u8]; 4] = [b"#", b"//", b"%", b"!"];
        marks.iter().find_map(|mark| text.strip_prefix(*mark))
    }

    /// Whether it holds nothing besides a comment.
    pub(in crate::reconstruction) fn is_blank(self) -> bool {
        self.bytes.trim_ascii().is_empty() || self.comment().is_some()
    }
}

/// The lines of a text, whichever way they end (`\n`, `\r\n`, `\r`).
#[derive(Debug, Clone)]
pub(in crate::reconstruction) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
    /// Whether a backslash at the end of a line joins the next one to it.
    joined: bool,
    /// Whether tabs around a line are kept.
    tabs: bool,
}

impl<'a> Lines<'a> {
    /// The lines of `text`; `before` lines stood above it.
    pub(in crate::reconstruction) fn new(text: &'a [u8], before: usize) -> Self {
        Self {
            rest: text,
            number: before,
            joined: false,
            tabs: false,
        }
    }

    /// The same lines with the tabs around them: between tabs, nothing is an empty cell.
    pub(in crate::reconstruction) fn with_tabs(self) -> Self {
        Self { tabs: true, ..self }
    }

    /// The same lines, where one that ends in a backslash goes on in the next, as in OBJ; comments
    /// do not. Such a line bears the number of its first.
    pub(in crate::reconstruction) fn joined(self) -> Self {
        Self {
            joined: true,
            ..self
        }
    }

    /// Only lines that hold something besides a comment.
    pub(in crate::reconstruction) fn content(self) -> impl Iterator<Item = Line<'a>> + Clone {
        self.filter(|line| !line.is_blank())
    }

    /// Bytes that are left.
    pub(in crate::reconstruction) fn left(&self) -> usize {
        self.rest.len()
    }

    /// Takes one line off, with whatever blanks it has.
    fn take_line(&mut self) -> &'a [u8] {
        let is_end = |&b: &u8| b == b'\n' || b == b'\r';
        let end = self.rest.iter().position(is_end).unwrap_or(self.rest.len());
        let bytes = &self.rest[..end];
        let skip = 1 + usize::from(self.rest[end..].starts_with(b"\r\n"));
        self.rest = self.rest.get(end + skip..).unwrap_or_default();
        self.number += 1;
        bytes
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Line<'a>;

    fn next(&mut self) -> Option<Line<'a>> {
        if self.rest.is_empty() {
            return None;
        }
        let (start, number) = (self.rest, self.number + 1);
        let mut last = self.take_line();
        let joined = self.joined && !last.trim_ascii_start().starts_with(b"#");
        while joined && last.ends_with(b"\\") && !self.rest.is_empty() {
            last = self.take_line();
        }
        // All that was taken, without the end of the last line.
        let length = last.as_ptr().addr() + last.len() - start.as_ptr().addr();
        let bytes = if self.tabs {
            trim_blanks(&start[..length])
        } else {
            start[..length].trim_ascii()
        };
        Some(Line { number, bytes })
    }
}

/// The tokens of a line.
#[derive(Debug, Clone)]
pub(in crate::reconstruction) struct Tokens<'a> {
    rest: &'a [u8],
}

impl<'a> Tokens<'a> {
    /// What is left, after blanks and the backslashes between joined lines.
    fn unjoined(&self) -> &'a [u8] {
        let mut text = self.rest.trim_ascii_start();
        while let [b'\\', b'\n' | b'\r', after @ ..] = text {
            text = after.trim_ascii_start();
        }
        text
    }
}

impl<'a> Iterator for Tokens<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let text = self.unjoined();
        if text.is_empty() || text[0] == b'#' {
            self.rest = &[];
            return None;
        }
        let is_end = |i: &usize| {
            let joins = text[*i] == b'\\' && matches!(text.get(i + 1), Some(b'\n' | b'\r'));
            joins || text[*i].is_ascii_whitespace() || is_separator(text[*i])
        };
        let end = (0..text.len()).find(is_end).unwrap_or(text.len());
        let after = text[end..].trim_ascii_start();
        self.rest = match after.first() {
            Some(&b) if is_separator(b) => &after[1..],
            _ => after,
        };
        Some(&text[..end])
    }
}

/// The text without blanks around it; tabs stay.
fn trim_blanks(mut text: &[u8]) -> &[u8] {
    while let [b' ', rest @ ..] | [rest @ .., b' '] = text {
        text = rest;
    }
    text
}

fn is_separator(byte: u8) -> bool {
    byte == b',' || byte == b';'
}

/// The number that a token spells: decimal or scientific, `nan` and `inf` included; also with a
/// typographic minus sign, with the exponent of Fortran (`1.5D+00`), and as the C library of
/// Windows writes what is no number (`1.#QNAN`, `-nan(ind)`).
pub(in crate::reconstruction) fn parse(token: &[u8]) -> Option<f64> {
    let text = std::str::from_utf8(token).ok()?;
    text.parse().ok().or_else(|| parse_unusual(text))
}

/// Longest spelling of a number that [`parse_unusual`] looks at.
const LONGEST_UNUSUAL: usize = 40;

fn parse_unusual(text: &str) -> Option<f64> {
    if text.len() > LONGEST_UNUSUAL {
        return None;
    }
    let unsigned = text.strip_prefix(['-', '+']).unwrap_or(text);
    let starts = |mark: &str| {
        let start = unsigned.get(..mark.len());
        start.is_some_and(|start| start.eq_ignore_ascii_case(mark))
    };
    if starts("nan(") || starts("1.#") {
        return Some(f64::NAN);
    }
    if let Some(magnitude) = text.strip_prefix(['\u{2212}', '\u{2013}']) {
        let value: f64 = magnitude.parse().ok()?;
        return Some(-value);
    }
    let is_fortran = |c: char| c.is_ascii_digit() || "+-.dD".contains(c);
    if text.chars().all(is_fortran) {
        return text.replace(['d', 'D'], "e").parse().ok();
    }
    None
}

/// Whether a token is a number with a decimal comma.
pub(in crate::reconstruction) fn has_decimal_comma(token: &[u8]) -> bool {
    let mut parts = token.split(|&b| b == b',');
    let (whole, decimals) = (parts.next(), parts.next());
    let digits = |text: &[u8]| !text.is_empty() && text.iter().all(u8::is_ascii_digit);
    let whole = whole.map(|text| text.strip_prefix(b"-").unwrap_or(text));
    let decimals = decimals.map(|text| text.split(|&b| b.eq_ignore_ascii_case(&b'e')).next());
    whole.is_some_and(digits) && decimals.flatten().is_some_and(digits) && parts.next().is_none()
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
    fn a_backslash_joins_lines_but_no_comments() {
        let lines: Vec<_> = Lines::new(b"v 1\\\n2 \\\r\n 3\n# C:\\\nv 4\n", 0)
            .joined()
            .map(|line| (line.number, line.tokens().collect::<Vec<_>>()))
            .collect();
        let expected: [(usize, Vec<&[u8]>); 3] = [
            (1, vec![b"v", b"1", b"2", b"3"]),
            (4, vec![]),
            (5, vec![b"v", b"4"]),
        ];
        assert_eq!(lines, expected);
    }

    #[test]
    fn numbers_may_be_spelled_in_unusual_ways() {
        for (text, number) in [
            ("1.5D+01", 15.0_f64),
            ("-2d0", -2.0),
            ("\u{2212}0.25", -0.25),
            ("\u{2013}3", -3.0),
            ("+.5", 0.5),
        ] {
            assert_eq!(
                parse(text.as_bytes()).map(f64::to_bits),
                Some(number.to_bits()),
                "{text}"
            );
        }
        for text in ["1.#QNAN", "-1.#IND00", "nan(ind)", "-nan"] {
            assert!(parse(text.as_bytes()).is_some_and(f64::is_nan), "{text}");
        }
        for text in ["", "D", "1,5", "x1", "0x10", "--1", "\u{2212}"] {
            assert_eq!(parse(text.as_bytes()), None, "{text}");
        }
    }

    #[test]
    fn decimal_commas_are_known() {
        for (text, is) in [
            ("1,5", true),
            ("-12,25e3", true),
            ("1,2,3", false),
            ("1.5", false),
            (",5", false),
        ] {
            assert_eq!(has_decimal_comma(text.as_bytes()), is, "{text}");
        }
    }

    #[test]
    fn excerpts_are_short_and_printable() {
        assert_eq!(excerpt(b"a\x1b[31m\xff"), "a?[31m?");
        assert_eq!(excerpt(&[b'x'; 1000]).len(), 43);
    }
}
