//! The rows that one way to part cells makes of the first lines of a text.

use super::cells::{Cell, Cells, Separator};
use super::columns::MAX_COLUMNS;
use super::text::Line;

/// Rows of one width, as one separator makes them of the first lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) separator: Separator,
    pub(super) cells: usize,
    pub(super) rows: usize,
    /// Cells without a value, those at line ends aside.
    pub(super) missing: usize,
    /// Rows whose last cell is empty, as with a separator at the end of the line.
    open: usize,
}

impl Shape {
    /// The shape that most rows have; of several, the one met first.
    pub(super) fn of(lines: &[Line<'_>], separator: Separator) -> Option<Self> {
        let mut shapes: Vec<Self> = Vec::new();
        for &line in lines {
            let Some((cells, missing, open)) = row(line, separator) else {
                continue;
            };
            let known = shapes.iter().position(|shape| shape.cells == cells);
            let index = known.unwrap_or_else(|| {
                shapes.push(Self {
                    separator,
                    cells,
                    rows: 0,
                    missing: 0,
                    open: 0,
                });
                shapes.len() - 1
            });
            shapes[index].rows += 1;
            shapes[index].missing += missing;
            shapes[index].open += usize::from(open);
        }
        shapes.into_iter().rev().max_by_key(|shape| shape.rows)
    }

    pub(super) fn width(&self) -> usize {
        self.cells - usize::from(self.open == self.rows)
    }

    pub(super) fn fits(&self, line: Line<'_>) -> bool {
        row(line, self.separator).is_some_and(|(cells, _, open)| {
            cells == self.cells || cells == self.width() || cells == self.cells + 1 && open
        })
    }
}

/// Cells of a line that may be a row, how many of them lack a value, and whether the last is empty.
/// A row has three or more places for numbers, and a number in one of them.
fn row(line: Line<'_>, separator: Separator) -> Option<(usize, usize, bool)> {
    let (mut cells, mut numbers, mut missing, mut open) = (0, 0, 0, false);
    for cell in Cells::of(line, separator).take(MAX_COLUMNS + 2) {
        cells += 1;
        open = cell.is_empty();
        match Cell::of(cell) {
            Cell::Number(_) => numbers += 1,
            Cell::Missing => missing += 1,
            Cell::Text => {}
        }
    }
    missing -= usize::from(open && missing > 0);
    let places = numbers + missing + usize::from(open);
    (numbers > 0 && places >= 3).then_some((cells, missing, open))
}
