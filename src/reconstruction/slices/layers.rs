//! What a stack of slices is in space, and what is known of each slice that shows the label.

use std::ops::RangeInclusive;

use super::super::vector::{Vec3, along, cross, dot, norm, normalized, sub};
use super::lattice::{Lattice, margin};
use super::polygons::Contours;
use super::{Content, Geometry, mask};
use crate::reconstruction::cloud::Error;

/// Distance between slices, over the usual one, from which on slices are missing in between.
pub(super) const GAP: f64 = 1.5;

/// Pixels that contour points keep from each other, for they are right to a tenth of one only.
const LEAST_PIXELS: f64 = 1.2;

/// Slice distances that contour points keep from each other, so that they are about as even across the slices, which
/// few surfaces cross at right angles everywhere, as along them.
const LEAST_SLICES: f64 = 0.35;

/// Slice distances from the contours up to which places tell a side.
const REACH: f64 = 2.0;

/// A stack of slices in space.
#[derive(Debug, Clone)]
pub(super) struct Stack {
    geometry: Geometry,
    /// Unit vector across the slices.
    normal: Vec3,
    /// Usual distance between slices, in millimetres.
    pub(super) distance: f64,
    /// Length of a column and of a row, in millimetres.
    pub(super) pixel: [f64; 2],
}

impl Stack {
    /// Checks that the slices lie one above the other.
    pub(super) fn new(geometry: &Geometry) -> Result<Self, Error> {
        let refuse = |detail: &str| Err(Error::Slices(detail.to_owned()));
        let Some(normal) = normalized(cross(geometry.column, geometry.row)) else {
            return refuse("columns and rows run the same way");
        };
        if geometry.origins.len() < 2 {
            return refuse("there is only one slice; a surface needs the slices beside it as well");
        }
        let heights: Vec<f64> = geometry.origins.iter().map(|&o| dot(o, normal)).collect();
        let mut steps: Vec<f64> = heights.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let ordered = steps.iter().all(|&s| s > 0.0) || steps.iter().all(|&s| s < 0.0);
        if !ordered || heights.iter().any(|height| !height.is_finite()) {
            return refuse("the slices are not in order along their normal");
        }
        let middle = steps.len() / 2;
        let distance = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        Ok(Self {
            normal,
            distance: distance.abs(),
            pixel: [norm(geometry.column), norm(geometry.row)],
            geometry: geometry.clone(),
        })
    }

    /// Number of slices.
    pub(super) fn slices(&self) -> usize {
        self.geometry.origins.len()
    }

    /// Area of a pixel.
    pub(super) fn pixel_area(&self) -> f64 {
        norm(cross(self.geometry.column, self.geometry.row))
    }

    /// How far points keep from each other where slices are `distance` apart.
    pub(super) fn radius(&self, distance: f64) -> f64 {
        let pixel = self.pixel[0].max(self.pixel[1]);
        (LEAST_SLICES * distance).max(LEAST_PIXELS * pixel)
    }

    /// Distance from the contours up to which places tell a side.
    pub(super) fn reach(&self) -> f64 {
        REACH * self.distance
    }

    /// The point at a column and row of a slice; between and beyond slices, slices are thought of.
    pub(super) fn point(&self, place: [f64; 2], slice: f64) -> Vec3 {
        let in_row = along(self.origin(slice), place[0], self.geometry.column);
        along(in_row, place[1], self.geometry.row)
    }

    /// Height of a slice along the normal.
    pub(super) fn height(&self, slice: f64) -> f64 {
        dot(self.origin(slice), self.normal)
    }

    /// How much of the stack a slice stands for: half the way to either neighbour, but not into gaps.
    pub(super) fn thickness(&self, slice: usize) -> f64 {
        let here = self.height(slice as f64);
        let half = |there: f64| {
            let away = (self.height(there) - here).abs();
            0.5 * if away > GAP * self.distance {
                self.distance
            } else {
                away
            }
        };
        half(slice as f64 - 1.0) + half(slice as f64 + 1.0)
    }

    fn origin(&self, slice: f64) -> Vec3 {
        let origins = &self.geometry.origins;
        let from = (slice.floor().max(0.0) as usize).min(origins.len() - 2);
        let way = sub(origins[from + 1], origins[from]);
        let share = slice - from as f64;
        if (0.0..=1.0).contains(&share) {
            return along(origins[from], share, way);
        }
        // Beyond the ends slices go on at the usual distance.
        let (end, beyond) = if share < 0.0 {
            (origins[from], share)
        } else {
            (origins[from + 1], share - 1.0)
        };
        let usual = self.distance / dot(way, self.normal).abs();
        along(end, beyond * usual, way)
    }
}

/// Identical slices that show the label, one above the other; mostly a single one.
#[derive(Debug, Clone)]
pub(super) struct Layer {
    /// Its slices.
    pub(super) slices: RangeInclusive<usize>,
    /// Points of the contours, in columns and rows.
    pub(super) contour: Vec<[f64; 2]>,
    /// The pixels around them.
    pub(super) lattice: Lattice,
}

impl Layer {
    /// The layer that a slice begins; none where it shows nothing.
    pub(super) fn new(slice: usize, content: &Content, stack: &Stack) -> Option<Self> {
        let pixel = stack.pixel;
        let wide = margin(stack.reach(), pixel[0].min(pixel[1]));
        let (contour, lattice) = match content {
            Content::Mask(mask) => mask::contours(mask, wide, pixel),
            Content::Polygons(polygons) => {
                let contours = Contours::new(polygons);
                if contours.is_empty() {
                    return None;
                }
                let spacing = 0.25 * stack.radius(stack.distance);
                (
                    contours.points(spacing, pixel),
                    contours.lattice(wide, pixel),
                )
            }
        };
        (!contour.is_empty()).then_some(Self {
            slices: slice..=slice,
            contour,
            lattice,
        })
    }

    /// The middle of its slices.
    pub(super) fn middle(&self) -> f64 {
        0.5 * (*self.slices.start() + *self.slices.end()) as f64
    }

    /// Number of its slices.
    pub(super) fn count(&self) -> usize {
        self.slices.end() - self.slices.start() + 1
    }
}
