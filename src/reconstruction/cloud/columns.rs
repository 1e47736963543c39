//! Which column of a table holds what: the part that text tables, PLY and PCD have in common.

use super::collector::{Collector, Row};
use super::text::{Line, excerpt};
use super::{Error, Limits};

/// Names of the slots of a [`Row`], in its order, as tables spell them.
const NAMES: [&[&str]; 7] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx", "normal_x"],
    &["ny", "normal_y"],
    &["nz", "normal_z"],
    &["label"],
];

/// Most columns of a table; more is taken for a file of another kind.
pub(super) const MAX_COLUMNS: usize = 4096;

/// The slot of a [`Row`] for each column of a table, if any.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(in crate::reconstruction) struct Columns {
    slots: Vec<Option<usize>>,
    /// Whether some components of normals are there, but not all.
    incomplete_normals: bool,
}

impl Columns {
    /// Columns by their names, of either case; `None` unless x, y and z are among them.
    ///
    /// Normals count only if all three components are there. Of two columns of one name the first
    /// counts.
    pub(super) fn named<'a>(names: impl IntoIterator<Item = &'a [u8]>) -> Option<Self> {
        let mut taken = [false; 7];
        let mut slot = |name: &[u8]| {
            let is_name = |known: &&str| name.eq_ignore_ascii_case(known.as_bytes());
            let slot = NAMES.iter().position(|names| names.iter().any(is_name))?;
            (!std::mem::replace(&mut taken[slot], true)).then_some(slot)
        };
        let names = names.into_iter().take(MAX_COLUMNS);
        let mut slots: Vec<_> = names.map(&mut slot).collect();
        let components = taken[3..6].iter().filter(|&&taken| taken).count();
        let incomplete_normals = (1..3).contains(&components);
        if incomplete_normals {
            for slot in &mut slots {
                *slot = slot.filter(|slot| !(3..6).contains(slot));
            }
        }
        taken[..3].iter().all(|&taken| taken).then_some(Self {
            slots,
            incomplete_normals,
        })
    }

    /// The given slots in the first columns, then columns that are not used, `width` in all.
    pub(super) fn leading(slots: &[usize], width: usize) -> Self {
        let leading = slots.iter().copied().map(Some);
        Self {
            slots: leading.chain(std::iter::repeat(None)).take(width).collect(),
            incomplete_normals: false,
        }
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
        if self.incomplete_normals {
            let message = "normals are not used: they have not all of nx, ny and nz";
            collector.warn("normals_ignored", message);
        }
        collector
    }

    /// Reads lines of values as rows until the lines end.
    ///
    /// # Errors
    /// A line with another number of values, a value that is no number, a label that is none.
    pub(super) fn collect<'a>(
        &self,
        lines: impl Iterator<Item = Line<'a>>,
        collector: &mut Collector<'_>,
    ) -> Result<u64, Error> {
        let mut rows = 0;
        for line in lines {
            collector.push(&self.row(line)?, line.number)?;
            rows += 1;
        }
        Ok(rows)
    }

    fn row(&self, line: Line<'_>) -> Result<Row, Error> {
        let mut row = [0.0; 7];
        let mut found = 0;
        for token in line.tokens() {
            if let Some(slot) = self.slot(found) {
                row[slot] = line.number(token)?;
            }
            found += 1;
        }
        if found != self.slots.len() {
            return Err(line.error(format!(
                "expected {} values, found {found} in \"{}\"",
                self.slots.len(),
                excerpt(line.bytes)
            )));
        }
        Ok(row)
    }
}
