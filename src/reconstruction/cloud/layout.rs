//! How a table of text is laid out: what parts its cells, where its rows begin, what stands above.

use super::Error;
use super::cells::{Cell, Cells, Separator};
use super::columns::{Columns, MAX_COLUMNS};
use super::names::Names;
use super::shape::Shape;
use super::text::{Line, Lines, excerpt, has_decimal_comma};

/// Lines and bytes at the beginning that decide on the layout.
const LOOK_LINES: usize = 1000;
pub(super) const LOOK_BYTES: usize = 1 << 20;

/// A table of text before its rows are read.
#[derive(Debug)]
pub(super) struct Layout<'a> {
    pub(super) separator: Separator,
    /// Cells of a row.
    pub(super) width: usize,
    /// Whether all rows looked at end in one more cell, an empty one.
    open: bool,
    /// The columns, if a line names them.
    pub(super) columns: Option<Columns>,
    /// Number of that line.
    pub(super) named_by: Option<usize>,
    /// A line of names that name no coordinates.
    pub(super) unknown_names: Option<Line<'a>>,
    /// Number of points, alone in a line.
    pub(super) declared: Option<u64>,
    /// Lines of words above the rows that were passed over.
    pub(super) skipped: Vec<usize>,
    /// The lines from the first row on.
    pub(super) rows: Lines<'a>,
}

