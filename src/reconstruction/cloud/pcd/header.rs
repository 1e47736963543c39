//! The header of a PCD file: lines of a keyword and values, up to `DATA`.

use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::Scalar;
use crate::reconstruction::cloud::columns::MAX_COLUMNS;
use crate::reconstruction::cloud::text::excerpt;

/// Longest line of a header.
const MAX_LINE: usize = 64 << 10;
/// Most lines of a header, comments included.
const MAX_LINES: usize = 1000;

/// How the points are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Data {
    Ascii,
    Binary,
    Compressed,
}

/// A field: `count` numbers of a type in each point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field<'a> {
    pub(super) name: &'a [u8],
    pub(super) scalar: Scalar,
    pub(super) count: usize,
}

/// What the header says.
#[derive(Debug)]
pub(super) struct Header<'a> {
    pub(super) fields: Vec<Field<'a>>,
    pub(super) points: usize,
    pub(super) data: Data,
    /// Bytes of the header.
    pub(super) bytes: usize,
    /// Lines of the header.
    pub(super) lines: usize,
}

impl<'a> Header<'a> {
    /// Bytes of a point in the binary form.
    pub(super) fn record_bytes(&self) -> usize {
        let size = |field: &Field<'_>| field.scalar.size() * field.count;
        self.fields.iter().map(size).sum()
    }

    /// A name for each number of a point; only the first of a field bears the field's.
    pub(super) fn column_names(&self) -> impl Iterator<Item = &'a [u8]> + '_ {
        self.fields.iter().flat_map(|field| {
            let others = std::iter::repeat_n(b"".as_slice(), field.count - 1);
            std::iter::once(field.name).chain(others)
        })
    }
}

/// The values of the keywords seen so far.
#[derive(Default)]
struct Lines<'a> {
    number: usize,
    names: Vec<&'a [u8]>,
    sizes: Vec<&'a [u8]>,
    types: Vec<&'a [u8]>,
    counts: Vec<&'a [u8]>,
    width: Option<usize>,
    height: Option<usize>,
    points: Option<usize>,
}

/// Reads the header at the start of `bytes`.
pub(super) fn read(bytes: &[u8]) -> Result<Header<'_>, Error> {
    let mut lines = Lines::default();
    let mut position = 0;
    loop {
        let rest = &bytes[position..];
        lines.number += 1;
        let end = rest.iter().take(MAX_LINE).position(|&b| b == b'\n');
        let Some(end) = end.filter(|_| lines.number <= MAX_LINES) else {
            return Err(lines.error("the header ends without DATA", b""));
        };
        position += end + 1;
        if let Some(data) = lines.line(&rest[..end])? {
            return Ok(Header {
                fields: lines.fields()?,
                points: lines.points()?,
                data,
                bytes: position,
                lines: lines.number,
            });
        }
    }
}

impl<'a> Lines<'a> {
    /// Takes note of a line; the last one says how the points are written.
    fn line(&mut self, line: &'a [u8]) -> Result<Option<Data>, Error> {
        let mut words = line
            .split(u8::is_ascii_whitespace)
            .filter(|word| !word.is_empty());
        let keyword = words.next().unwrap_or_default();
        let mut values: Vec<_> = words.take(MAX_COLUMNS + 1).collect();
        let mut take = || std::mem::take(&mut values);
        match keyword.to_ascii_uppercase().as_slice() {
            b"FIELDS" | b"COLUMNS" => self.names = take(),
            b"SIZE" => self.sizes = take(),
            b"TYPE" => self.types = take(),
            b"COUNT" => self.counts = take(),
            b"WIDTH" => self.width = Some(self.count(&values, line)?),
            b"HEIGHT" => self.height = Some(self.count(&values, line)?),
            b"POINTS" => self.points = Some(self.count(&values, line)?),
            b"DATA" => {
                return Ok(Some(match values[..] {
                    [b"ascii"] => Data::Ascii,
                    [b"binary"] => Data::Binary,
                    [b"binary_compressed"] => Data::Compressed,
                    _ => {
                        return Err(self.error("expected ascii, binary or binary_compressed", line));
                    }
                }));
            }
            b"" | b"VERSION" | b"VIEWPOINT" | [b'#', ..] => {}
            _ => return Err(self.error("expected a keyword of a PCD header", line)),
        }
        Ok(None)
    }

    fn count(&self, values: &[&[u8]], line: &[u8]) -> Result<usize, Error> {
        let value = values.first().and_then(|value| integer(value));
        value.ok_or_else(|| self.error("expected a number", line))
    }

    fn fields(&self) -> Result<Vec<Field<'a>>, Error> {
        let names = &self.names;
        if self.sizes.len() != names.len() || self.types.len() != names.len() {
            return Err(self.error("expected SIZE and TYPE for each of FIELDS", b""));
        }
        let counts = match self.counts.len() {
            0 => vec![b"1".as_slice(); names.len()],
            n if n == names.len() => self.counts.clone(),
            _ => return Err(self.error("expected a COUNT for each of FIELDS", b"")),
        };
        let mut fields = Vec::with_capacity(names.len());
        let mut columns = 0;
        for (i, &name) in names.iter().enumerate() {
            let size = integer(self.sizes[i]).unwrap_or(0);
            let scalar = match self.types[i] {
                [kind] => Scalar::of(kind.to_ascii_lowercase(), size),
                _ => None,
            };
            let scalar = scalar.ok_or_else(|| {
                self.error(
                    "expected TYPE and SIZE of a number (F 4, F 8, I or U 1 to 8) for",
                    name,
                )
            })?;
            let count = integer(counts[i]).filter(|&count| (1..=MAX_COLUMNS).contains(&count));
            let count =
                count.ok_or_else(|| self.error("expected a COUNT of 1 to 4096 for", name))?;
            columns += count;
            if columns > MAX_COLUMNS {
                return Err(self.error("more than 4096 numbers in a point", b""));
            }
            fields.push(Field {
                name,
                scalar,
                count,
            });
        }
        Ok(fields)
    }

    fn points(&self) -> Result<usize, Error> {
        let grid = match (self.width, self.height) {
            (Some(width), Some(height)) => width.checked_mul(height),
            (width, _) => width,
        };
        match (self.points, grid) {
            (Some(points), Some(grid)) if points != grid => {
                Err(self.error("POINTS is not WIDTH times HEIGHT", b""))
            }
            (points, grid) => points
                .or(grid)
                .ok_or_else(|| self.error("expected POINTS, or WIDTH and HEIGHT", b"")),
        }
    }

    fn error(&self, detail: &str, found: &[u8]) -> Error {
        let found = match found {
            [] => String::new(),
            found => format!(", found \"{}\"", excerpt(found)),
        };
        Error::Header {
            line: self.number,
            detail: format!("{detail}{found}"),
        }
    }
}

fn integer(text: &[u8]) -> Option<usize> {
    std::str::from_utf8(text).ok()?.parse().ok()
}
