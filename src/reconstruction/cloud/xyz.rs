//! Tables of numbers as text: XYZ, CSV, PTS, PTX and their kin.
//!
//! There is no standard. The [`layout`](super::layout) is found first; what the columns hold is taken
//! from a line of names if there is one, else from their [values](super::roles).

use super::cells::{Cell, Cells, Separator};
use super::collector::Collector;
use super::columns::Columns;
use super::layout::{Layout, unbracketed};
use super::roles::{Sample, Tally};
use super::text::Line;
use super::{Error, Limits, foreign, ptx};

/// Rows, and numbers in all of them, that decide what unnamed columns hold.
const SAMPLE_ROWS: usize = 2000;
const SAMPLE_NUMBERS: usize = 1 << 20;

pub(super) fn read<'l>(bytes: &[u8], limits: &'l Limits) -> Result<Collector<'l>, Error> {
    if let Some(scans) = ptx::Scans::find(bytes) {
        return scans.read(limits);
    }
    let mut layout = Layout::find(bytes)?;
    let columns = match layout.columns.take() {
        Some(columns) => columns,
        None => sample(&layout).columns().ok_or_else(|| {
            let width = layout.width;
            Error::NoCoordinates(format!(
                "expected at least 3 columns of numbers (x, y, z) among {width}"
            ))
        })?,
    };
    let mut collector = columns.collector(limits);
    if let Some(line) = layout.unknown_names {
        let message = format!(
            "line {} was skipped: it does not name x, y and z",
            line.number
        );
        collector.warn("header_ignored", message);
    }
    if let (Some(first), Some(last)) = (layout.skipped.first(), layout.skipped.last()) {
        let message = format!(
            "lines above the rows that hold no points were skipped: {}, from line {first} to line {last}",
            layout.skipped.len()
        );
        collector.warn("preamble_skipped", message);
    }
    collect(&layout, &columns, &mut collector)?;
    Ok(collector)
}

/// Reads the rows; where a count stands above them, another count may follow with rows of its own,
/// as in PTS files of several scans.
fn collect(
    layout: &Layout<'_>,
    columns: &Columns,
    collector: &mut Collector<'_>,
) -> Result<(), Error> {
    let (mut declared, mut found) = (layout.declared, 0);
    for line in rows(layout) {
        if declared == Some(found)
            && let Some(count) = count(line, layout.separator)
        {
            (declared, found) = (Some(count), 0);
            continue;
        }
        collector.push(&columns.row(line, layout.separator)?, line.number)?;
        found += 1;
    }
    match declared {
        Some(declared) if found < declared => Err(Error::Truncated {
            what: "the table".to_owned(),
            declared,
            found,
        }),
        _ => Ok(()),
    }
}

/// The rows of a table.
fn rows<'a>(layout: &Layout<'a>) -> impl Iterator<Item = Line<'a>> + use<'a> {
    let lines = layout.rows.clone().map(unbracketed);
    lines.filter(|line| !line.is_blank())
}

/// The whole number that is alone in a line.
fn count(line: Line<'_>, separator: Separator) -> Option<u64> {
    let mut cells = Cells::of(line, separator);
    let (only, None) = (cells.next()?, cells.next()) else {
        return None;
    };
    std::str::from_utf8(only).ok()?.parse().ok()
}

/// Rows from all over the table.
fn sample(layout: &Layout<'_>) -> Sample {
    let width = layout.width;
    let wanted = SAMPLE_ROWS.min(SAMPLE_NUMBERS / width).max(1);
    let first = rows(layout).next().map_or(1, |line| line.bytes.len() + 1);
    let every = (layout.rows.left() / first / wanted).max(1);
    let (mut values, mut tallies) = (Vec::new(), vec![Tally::default(); width]);
    for line in rows(layout).step_by(every).take(2 * wanted) {
        let start = values.len();
        let cells = Cells::of(line, layout.separator).take(width);
        for (cell, tally) in cells.zip(&mut tallies) {
            let cell = Cell::of(cell);
            tally.numbers += usize::from(matches!(cell, Cell::Number(_)));
            tally.words += usize::from(cell == Cell::Text);
            values.push(match cell {
                Cell::Number(value) => value,
                _ => f64::NAN,
            });
        }
        values.resize(start + width, f64::NAN);
    }
    Sample {
        width,
        values,
        tallies,
    }
}

/// Whether a text looks like a table.
pub(super) fn is_table(head: &[u8]) -> bool {
    foreign::is_text(head) && (ptx::Scans::find(head).is_some() || Layout::find(head).is_ok())
}
