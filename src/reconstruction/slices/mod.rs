//! Segmentations as slices: what label maps and contours have in common.
//!
//! A reader finds the geometry of a stack in the header of a file and then hands over one plane after
//! the other, so that memory does not grow with the volume.

mod area;
mod bands;
mod blur;
mod builder;
mod distance;
mod grid;
mod identifiers;
mod inside;
mod label_map;
mod lattice;
mod layers;
mod mask;
mod occupancy;
mod polygons;
mod priority;
mod runs;
mod sides;
mod slope;
mod summary;
mod thinning;
mod told;

#[cfg(test)]
mod tests;

use super::vector::Vec3;

pub use area::area;
pub use builder::{Builder, Record};
pub use grid::Grid;
pub use identifiers::Identifiers;
pub use inside::Inside;
pub use label_map::write_mask;
pub use occupancy::{Occupancy, Overlap};
pub use summary::{Face, Summary};

/// Where the slices of a stack lie, in millimetres of the patient (LPS: x to the left, y to the back,
/// z to the head).
///
/// Steps need not be orthogonal: a gantry tilt shears a stack.
#[derive(Debug, Clone, PartialEq)]
pub struct Geometry {
    /// Step from a pixel to the next one in its row.
    pub column: Vec3,
    /// Step from a row to the next one.
    pub row: Vec3,
    /// Centre of the first pixel of each slice that the file has or could have (a label map has them
    /// all, contours only those that they lie in), in order along the normal of the slices.
    pub origins: Vec<Vec3>,
}

/// What a slice shows of one label.
#[derive(Debug, Clone, PartialEq)]
pub struct Plane {
    /// Index of its origin in [`Geometry::origins`].
    pub slice: usize,
    /// The label's part of it.
    pub content: Content,
}

/// How a slice shows a label.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Pixels.
    Mask(Mask),
    /// Closed contours, in columns and rows from the slice's origin. A point is inside if it lies in
    /// an odd number of them.
    Polygons(Vec<Vec<[f64; 2]>>),
}

/// A rectangle of pixels around a label; all pixels outside are empty.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    /// Column of the first pixel in the slice.
    pub left: usize,
    /// Row of the first pixel in the slice.
    pub top: usize,
    /// Number of columns.
    pub width: usize,
    /// How much of each pixel the label fills, from 0 to 255, row by row.
    pub filled: Vec<u8>,
    /// Whether values between 0 and 255 mean anything, so that the slice needs no smoothing.
    pub fractional: bool,
    /// Columns and rows of the whole slice.
    pub slice_size: [usize; 2],
}

impl Mask {
    /// Pixels that are filled, parts added up.
    fn pixels(&self) -> f64 {
        if self.fractional {
            self.filled.iter().map(|&v| f64::from(v)).sum::<f64>() / 255.0
        } else {
            self.filled.iter().filter(|&&v| v > 0).count() as f64
        }
    }
}
