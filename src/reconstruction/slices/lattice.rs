//! The pixels around a label in one slice: which are inside, and how far they are from its contours.

use super::distance;

/// Most pixels of the margin on either side.
const MAX_MARGIN: usize = 64;

/// Pixels in rows and columns.
#[derive(Debug, Clone)]
pub(super) struct Lattice {
    /// Column and row of the first pixel, from the slice's origin.
    pub(super) first: [f64; 2],
    /// Columns and rows from a pixel to the next: 1 unless contours are very large.
    pub(super) step: f64,
    /// Number of columns.
    pub(super) width: usize,
    /// Whether each pixel is inside, row by row.
    pub(super) inside: Vec<bool>,
    /// Distance of each pixel from the contours, about, in millimetres.
    pub(super) distances: Vec<f32>,
}

impl Lattice {
    /// Measures the distances; `pixel` is the size of a step in columns and rows of 1.
    pub(super) fn new(
        first: [f64; 2],
        step: f64,
        width: usize,
        inside: Vec<bool>,
        pixel: [f64; 2],
    ) -> Self {
        let steps = pixel.map(|length| length * step);
        let mut distances = distance::to_other_side(&inside, width, steps);
        // The contour runs half way between the centres of pixels on either side.
        let half = 0.25 * (steps[0] + steps[1]) as f32;
        for distance in &mut distances {
            *distance -= half;
        }
        Self {
            first,
            step,
            width,
            inside,
            distances,
        }
    }

    /// Column and row of pixel `i`.
    pub(super) fn place(&self, i: usize) -> [f64; 2] {
        [
            self.first[0] + self.step * (i % self.width) as f64,
            self.first[1] + self.step * (i / self.width) as f64,
        ]
    }

    /// The pixel at a column and row; none beyond the lattice, where all is outside and far.
    pub(super) fn at(&self, place: [f64; 2]) -> Option<usize> {
        let [x, y] = [0, 1].map(|axis| ((place[axis] - self.first[axis]) / self.step).round());
        let height = self.inside.len() / self.width.max(1);
        let there = x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < height as f64;
        there.then(|| y as usize * self.width + x as usize)
    }

    /// Whether a column and row lie inside.
    pub(super) fn contains(&self, place: [f64; 2]) -> bool {
        self.at(place).is_some_and(|i| self.inside[i])
    }

    /// Number of pixels inside, in pixels of 1 by 1.
    pub(super) fn filled(&self) -> f64 {
        let count = self.inside.iter().filter(|&&inside| inside).count();
        count as f64 * self.step * self.step
    }

    /// Whether the smaller one of two labels lies over the other by half or more.
    pub(super) fn overlaps(&self, other: &Self) -> bool {
        let common = (0..self.inside.len())
            .filter(|&i| self.inside[i] && other.contains(self.place(i)))
            .count() as f64;
        common * self.step * self.step >= 0.5 * self.filled().min(other.filled())
    }
}

/// Pixels of length `pixel` to add on either side so that places up to `reach` from the label have one.
pub(super) fn margin(reach: f64, pixel: f64) -> usize {
    ((reach / pixel).ceil().min(MAX_MARGIN as f64) as usize).max(2)
}
