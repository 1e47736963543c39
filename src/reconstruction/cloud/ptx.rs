//! PTX: scans of a scanner, each a grid of points in its own frame with the way into the common one.
//!
//! Columns and rows of the grid, each alone in a line; place and axes of the scanner, four lines of
//! three numbers; a matrix of four lines of four, by which points are multiplied as rows; then one
//! line a point: x y z intensity, perhaps red green blue. Where nothing came back, x y z are zero.

use super::collector::{Collector, Row};
use super::text::{Line, Lines};
use super::{Error, Limits};
use crate::reconstruction::vector::Vec3;

/// A text of scans.
#[derive(Debug, Clone)]
pub(super) struct Scans<'a> {
    lines: Lines<'a>,
    first: Scan,
}

/// What stands above the points of a scan.
#[derive(Debug, Clone, Copy)]
struct Scan {
    points: u64,
    /// Rows of the matrix.
    matrix: [[f64; 4]; 4],
}

impl<'a> Scans<'a> {
    /// The scans of a text that begins as PTX does.
    pub(super) fn find(text: &'a [u8]) -> Option<Self> {
        let mut lines = Lines::new(text, 0);
        let first = Scan::read(&mut lines)?;
        Some(Self { lines, first })
    }

    /// Reads the points of all scans in the common frame.
    pub(super) fn read(mut self, limits: &Limits) -> Result<Collector<'_>, Error> {
        let mut collector = Collector::new(limits, false, false);
        let mut scan = Some(self.first);
        while let Some(Scan { points, matrix }) = scan {
            for found in 0..points {
                let Some(line) = self.lines.by_ref().find(|line| !line.is_blank()) else {
                    return Err(Error::Truncated {
                        what: "the scan".to_owned(),
                        declared: points,
                        found,
                    });
                };
                let point = line.vector(&mut line.tokens())?;
                collector.push(&row(point, &matrix), line.number)?;
            }
            let mut rest = self.lines.clone().content();
            scan = match rest.next() {
                None => None,
                Some(line) => Some(Scan::read(&mut self.lines).ok_or_else(|| {
                    line.error(format!(
                        "expected the header of another scan behind {points} points"
                    ))
                })?),
            };
        }
        Ok(collector)
    }
}

impl Scan {
    fn read(lines: &mut Lines<'_>) -> Option<Self> {
        let mut content = lines.by_ref().filter(|line| !line.is_blank());
        let count = |line: Line<'_>| {
            let [count] = numbers::<1>(line)?;
            (count >= 1.0 && count.fract() <= 0.0).then_some(count as u64)
        };
        let columns = count(content.next()?)?;
        let rows = count(content.next()?)?;
        for _ in 0..4 {
            numbers::<3>(content.next()?)?;
        }
        let mut matrix = [[0.0; 4]; 4];
        for row in &mut matrix {
            *row = numbers(content.next()?)?;
        }
        let points = columns.checked_mul(rows)?;
        Some(Self { points, matrix })
    }
}

/// The numbers of a line that holds that many and nothing else.
fn numbers<const N: usize>(line: Line<'_>) -> Option<[f64; N]> {
    let mut tokens = line.tokens();
    let mut numbers = [0.0; N];
    for number in &mut numbers {
        *number = line.number(tokens.next()?).ok()?;
    }
    tokens.next().is_none().then_some(numbers)
}

/// The point in the common frame; without a return it is nowhere.
fn row(point: Vec3, matrix: &[[f64; 4]; 4]) -> Row {
    let mut row = [0.0; 7];
    let nowhere = point.iter().all(|&v| v.abs() <= 0.0);
    for (axis, value) in row[..3].iter_mut().enumerate() {
        let moved = (0..3).map(|i| point[i] * matrix[i][axis]).sum::<f64>() + matrix[3][axis];
        *value = if nowhere { f64::NAN } else { moved };
    }
    row
}
