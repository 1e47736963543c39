//! What columns without names hold, as far as their values tell.

use super::columns::Columns;
use crate::reconstruction::vector::{Vec3, norm};

/// Fewest rows of which a running number is believed: fewer make no surface either.
const FEWEST_ROWS: usize = 16;

/// How far from 1 the length of a normal may be: two digits a component are enough.
pub(super) const UNIT_TOLERANCE: f64 = 0.05;

/// Share of the rows in which a normal must have unit length, those without one aside.
const UNIT_SHARE: f64 = 0.95;

/// Some rows of a table, from all over it, as numbers; what is none is NaN.
#[derive(Debug, Default)]
pub(super) struct Sample {
    pub(super) width: usize,
    /// Row after row.
    pub(super) values: Vec<f64>,
    /// What else is in each column; empty where there can only be numbers.
    pub(super) tallies: Vec<Tally>,
}

/// How often the cells of a column are numbers, finite or not, and words.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub(super) numbers: usize,
    pub(super) words: usize,
}

impl Sample {
    /// The columns of x, y, z and of normals. `None` with fewer than three columns of numbers.
    pub(super) fn columns(&self) -> Option<Columns> {
        let mut numeric = (0..self.width).filter(|&column| self.is_numeric(column));
        let mut numeric: Vec<usize> = numeric.by_ref().collect();
        let running = numeric.len() > 3 && self.is_running(numeric[0]);
        if running {
            numeric.remove(0);
        }
        let (&point, rest) = numeric.split_first_chunk()?;
        let is_normal = |triple: &&[usize]| self.are_normals(triple);
        let normal: Option<[usize; 3]> = rest
            .windows(3)
            .find(is_normal)
            .and_then(|triple| triple.try_into().ok());
        let mut columns = Columns::placed(point, self.width);
        if let Some(normal) = normal {
            columns = columns.with_normals(normal);
        }
        let used = 3 + 3 * usize::from(normal.is_some());
        if used < self.width {
            let listed = |columns: [usize; 3]| columns.map(|c| (c + 1).to_string()).join(", ");
            let normals = normal.map_or_else(String::new, |normal| {
                format!(", normals from {}", listed(normal))
            });
            let number = if running {
                "; the first column is a running number"
            } else {
                ""
            };
            let message = format!(
                "the columns have no names: x, y, z were taken from columns {} of {}{normals}{number}; \
                 what else there is was not used; names in the first line, as x y z nx ny nz label, \
                 say it otherwise",
                listed(point),
                self.width
            );
            columns.warn("columns_ignored", message);
        }
        Some(columns)
    }

    fn rows(&self) -> impl Iterator<Item = &[f64]> {
        self.values.chunks_exact(self.width.max(1))
    }

    /// Whether there are numbers, finite or not, and no more words than other values.
    fn is_numeric(&self, column: usize) -> bool {
        let tally = self.tallies.get(column);
        tally.is_none_or(|tally| tally.numbers > 0 && 2 * tally.words <= self.rows().count())
    }

    /// Whether the values are whole and grow from row to row, or fall, as no coordinate of a scan does.
    fn is_running(&self, column: usize) -> bool {
        let values = || self.rows().map(|row| row[column]);
        self.rows().count() >= FEWEST_ROWS
            && values().all(|value| value.fract().abs() < f64::EPSILON)
            && (values().is_sorted_by(|a, b| a < b) || values().is_sorted_by(|a, b| a > b))
    }

    /// Whether three columns are normals: of unit length nearly everywhere, and not all of them
    /// positive, as colours are.
    fn are_normals(&self, columns: &[usize]) -> bool {
        let (mut there, mut given, mut unit, mut negative) = (0usize, 0usize, 0usize, false);
        for row in self.rows() {
            let normal: Vec3 = std::array::from_fn(|i| row[columns[i]]);
            let length = norm(normal);
            there += usize::from(length.is_finite());
            if !length.is_finite() || length <= 0.0 {
                continue;
            }
            given += 1;
            unit += usize::from((length - 1.0).abs() <= UNIT_TOLERANCE);
            negative |= normal.iter().any(|&v| v < 0.0);
        }
        negative && 2 * given >= there && unit as f64 >= UNIT_SHARE * given as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A table of points on a sphere with the given columns around them.
    fn sample(before: usize, behind: impl Fn(usize, Vec3) -> Vec<f64>) -> Sample {
        let mut values = Vec::new();
        let mut width = 0;
        for i in 0..60 {
            let (z, a) = ((i as f64 + 0.5) / 30.0 - 1.0, i as f64 * 2.4);
            let r = (1.0 - z * z).sqrt();
            let p = [r * a.cos(), r * a.sin(), z];
            let mut row: Vec<f64> = (0..before).map(|_| 3.0 * i as f64 + 7.0).collect();
            row.extend(p.map(|v| 10.0 * v));
            row.extend(behind(i, p));
            width = row.len();
            values.extend(row);
        }
        Sample {
            width,
            values,
            tallies: Vec::new(),
        }
    }

    fn slots(sample: &Sample) -> Vec<Option<usize>> {
        let columns = sample.columns().unwrap();
        (0..sample.width)
            .map(|column| columns.slot(column))
            .collect()
    }

    const POINT: [Option<usize>; 3] = [Some(0), Some(1), Some(2)];
    const NORMAL: [Option<usize>; 3] = [Some(3), Some(4), Some(5)];

    #[test]
    fn normals_are_recognised_wherever_they_stand() {
        let normals = sample(0, |_, p| p.to_vec());
        assert_eq!(slots(&normals), [POINT, NORMAL].concat());
        let behind = sample(0, |i, p| [vec![i as f64 % 7.0, 0.5], p.to_vec()].concat());
        assert_eq!(
            slots(&behind),
            [&POINT[..], &[None, None], &NORMAL].concat()
        );
        let missing = sample(0, |i, p| if i % 3 == 0 { vec![0.0; 3] } else { p.to_vec() });
        assert_eq!(slots(&missing), [POINT, NORMAL].concat());
    }

    #[test]
    fn colours_and_intensities_are_no_normals() {
        let none = [POINT, [None; 3]].concat();
        let hue = |i: usize, k: f64| (i as f64 * k).sin().abs();
        let unit_colours = sample(0, |_, p| p.map(f64::abs).to_vec());
        assert_eq!(slots(&unit_colours), none);
        let colours = sample(0, |i, _| vec![hue(i, 1.0), hue(i, 2.0), hue(i, 3.0)]);
        assert_eq!(slots(&colours), none);
        let returns = sample(0, |i, _| vec![-1000.0 + i as f64, 1.0, 2.0]);
        assert_eq!(slots(&returns), none);
    }

    #[test]
    fn running_numbers_stand_before_the_coordinates() {
        let numbered = sample(1, |_, _| Vec::new());
        assert_eq!(slots(&numbered), [&[None][..], &POINT].concat());
        // Without a fourth column the first must be a coordinate.
        let mut three = sample(1, |_, _| Vec::new());
        three.values = three.rows().flat_map(|row| row[..3].to_vec()).collect();
        three.width = 3;
        assert_eq!(slots(&three), POINT);
    }
}
