//! Vertices of Geomview's object file format, with normals in its variant NOFF.

use super::collector::Collector;
use super::columns::Columns;
use super::text::{Line, Lines, excerpt};
use super::{Error, Limits};

/// Fewest bytes of a vertex: three digits and what parts them.
const SHORTEST_VERTEX: usize = 6;

/// What the keyword of the first line says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Keyword {
    /// Length of the word.
    length: usize,
    normals: bool,
    /// Points of R³, neither homogeneous nor of another dimension.
    three_dimensional: bool,
}

/// The keyword `[ST][C][N][4][n]OFF` that a word is or starts with.
pub(super) fn keyword(word: &[u8]) -> Option<Keyword> {
    let start = word.windows(3).position(|w| w == b"OFF")?;
    // Some files have the first count right behind the keyword.
    let is_end = word[start + 3..].iter().all(u8::is_ascii_digit);
    let prefix = &word[..start];
    let is_prefix = prefix.iter().all(|b| b"STCN4n".contains(b));
    (is_prefix && is_end).then_some(Keyword {
        length: start + 3,
        normals: prefix.contains(&b'N'),
        three_dimensional: !prefix.contains(&b'4') && !prefix.contains(&b'n'),
    })
}

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let mut lines = Lines::new(bytes, 0).content();
    let mut line = lines.next().ok_or(Error::Empty)?;
    // Some writers leave the keyword out; it is then taken as OFF.
    let keyword = keyword(line.tokens().next().unwrap_or_default());
    if let Some(keyword) = keyword {
        if !keyword.three_dimensional {
            return Err(header(
                line,
                "expected points in three dimensions (OFF, COFF, NOFF)",
            ));
        }
        line.bytes = line.bytes[keyword.length..].trim_ascii();
        if line.bytes.starts_with(b"BINARY") {
            return Err(header(
                line,
                "binary OFF is not supported; write it as text",
            ));
        }
        if line.tokens().next().is_none() {
            line = lines
                .next()
                .ok_or_else(|| header(line, "expected the number of vertices"))?;
        }
    }
    let declared = declared(line)?;
    let normals = keyword.is_some_and(|keyword| keyword.normals);
    let slots: &[usize] = if normals {
        &[0, 1, 2, 3, 4, 5]
    } else {
        &[0, 1, 2]
    };
    let mut collector = Columns::leading(slots, slots.len()).collector(limits);
    collector.reserve(declared.min(bytes.len() / SHORTEST_VERTEX + 1))?;
    let mut found = 0;
    for line in lines.take(declared) {
        // Colours and texture coordinates may follow, in any number.
        let mut row = [0.0; 7];
        let mut tokens = line.tokens();
        for &slot in slots {
            let Some(token) = tokens.next() else {
                let (count, text) = (slots.len(), excerpt(line.bytes));
                return Err(line.error(format!("expected {count} numbers in \"{text}\"")));
            };
            row[slot] = line.number(token)?;
        }
        collector.push(&row, line.number)?;
        found += 1;
    }
    if found < declared {
        return Err(Error::Truncated {
            what: "the list of vertices".to_owned(),
            declared: declared as u64,
            found: found as u64,
        });
    }
    Ok(collector)
}

/// The number of vertices, first in the line of counts.
fn declared(line: Line<'_>) -> Result<usize, Error> {
    let token = line.tokens().next().unwrap_or_default();
    let count = std::str::from_utf8(token)
        .ok()
        .and_then(|text| text.parse().ok());
    count.ok_or_else(|| header(line, "expected the number of vertices, faces and edges"))
}

fn header(line: Line<'_>, detail: &str) -> Error {
    Error::Header {
        line: line.number,
        detail: format!("{detail}, found \"{}\"", excerpt(line.bytes)),
    }
}
