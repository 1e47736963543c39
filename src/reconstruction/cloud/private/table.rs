//! Texts in tables of numbers: comments, what stands above the rows, and cells of words.

use super::lines::{comment, comments, remark};
use super::{Fill, Place, overwrite, range_of};
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::cells::{Cell, Cells};
use crate::reconstruction::cloud::layout::{LOOK_BYTES, Layout, unbracketed};
use crate::reconstruction::cloud::ptx;
use crate::reconstruction::cloud::text::{Line, Lines};

/// Where a row has its label.
const LABEL: usize = 6;

/// All texts of a table, but for the names of its columns.
pub(in crate::reconstruction::cloud) fn texts(bytes: &[u8]) -> Result<Vec<Place>, Error> {
    if ptx::Scans::find(bytes).is_some() {
        return Ok(comments(Lines::new(bytes, 0), bytes));
    }
    let layout = Layout::find(bytes)?;
    let above = &bytes[..bytes.len() - layout.rows.left()];
    let mut places: Vec<Place> = Lines::new(above, 0)
        .filter(|line| layout.named_by != Some(line.number))
        .filter_map(|line| comment(line, bytes))
        .collect();
    let (comments, cells) = of_rows(&layout, bytes);
    places.extend(comments);
    let words = words_above(&layout, above).into_iter().chain(cells);
    let mut all: Vec<Place> = places.iter().cloned().chain(words).collect();
    // Words tell how rows are parted, too: where another layout would be found, they stay.
    if let Some(before) = before_names(&layout, above) {
        all.push(before);
        if reads_the_same(bytes, &all)? {
            return Ok(all);
        }
        all.pop();
    }
    Ok(if reads_the_same(bytes, &all)? {
        all
    } else {
        places
    })
}

/// What stands before the names of the columns, in their line.
fn before_names(layout: &Layout<'_>, above: &[u8]) -> Option<Place> {
    let mut lines = Lines::new(above, 0);
    let line = lines.find(|line| layout.named_by == Some(line.number))?;
    let text = line.comment().unwrap_or(line.bytes);
    let mark = text.iter().rposition(|byte| b"=:".contains(byte))?;
    Some(Place::new(range_of(&text[..mark], above), Fill::Blanks))
}

/// Whether the same layout is found without the texts.
fn reads_the_same(bytes: &[u8], places: &[Place]) -> Result<bool, Error> {
    let head = &bytes[..bytes.len().min(LOOK_BYTES + 1)];
    let before = Layout::find(head)?;
    let mut without = head.to_vec();
    overwrite(&mut without, places);
    Ok(Layout::find(&without).is_ok_and(|after| after.is_as(&before)))
}

/// Comments and cells of words in the rows; words that are labels stay.
fn of_rows(layout: &Layout<'_>, bytes: &[u8]) -> (Vec<Place>, Vec<Place>) {
    let is_label = |column: usize| {
        let columns = layout.columns.as_ref();
        columns.is_some_and(|columns| columns.slot(column) == Some(LABEL))
    };
    let (mut remarks, mut words) = (Vec::new(), Vec::new());
    for line in layout.rows.clone().map(unbracketed) {
        // Most rows have numbers alone, and are many.
        if line.bytes.iter().copied().all(is_of_numbers) {
            continue;
        }
        if line.is_blank() {
            remarks.extend(comment(line, bytes));
            continue;
        }
        let mut end = 0;
        for (column, cell) in Cells::of(line, layout.separator).enumerate() {
            let range = range_of(cell, bytes);
            if !cell.is_empty() {
                end = range_of(cell, line.bytes).end;
            }
            if Cell::of(cell) == Cell::Text && !is_label(column) {
                words.push(Place::new(range, Fill::Words));
            }
        }
        remarks.extend(remark(&line.bytes[end..], bytes));
    }
    (remarks, words)
}

fn is_of_numbers(byte: u8) -> bool {
    byte.is_ascii_digit() || b" \t,;|+-.eE".contains(&byte)
}

/// Lines of words that name no column.
fn words_above(layout: &Layout<'_>, above: &[u8]) -> Vec<Place> {
    let unknown = layout.unknown_names.map(|line| line.number);
    let is_text =
        |line: &Line<'_>| layout.skipped.contains(&line.number) || unknown == Some(line.number);
    let lines = Lines::new(above, 0).filter(is_text);
    lines
        .map(|line| Place::new(range_of(line.bytes, above), Fill::Words))
        .collect()
}
