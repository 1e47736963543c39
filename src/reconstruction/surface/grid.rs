//! The regular grid on which a field is sampled, and its points numbered with a frame around them.

use crate::reconstruction::error::Error;
use crate::reconstruction::vector::{Bounds, Vec3};

/// A regular grid of cubic cells.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grid {
    /// The point with the smallest coordinates.
    pub origin: Vec3,
    /// Edge length of a cell.
    pub spacing: f64,
    /// Points along each axis, at least 2.
    pub points: [usize; 3],
}

impl Grid {
    /// The grid over `bounds` with `resolution` points along the longest edge.
    ///
    /// Along the other axes it is as long as covers the box, and centred on it.
    ///
    /// # Errors
    /// [`Error::NoSurface`] where the box has no length or the spacing would be lost to rounding.
    pub fn new(bounds: &Bounds, resolution: usize) -> Result<Self, Error> {
        let resolution = resolution.max(2);
        let centre = bounds.centre();
        let spacing = bounds.longest_edge() / (resolution - 1) as f64;
        let largest = centre.into_iter().fold(0.0, |m: f64, c| m.max(c.abs()));
        // A thousand representable numbers to a cell: fewer, and vertices of a cell fall together.
        let smallest = (1e3 * f64::EPSILON * largest).max(f64::MIN_POSITIVE);
        if !(spacing.is_finite() && largest.is_finite() && spacing > smallest) {
            return Err(Error::NoSurface(format!(
                "the box from {:?} to {:?} is too small or too far out for a grid; choose \
                 sampling.frame normalized",
                bounds.min, bounds.max
            )));
        }
        // A share of a cell that rounding may add must not add a layer of points.
        let points = bounds
            .extent()
            .map(|length| ((length / spacing - 1e-9).ceil().max(1.0) as usize + 1).min(resolution));
        let origin = std::array::from_fn(|a| centre[a] - 0.5 * spacing * (points[a] - 1) as f64);
        Ok(Self {
            origin,
            spacing,
            points,
        })
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.points.iter().product()
    }

    /// Whether there is no point; never so for a grid from [`Grid::new`].
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// The points of a grid and one layer of points around them, numbered with x running fastest.
///
/// The layer, the frame, is where the field is taken as outside: a surface that would leave the
/// grid closes between its last points and the frame. Coordinates are counted from the frame, so
/// the points of the grid are 1 to `size - 2`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    pub(super) grid: Grid,
    pub(super) size: [usize; 3],
    pub(super) strides: [usize; 3],
}

impl Lattice {
    pub(super) fn new(grid: Grid) -> Self {
        let size = grid.points.map(|n| n + 2);
        Self {
            grid,
            size,
            strides: [1, size[0], size[0] * size[1]],
        }
    }

    pub(super) fn len(&self) -> usize {
        self.size.iter().product()
    }

    pub(super) fn index(&self, at: [usize; 3]) -> usize {
        at[0] + at[1] * self.strides[1] + at[2] * self.strides[2]
    }

    pub(super) fn coordinates(&self, index: usize) -> [usize; 3] {
        let in_layer = index % self.strides[2];
        [
            in_layer % self.size[0],
            in_layer / self.size[0],
            index / self.strides[2],
        ]
    }

    /// Whether the coordinate `at` along `axis` belongs to the frame.
    pub(super) fn is_frame(&self, axis: usize, at: usize) -> bool {
        at == 0 || at + 1 == self.size[axis]
    }

    /// The one expression for positions, so that every way to a point gives the same bits.
    pub(super) fn position(&self, at: [usize; 3]) -> Vec3 {
        std::array::from_fn(|a| self.grid.origin[a] + (at[a] as f64 - 1.0) * self.grid.spacing)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covers_the_box_with_cubic_cells() {
        let bounds = Bounds {
            min: [-1.0, 2.0, 0.0],
            max: [1.0, 3.03, 0.0],
        };
        let grid = Grid::new(&bounds, 11).unwrap();
        assert_eq!(grid.points, [11, 7, 2]);
        let lattice = Lattice::new(grid);
        let first = lattice.position([1; 3]);
        let last = lattice.position(grid.points);
        for a in 0..3 {
            assert!(first[a] <= bounds.min[a] + 1e-12, "rounding of the origin");
            assert!(last[a] >= bounds.max[a] - 1e-12, "rounding of the origin");
        }
        for index in [0, 5, 77, lattice.len() - 1] {
            assert_eq!(lattice.index(lattice.coordinates(index)), index);
        }
    }

    #[test]
    fn refuses_a_box_without_length() {
        for (min, max) in [
            (1.0, 1.0),
            (f64::NAN, 1.0),
            (0.0, f64::INFINITY),
            (1e30, 1e30),
        ] {
            let bounds = Bounds {
                min: [min; 3],
                max: [max; 3],
            };
            assert!(matches!(Grid::new(&bounds, 64), Err(Error::NoSurface(_))));
        }
    }
}
