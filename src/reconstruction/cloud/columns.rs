//! Which column of a table holds what: the part that all tables have in common.

use super::cells::{Cells, Separator, is_missing};
use super::collector::{Collector, Row};
use super::names::Names;
use super::text::{Line, excerpt};
use super::{Error, Limits};
use crate::reconstruction::Warning;

/// Most columns of a table; more is taken for a file of another kind.
pub(super) const MAX_COLUMNS: usize = 4096;

/// The slot of a [`Row`] for each column of a table, if any.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::reconstruction) struct Columns {
    slots: Vec<Option<usize>>,
    /// What is to be said about the choice.
    warnings: Vec<Warning>,
}

impl Columns {
    /// Columns by their names; `None` unless x, y and z are among them.
    ///
    /// Normals count only if all three components are there. Of two columns of one name the first
    /// counts.
    pub(super) fn named<'a>(names: impl IntoIterator<Item = &'a [u8]>) -> Option<Self> {
        let names: Vec<_> = names.into_iter().take(MAX_COLUMNS).collect();
        let found = Names::of(names.iter().copied());
        let mut columns = Self::placed(found.point?, names.len());
        if found.rival {
            let spelled = |&column: &usize| excerpt(names[column]);
            let taken: Vec<_> = found.point?.iter().map(spelled).collect();
            let message = format!(
                "the names leave open which columns are the coordinates; {} were taken",
                taken.join(", ")
            );
            columns.warn("columns_ambiguous", message);
        }
        match found.normal {
            [Some(x), Some(y), Some(z)] => columns = columns.with_normals([x, y, z]),
            [None, None, None] => {}
            _ => {
                let message = "normals are not used: they have not all of nx, ny and nz";
                columns.warn("normals_ignored", message);
            }
        }
        if let Some(label) = found.label {
            columns.slots[label] = Some(6);
        }
        Some(columns)
    }

    /// Coordinates in the given ones of `width` columns.
    pub(super) fn placed(point: [usize; 3], width: usize) -> Self {
        let mut slots = vec![None; width];
        for (slot, column) in point.into_iter().enumerate() {
            slots[column] = Some(slot);
        }
        Self {
            slots,
            warnings: Vec::new(),
        }
    }

    /// The same with normals in the given columns.
    pub(super) fn with_normals(mut self, normal: [usize; 3]) -> Self {
        for (component, column) in normal.into_iter().enumerate() {
            self.slots[column] = Some(3 + component);
        }
        self
    }

    /// The same behind a column that no name is for.
    pub(super) fn behind_one(mut self) -> Self {
        self.slots.insert(0, None);
        self
    }

    /// Notes something that the user should know.
    pub(super) fn warn(&mut self, code: &'static str, message: impl Into<String>) {
        self.warnings.push(Warning::new(code, message));
    }

    /// Number of columns.
    pub(super) fn width(&self) -> usize {
        self.slots.len()
    }

    /// The slot of a column.
    pub(in crate::reconstruction) fn slot(&self, column: usize) -> Option<usize> {
        self.slots.get(column).copied().flatten()
    }

    /// Whether there are normals.
    pub(in crate::reconstruction) fn has_normals(&self) -> bool {
        self.holds(3)
    }

    fn holds(&self, slot: usize) -> bool {
        self.slots.contains(&Some(slot))
    }

    /// A collector of what these columns hold.
    pub(super) fn collector<'a>(&self, limits: &'a Limits) -> Collector<'a> {
        let mut collector = Collector::new(limits, self.has_normals(), self.holds(6));
        for warning in &self.warnings {
            collector.warn(warning.code, warning.message.clone());
        }
        collector
    }

    /// Reads lines of values as rows until the lines end.
    ///
    /// # Errors
    /// A line with another number of values, a value that is no number.
    pub(super) fn collect<'a>(
        &self,
        lines: impl Iterator<Item = Line<'a>>,
        collector: &mut Collector<'_>,
    ) -> Result<u64, Error> {
        let mut rows = 0;
        for line in lines {
            collector.push(&self.row(line, Separator::Any)?, line.number)?;
            rows += 1;
        }
        Ok(rows)
    }

    /// The row of a line; a missing value is not a number.
    pub(super) fn row(&self, line: Line<'_>, separator: Separator) -> Result<Row, Error> {
        let mut row = [0.0; 7];
        let (mut found, mut ends_empty) = (0, false);
        for cell in Cells::of(line, separator) {
            if let Some(slot) = self.slot(found) {
                row[slot] = match line.number(cell) {
                    // Labels may be words: then they are names of classes.
                    Err(_) if slot == 6 => f64::NAN,
                    Err(_) if separator != Separator::Any && is_missing(cell) => f64::NAN,
                    value => value?,
                };
            }
            found += 1;
            ends_empty = cell.is_empty();
        }
        // A separator may stand at the end of a line.
        let width = self.slots.len();
        if found == width || found == width + 1 && ends_empty {
            return Ok(row);
        }
        let text = excerpt(line.bytes);
        Err(line.error(format!(
            "expected {width} values, found {found} in \"{text}\""
        )))
    }
}