/// A row without the brackets around it, as programs print arrays; a line of brackets only is empty.
pub(super) fn unbracketed(line: Line<'_>) -> Line<'_> {
    let mut bytes = line.bytes;
    if bytes.iter().all(|b| b"[](){},; \t".contains(b)) && bytes.iter().any(|b| b"])}".contains(b))
    {
        return Line { bytes: b"", ..line };
    }
    if !bytes.starts_with(b"[") && !bytes.starts_with(b"(") && !bytes.starts_with(b"{") {
        return line;
    }
    while let [b'[' | b'(' | b'{' | b' ', rest @ ..] = bytes {
        bytes = rest;
    }
    while let [rest @ .., b']' | b')' | b'}' | b' ' | b',' | b';'] = bytes {
        bytes = rest;
    }
    Line { bytes, ..line }
}

impl<'a> Layout<'a> {
    /// Finds the layout of a text.
    ///
    /// # Errors
    /// No rows of three or more numbers, or names that do not fit the rows.
    pub(super) fn find(text: &'a [u8]) -> Result<Self, Error> {
        let mut looked_at = &text[..text.len().min(LOOK_BYTES)];
        if looked_at.len() < text.len()
            && let Some(end) = looked_at.iter().rposition(|&b| b == b'\n')
        {
            looked_at = &looked_at[..end];
        }
        let lines = || Lines::new(looked_at, 0).with_tabs().take(LOOK_LINES);
        let content: Vec<_> = lines()
            .map(unbracketed)
            .filter(|line| !line.is_blank())
            .collect();
        let mut shape: Option<Shape> = None;
        for found in Separator::OF_TABLES
            .iter()
            .filter_map(|&by| Shape::of(&content, by))
        {
            let better = |best: &Shape| {
                found.rows > best.rows || found.rows == best.rows && found.missing < best.missing
            };
            if shape.as_ref().is_none_or(better) {
                shape = Some(found);
            }
        }
        let shape = shape.ok_or_else(|| no_rows(&content))?;
        if shape.width() > MAX_COLUMNS {
            return Err(content[0].error(format!("more than {MAX_COLUMNS} columns")));
        }
        let first = content.iter().find(|line| shape.fits(**line));
        let first = first.ok_or_else(|| no_rows(&content))?.number;
        let mut layout = Self {
            separator: shape.separator,
            width: shape.width(),
            open: shape.width() < shape.cells,
            columns: None,
            named_by: None,
            unknown_names: None,
            declared: None,
            skipped: Vec::new(),
            rows: Lines::new(text, 0).with_tabs(),
        };
        while layout
            .rows
            .clone()
            .next()
            .is_some_and(|line| line.number < first)
        {
            layout.rows.next();
        }
        let above: Vec<_> = lines().take_while(|line| line.number < first).collect();
        layout.read_above(&above)?;
        Ok(layout)
    }

    /// Whether rows are read as those of another layout are, with the same warnings.
    pub(super) fn is_as(&self, other: &Layout<'_>) -> bool {
        let unknown_names = |layout: &Layout<'_>| layout.unknown_names.map(|line| line.number);
        self.separator == other.separator
            && (self.width, self.open) == (other.width, other.open)
            && self.columns == other.columns
            && self.declared == other.declared
            && self.skipped == other.skipped
            && unknown_names(self) == unknown_names(other)
            && self.rows.left() == other.rows.left()
    }

    /// Takes names and count from the lines above the rows; those next to the rows win.
    fn read_above(&mut self, above: &[Line<'a>]) -> Result<(), Error> {
        let mut misfit = None;
        for &line in above.iter().rev() {
            let text = line.comment();
            let line = Line {
                bytes: text.unwrap_or(line.bytes).trim_ascii_start(),
                ..line
            };
            if line.bytes.is_empty() {
                continue;
            }
            if self.columns.is_none() {
                match self.names(line) {
                    Found::Columns(columns) => {
                        self.width = columns.width();
                        self.columns = Some(columns);
                        self.named_by = Some(line.number);
                        continue;
                    }
                    Found::Width(width) if text.is_none() => {
                        misfit.get_or_insert((line, width));
                        continue;
                    }
                    _ => {}
                }
            }
            if text.is_none() {
                self.other(line)?;
            }
        }
        if self.columns.is_some() {
            // Between the names and the rows there may be units, or a rule.
            self.skipped
                .extend(self.unknown_names.take().map(|line| line.number));
        }
        self.skipped.sort_unstable();
        match (&self.columns, misfit, self.unknown_names) {
            (None, Some((line, found)), _) => Err(Error::Header {
                line: line.number,
                detail: format!("{found} column names, but rows of {} values", self.width),
            }),
            (None, None, Some(line)) => refuse_half_names(line, self.separator),
            _ => Ok(()),
        }
    }

    /// A line above the rows that does not name the coordinates, nor is a comment.
    fn other(&mut self, line: Line<'a>) -> Result<(), Error> {
        let cells: Vec<_> = Cells::of(line, self.separator).take(MAX_COLUMNS).collect();
        let numbers: Vec<f64> = cells
            .iter()
            .filter_map(|cell| match Cell::of(cell) {
                Cell::Number(value) => Some(value),
                _ => None,
            })
            .collect();
        match (cells.as_slice(), numbers.as_slice()) {
            (_, &[count]) if cells.len() == 1 && self.declared.is_none() => {
                self.declared = Some(count.max(0.0) as u64);
            }
            // Spreadsheets tell their separator so.
            _ if line.bytes.to_ascii_lowercase().starts_with(b"sep=") => {}
            (_, numbers) if numbers.len() >= 3 && numbers.len() == cells.len() => {
                let text = excerpt(line.bytes);
                let (width, found) = (self.width, cells.len());
                return Err(line.error(format!(
                    "expected {width} values, as in most lines, found {found} in \"{text}\""
                )));
            }
            (_, []) if cells.len() == self.width && self.is_unnamed() => {
                self.unknown_names = Some(line);
            }
            _ => self.skipped.push(line.number),
        }
        Ok(())
    }

    fn is_unnamed(&self) -> bool {
        self.columns.is_none() && self.unknown_names.is_none()
    }

    /// The columns that a line names, whatever parts the names.
    fn names(&self, line: Line<'_>) -> Found {
        let mut found = Found::Nothing;
        // What a program says of its columns may stand before their names.
        let after = line.bytes.iter().rposition(|&b| b == b'=' || b == b':');
        let behind = after.map(|mark| Line {
            bytes: line.bytes[mark + 1..].trim_ascii_start(),
            ..line
        });
        for line in [Some(line), behind].into_iter().flatten() {
            let line = unbracketed(line);
            let separators = [self.separator].into_iter().chain(Separator::OF_TABLES);
            for separator in separators {
                let cells = Cells::of(line, separator).take(MAX_COLUMNS + 1);
                // Between blanks, a unit in brackets is a cell of its own.
                let is_unit = |cell: &[u8]| cell.starts_with(b"[") || cell.starts_with(b"(");
                let mut cells: Vec<_> = match separator {
                    Separator::Blanks => cells.filter(|cell| !is_unit(cell)).collect(),
                    _ => cells.collect(),
                };
                if cells.len() == self.width + 1 && cells.last().is_some_and(|c| c.is_empty()) {
                    cells.pop();
                }
                let is_number = |cell: &&[u8]| matches!(Cell::of(cell), Cell::Number(_));
                let columns = Columns::named(cells.iter().copied());
                let Some(columns) = columns.filter(|_| !cells.iter().any(is_number)) else {
                    continue;
                };
                // The last column may have a name, but no values.
                let is_open = self.open && columns.width() == self.width + 1;
                if columns.width() == self.width || is_open {
                    return Found::Columns(columns);
                }
                // Tables of R leave out the name of the first column, the names of the rows.
                if columns.width() + 1 == self.width && self.first_names_rows() {
                    return Found::Columns(columns.behind_one());
                }
                if let Found::Nothing = found {
                    found = Found::Width(columns.width());
                }
            }
        }
        found
    }

    /// Whether the first cell of the first rows is text or counts them.
    fn first_names_rows(&self) -> bool {
        let rows = self.rows.clone().content().take(16).enumerate();
        let mut numbers = rows.map(|(i, line)| {
            let cell = Cells::of(line, self.separator).next().map(Cell::of);
            match cell {
                Some(Cell::Number(value)) => Some(value - i as f64),
                _ => None,
            }
        });
        let first = numbers.next().flatten();
        let alike = |value: Option<f64>| match (first, value) {
            (Some(first), Some(value)) => (first - value).abs() < f64::EPSILON,
            (first, value) => first.is_none() && value.is_none(),
        };
        let whole = first.is_none_or(|first| first.fract().abs() < f64::EPSILON);
        let (mut rows, mut all) = (1, true);
        for number in numbers {
            rows += 1;
            all &= alike(number);
        }
        whole && all && rows > 1
    }
}

/// What a line says of the columns.
enum Found {
    Nothing,
    Columns(Columns),
    /// Names of coordinates, but for rows of another width.
    Width(usize),
}

/// Refuses names that are nearly those of coordinates: guessing would be wrong.
fn refuse_half_names(line: Line<'_>, separator: Separator) -> Result<(), Error> {
    let names = Names::of(Cells::of(line, separator).take(MAX_COLUMNS));
    let number = line.number;
    if names.degrees {
        return Err(Error::NoCoordinates(format!(
            "line {number} names latitude and longitude, which are angles; project them to metres \
             and name the columns x, y, z"
        )));
    }
    if names.any_axis {
        return Err(Error::NoCoordinates(format!(
            "line {number} names columns, but not all of x, y and z"
        )));
    }
    Ok(())
}

/// Why a text has no rows.
fn no_rows(content: &[Line<'_>]) -> Error {
    let Some(&first) = content.first() else {
        return Error::Empty;
    };
    let separators = [
        Separator::Byte(b';'),
        Separator::Byte(b'\t'),
        Separator::Blanks,
    ];
    for &line in content {
        let cells = |by| {
            Cells::of(line, by)
                .filter(|cell| has_decimal_comma(cell))
                .count()
        };
        if separators.into_iter().any(|by| cells(by) >= 2) {
            let detail =
                "values are parted in several ways; write decimal points, not decimal commas";
            return line.error(detail);
        }
    }
    let numbers = |line: &Line<'_>| {
        line.tokens()
            .any(|token| matches!(Cell::of(token), Cell::Number(_)))
    };
    match content.iter().find(|line| numbers(line)) {
        None if Columns::named(first.tokens()).is_some() => Error::Empty,
        None => first.error(format!(
            "expected rows of numbers, found \"{}\"",
            excerpt(first.bytes)
        )),
        Some(line) => {
            let width = line.tokens().count();
            let is_number = |token: &&[u8]| matches!(Cell::of(token), Cell::Number(_));
            match line.tokens().find(|token| !is_number(token)) {
                Some(token) => {
                    line.error(format!("expected a number, found \"{}\"", excerpt(token)))
                }
                None => Error::NoCoordinates(format!(
                    "expected at least 3 columns (x, y, z), found {width}"
                )),
            }
        }
    }
}
