//! Tables of numbers as text: XYZ, CSV and their kin.
//!
//! There is no standard. Three columns are points; what further columns mean is taken from a line
//! of names if there is one, else from their number: 6 add a normal, 4 and 7 end with a label.

use super::collector::Collector;
use super::columns::{Columns, MAX_COLUMNS};
use super::text::{Line, Lines, parse};
use super::{Error, Label, Limits};

/// What stands above the rows.
struct Head<'a> {
    /// Names of the columns, from a line of its own.
    names: Option<Line<'a>>,
    /// A comment that might be names of columns, as CloudCompare and NumPy write them.
    comment: Option<&'a [u8]>,
    /// Number of points, alone in the first line.
    declared: Option<u64>,
    /// The first row.
    first: Line<'a>,
    /// The lines from the first row on.
    rows: Lines<'a>,
}

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    let head = head(bytes)?;
    if mixes_separators(head.first) {
        let detail = "values are parted in several ways; write decimal points, not decimal commas";
        return Err(head.first.error(detail));
    }
    let width = head.first.tokens().count();
    if width < 3 {
        let detail = format!("expected at least 3 columns (x, y, z), found {width}");
        return Err(Error::NoCoordinates(detail));
    }
    if width > MAX_COLUMNS {
        return Err(head.first.error(format!("more than {MAX_COLUMNS} columns")));
    }
    let mut warnings = Vec::new();
    let columns = match named(&head, width)? {
        Some(columns) => columns,
        None => positional(&head, width, &mut warnings),
    };
    let mut collector = columns.collector(limits);
    for (code, message) in warnings {
        collector.warn(code, message);
    }
    let found = columns.collect(head.rows.content(), &mut collector)?;
    match head.declared {
        Some(declared) if found < declared => Err(Error::Truncated {
            what: "the table".to_owned(),
            declared,
            found,
        }),
        _ => Ok(collector),
    }
}

fn head(bytes: &[u8]) -> Result<Head<'_>, Error> {
    let (mut names, mut comment, mut declared) = (None, None, None);
    let mut lines = Lines::new(bytes, 0);
    loop {
        let rows = lines.clone();
        let Some(line) = lines.next() else {
            return Err(Error::Empty);
        };
        if line.comment().is_some() {
            comment = line.comment();
            continue;
        }
        let numbers = line.tokens().filter(|token| parse(token).is_some()).count();
        match line.tokens().count() {
            0 => {}
            1 if numbers == 1 && declared.is_none() && names.is_none() => {
                declared = parse(line.bytes).map(|count| count.max(0.0) as u64);
            }
            _ if numbers == 0 && names.is_none() => names = Some(line),
            _ => {
                return Ok(Head {
                    names,
                    comment,
                    declared,
                    first: line,
                    rows,
                });
            }
        }
    }
}

/// Whether commas, semicolons or blanks occur side by side, as they do with decimal commas, which
/// would make two columns of each number.
fn mixes_separators(line: Line<'_>) -> bool {
    let row = line.bytes.split(|&b| b == b'#').next().unwrap_or_default();
    let by = |separator: u8| row.split(move |&b| b == separator);
    let has_blanks = |part: &[u8]| part.trim_ascii().iter().any(u8::is_ascii_whitespace);
    match (by(b',').count(), by(b';').count()) {
        (1, 1) => false,
        (_, 1) => by(b',').any(has_blanks),
        (1, _) => by(b';').any(has_blanks),
        _ => true,
    }
}

/// The columns by their names; `None` where no line says what they are.
fn named(head: &Head<'_>, width: usize) -> Result<Option<Columns>, Error> {
    let unquoted = |token: &'_ [u8]| -> Vec<u8> {
        token
            .iter()
            .copied()
            .filter(|b| !b"\"'".contains(b))
            .collect()
    };
    let columns = |line: Line<'_>| {
        let names: Vec<_> = line.tokens().take(MAX_COLUMNS).map(unquoted).collect();
        (Columns::named(names.iter().map(Vec::as_slice)), names)
    };
    let Some(line) = head.names else {
        let comment = head
            .comment
            .map(|bytes| columns(Line { number: 0, bytes }).0);
        return Ok(comment.flatten().filter(|columns| columns.width() == width));
    };
    let (columns, names) = columns(line);
    let is_axis =
        |name: &Vec<u8>| matches!(name.to_ascii_lowercase().as_slice(), b"x" | b"y" | b"z");
    match columns {
        Some(columns) if columns.width() != width => Err(Error::Header {
            line: line.number,
            detail: format!(
                "{} column names, but rows of {width} values",
                columns.width()
            ),
        }),
        None if names.iter().any(is_axis) => Err(Error::NoCoordinates(format!(
            "line {} names columns, but not all of x, y and z",
            line.number
        ))),
        columns => Ok(columns),
    }
}

/// The columns by their number and their values.
fn positional(
    head: &Head<'_>,
    width: usize,
    warnings: &mut Vec<(&'static str, String)>,
) -> Columns {
    if let Some(line) = head.names {
        let message = format!(
            "line {} was skipped: it does not name x, y and z",
            line.number
        );
        warnings.push(("header_ignored", message));
    }
    let is_label = |value: f64| Label::from_number(value).is_some();
    let is_byte = |value: f64| value.fract().abs() < f64::EPSILON && (0.0..=255.0).contains(&value);
    let exceeds_one = |value: f64| value > 1.0;
    let labelled = || every(head, width - 1..width, is_label);
    let coloured = || every(head, 3..6, is_byte) && !every(head, 3..6, |value| !exceeds_one(value));
    let slots: &[usize] = match width {
        3 => &[0, 1, 2],
        4 if labelled() => &[0, 1, 2, 6],
        6 if !coloured() => &[0, 1, 2, 3, 4, 5],
        7 if labelled() && !coloured() => &[0, 1, 2, 3, 4, 5, 6],
        _ => {
            let message = format!(
                "only the first 3 of {width} columns were used; name the columns x y z nx ny nz \
                 label in the first line to use more"
            );
            warnings.push(("columns_ignored", message));
            &[0, 1, 2]
        }
    };
    Columns::leading(slots, width)
}

/// Whether a predicate holds for all values in some columns; ends at the first for which it does not.
fn every(head: &Head<'_>, columns: std::ops::Range<usize>, holds: impl Fn(f64) -> bool) -> bool {
    head.rows.clone().content().all(|line| {
        let mut values = line.tokens().skip(columns.start).take(columns.len());
        values.all(|token| parse(token).is_some_and(&holds))
    })
}
