//! Vertices of Geomview's object file format, with normals in its variant NOFF.

use super::collector::Collector;
use super::text::{Line, Lines, excerpt};
use super::{Error, Limits};
use crate::reconstruction::vector::Vec3;

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

/// What stands before the vertices.
#[derive(Debug, Clone, Copy)]
pub(in crate::reconstruction) struct Header {
    pub(in crate::reconstruction) vertices: usize,
    pub(in crate::reconstruction) faces: usize,
    /// Whether a normal follows each point.
    pub(in crate::reconstruction) normals: bool,
}

impl Header {
    /// Reads the keyword and the line of counts, the first of `lines`.
    pub(in crate::reconstruction) fn read<'a>(
        mut lines: impl Iterator<Item = Line<'a>>,
    ) -> Result<Self, Error> {
        let mut line = lines.next().ok_or(Error::Empty)?;
        // Some writers leave the keyword out; it is then taken as OFF.
        let keyword = keyword(line.tokens().next().unwrap_or_default());
        if let Some(keyword) = keyword {
            if !keyword.three_dimensional {
                let detail = "expected points in three dimensions (OFF, COFF, NOFF)";
                return Err(header(line, detail));
            }
            line.bytes = line.bytes[keyword.length..].trim_ascii();
            if line.bytes.starts_with(b"BINARY") {
                let detail = "binary OFF is not supported; write it as text";
                return Err(header(line, detail));
            }
            if line.tokens().next().is_none() {
                line = lines
                    .next()
                    .ok_or_else(|| header(line, "expected the number of vertices"))?;
            }
        }
        let mut tokens = line.tokens();
        let mut count = |default: Option<usize>| {
            let given = tokens.next().map(|token| {
                let text = std::str::from_utf8(token).ok()?;
                text.parse().ok()
            });
            given
                .unwrap_or(default)
                .ok_or_else(|| header(line, "expected the number of vertices, faces and edges"))
        };
        Ok(Self {
            vertices: count(None)?,
            faces: count(Some(0))?,
            normals: keyword.is_some_and(|keyword| keyword.normals),
        })
    }

    /// The point of a vertex and its normal, zero where there is none. Colours and texture
    /// coordinates may follow, in any number.
    pub(in crate::reconstruction) fn vertex(&self, line: Line<'_>) -> Result<(Vec3, Vec3), Error> {
        let mut tokens = line.tokens();
        let point = line.vector(&mut tokens)?;
        let normal = if self.normals {
            line.vector(&mut tokens)?
        } else {
            [0.0; 3]
        };
        Ok((point, normal))
    }
}

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let mut lines = Lines::new(bytes, 0).content();
    let header = Header::read(&mut lines)?;
    let mut collector = Collector::new(limits, header.normals, false);
    collector.reserve(header.vertices.min(bytes.len() / SHORTEST_VERTEX + 1))?;
    let mut found = 0;
    for line in lines.take(header.vertices) {
        let ([x, y, z], [nx, ny, nz]) = header.vertex(line)?;
        collector.push(&[x, y, z, nx, ny, nz, 0.0], line.number)?;
        found += 1;
    }
    complete("the list of vertices", header.vertices, found)?;
    Ok(collector)
}

/// Checks that all of the declared rows were there.
pub(in crate::reconstruction) fn complete(
    what: &str,
    declared: usize,
    found: usize,
) -> Result<(), Error> {
    if found < declared {
        return Err(Error::Truncated {
            what: what.to_owned(),
            declared: declared as u64,
            found: found as u64,
        });
    }
    Ok(())
}

fn header(line: Line<'_>, detail: &str) -> Error {
    Error::Header {
        line: line.number,
        detail: format!("{detail}, found \"{}\"", excerpt(line.bytes)),
    }
}
