//! Label maps: regular grids of values, as NIfTI, NRRD and MetaImage have them.

use std::borrow::Cow;
use std::io::Read;

use super::contents::{Contents, Item, Kind};
use super::tally::{MOST_LABELS, Tally, label};
use super::{Affine, Reading, Segmentation, Source, bounds};
use crate::reconstruction::Warning;
use crate::reconstruction::cloud::Error;
use crate::reconstruction::cloud::binary::{ByteOrder, Scalar, enough};
use crate::reconstruction::slices::{Content, Geometry, Mask};
use crate::reconstruction::vector::{Vec3, along, cross, dot};

/// Edges of voxels count as equal within this share: the file's own slices are kept then.
const EQUAL_EDGES: f64 = 1.01;

/// How the values of a grid lie in bytes.
#[derive(Debug)]
pub(super) struct Raster<'a> {
    /// All values, in the order of the file.
    pub(super) data: Cow<'a, [u8]>,
    pub(super) scalar: Scalar,
    pub(super) order: ByteOrder,
    /// `slope * value + intercept` is what a value means.
    pub(super) slope: f64,
    pub(super) intercept: f64,
    /// Voxels along the axes.
    pub(super) size: [usize; 3],
    /// Values from a voxel to the next one along the axes.
    pub(super) strides: [usize; 3],
    /// Label maps on the same grid, and values from one to the next.
    pub(super) layers: [usize; 2],
    pub(super) affine: Affine,
}

/// A segment that a header describes.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Described {
    pub(super) name: Option<String>,
    pub(super) color: Option<String>,
    pub(super) layer: usize,
    pub(super) value: i64,
}

/// Number of values of a grid, checked against the bytes that are there.
///
/// # Errors
/// [`Error::Header`] for a grid without voxels, [`Error::Truncated`] for one that is not all there.
pub(super) fn values(size: &[usize], scalar: Scalar, available: usize) -> Result<usize, Error> {
    let count = size
        .iter()
        .try_fold(1_usize, |n, &count| n.checked_mul(count));
    let count = count.unwrap_or(usize::MAX);
    if count == 0 {
        return Err(super::affine::header("the size of an axis is zero"));
    }
    enough("the values of the voxels", count, scalar.size(), available)?;
    Ok(count)
}

/// What a stream unpacks to, as far as the sizes ask for it.
///
/// # Errors
/// [`Error::ExpandsTooFar`], [`Error::Compression`].
pub(super) fn unpacked(
    stream: impl Read,
    size: &[usize],
    scalar: Scalar,
    reading: &Reading,
) -> Result<Vec<u8>, Error> {
    let limit = reading.max_expanded_bytes;
    let length = values(size, scalar, limit).map_err(|error| match error {
        Error::Truncated { .. } => Error::ExpandsTooFar { limit },
        other => other,
    })? * scalar.size();
    let mut unpacked = Vec::new();
    stream
        .take(length as u64)
        .read_to_end(&mut unpacked)
        .map_err(|error| Error::Compression(format!("the data are damaged ({error})")))?;
    Ok(unpacked)
}

impl<'a> Raster<'a> {
    fn value(&self, layer: usize, index: [usize; 3]) -> f64 {
        let [i, j, k] = index;
        let [x, y, z] = self.strides;
        let at = layer * self.layers[1] + i * x + j * y + k * z;
        let bytes = self.data.get(at * self.scalar.size()..);
        let value = bytes.and_then(|bytes| self.scalar.read(self.order, bytes));
        self.slope * value.unwrap_or(0.0) + self.intercept
    }

    /// Counts the labels and opens the grid; what a header describes gets its name.
    ///
    /// # Errors
    /// [`Error::UnsupportedFormat`] for an image, [`Error::Slices`] where nothing is labelled.
    pub(super) fn open(
        self,
        described: &[Described],
        mut warnings: Vec<Warning>,
    ) -> Result<Segmentation<'a>, Error> {
        let axes = Axes::of(&self.affine);
        let size = axes.of_slices(self.size);
        let mut found = Vec::new();
        let (mut shares, mut not_finite) = (Vec::new(), 0);
        for layer in 0..self.layers[0] {
            let mut tally = Tally::default();
            for slice in 0..size[2] {
                let rows =
                    (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| [column, row]));
                let at = |[column, row]: [usize; 2]| {
                    self.value(layer, axes.of_file([column, row, slice]))
                };
                tally.slice(slice, rows.map(at))?;
            }
            not_finite += tally.not_finite;
            let (counts, are_shares) = tally.finish()?;
            shares.push(are_shares);
            found.extend(
                counts
                    .into_iter()
                    .map(|(value, count)| (layer, value, count)),
            );
            if found.len() > MOST_LABELS {
                let detail = format!("the layers hold more than {MOST_LABELS} labels in all");
                return Err(Error::UnsupportedFormat(detail));
            }
        }
        if not_finite > 0 {
            let message = format!("{not_finite} voxels have no value and count as background");
            warnings.push(Warning::new("voxels_not_finite", message));
        }
        let volume = self.affine.voxel_volume();
        let mut parts = Vec::new();
        let mut items = Vec::new();
        let mut add = |number, described: Option<&Described>, part: (usize, i64)| {
            let count = found
                .iter()
                .find(|&&(layer, value, _)| (layer, value) == part);
            let count = count.map(|&(_, _, count)| count).unwrap_or_default();
            parts.push(part);
            items.push(Item {
                number,
                name: described.and_then(|described| described.name.clone()),
                color: described.and_then(|described| described.color.clone()),
                voxels: Some(count.voxels),
                contours: None,
                slices: count.slices,
                volume_mm3: count.voxels as f64 * volume,
            });
        };
        let in_one_layer = self.layers[0] == 1;
        for (index, described) in described.iter().enumerate() {
            // The value is the number as long as it says which segment it is.
            let number = if in_one_layer {
                described.value
            } else {
                index as i64 + 1
            };
            add(number, Some(described), (described.layer, described.value));
        }
        let mut next = described.len() as i64;
        for &(layer, value, _) in &found {
            if !described
                .iter()
                .any(|d| (d.layer, d.value) == (layer, value))
            {
                next += 1;
                add(
                    if in_one_layer { value } else { next },
                    None,
                    (layer, value),
                );
            }
        }
        if items.iter().all(|item| item.slices == 0) {
            return Err(Error::Slices("no voxel has a label".to_owned()));
        }
        let kind = if described.is_empty() {
            Kind::Labels
        } else {
            Kind::Segments
        };
        let mut contents = Contents::new(kind, items).on_grid(self.size, self.affine);
        contents.warnings = warnings;
        let grid = Grid {
            raster: self,
            axes,
            parts,
            shares,
        };
        contents.bounds = bounds(&grid.geometry(0), [size[0], size[1]]);
        Ok(Segmentation::new(contents, grid))
    }
}

/// Which axis of the file is which of a slice.
#[derive(Debug, Clone, Copy)]
struct Axes {
    /// Those of columns, of rows and of slices.
    order: [usize; 3],
}

impl Axes {
    /// Slices lie across the longest edge of a voxel: between them is the least known.
    fn of(affine: &Affine) -> Self {
        let spacing = affine.spacing();
        let longest = spacing.into_iter().fold(0.0, f64::max);
        let slices = (0..3)
            .rev()
            .find(|&axis| spacing[axis] * EQUAL_EDGES >= longest);
        let order = match slices {
            Some(0) => [1, 2, 0],
            Some(1) => [0, 2, 1],
            _ => [0, 1, 2],
        };
        Self { order }
    }

    /// Sizes in the order of a slice.
    fn of_slices(&self, size: [usize; 3]) -> [usize; 3] {
        self.order.map(|axis| size[axis])
    }

    /// The index in the file of a column, row and slice.
    fn of_file(&self, index: [usize; 3]) -> [usize; 3] {
        let mut of_file = [0; 3];
        for (axis, i) in self.order.into_iter().zip(index) {
            of_file[axis] = i;
        }
        of_file
    }
}

/// A label map that was opened.
#[derive(Debug)]
struct Grid<'a> {
    raster: Raster<'a>,
    axes: Axes,
    /// Layer and value of each item.
    parts: Vec<(usize, i64)>,
    /// Of each layer, whether its values are shares of its one label.
    shares: Vec<bool>,
}

impl Grid<'_> {
    /// Steps along columns, rows and slices.
    fn steps(&self) -> [Vec3; 3] {
        self.axes.order.map(|axis| self.raster.affine.steps[axis])
    }

    /// Whether the slices of the file come against the normal of their columns and rows.
    fn falls(&self) -> bool {
        let [column, row, slice] = self.steps();
        dot(cross(column, row), slice) < 0.0
    }
}

impl Source for Grid<'_> {
    fn geometry(&self, _: usize) -> Geometry {
        let [column, row, slice] = self.steps();
        let count = self.axes.of_slices(self.raster.size)[2];
        let origin = |i: usize| along(self.raster.affine.origin, i as f64, slice);
        let mut origins: Vec<Vec3> = (0..count).map(origin).collect();
        if self.falls() {
            origins.reverse();
        }
        Geometry {
            column,
            row,
            origins,
        }
    }

    fn content(&self, item: usize, slice: usize) -> Option<Content> {
        let (layer, value) = self.parts[item];
        let [columns, rows, slices] = self.axes.of_slices(self.raster.size);
        let slice = if self.falls() {
            slices - 1 - slice
        } else {
            slice
        };
        let at = |column, row| {
            self.raster
                .value(layer, self.axes.of_file([column, row, slice]))
        };
        let mask = if self.shares[layer] {
            mask([columns, rows], true, |column, row| {
                let share = at(column, row);
                (share.clamp(0.0, 1.0) * 255.0).round() as u8
            })
        } else {
            mask([columns, rows], false, |column, row| {
                if label(at(column, row)) == Some(value) {
                    u8::MAX
                } else {
                    0
                }
            })
        };
        mask.map(Content::Mask)
    }
}

/// The smallest rectangle around what is filled; `None` where nothing is.
pub(super) fn mask(
    size: [usize; 2],
    fractional: bool,
    filled: impl Fn(usize, usize) -> u8,
) -> Option<Mask> {
    let [columns, rows] = size;
    let mut left = columns;
    let (mut right, mut top, mut bottom) = (0, rows, 0);
    for row in 0..rows {
        let first = (0..columns).find(|&column| filled(column, row) > 0);
        let Some(first) = first else { continue };
        let last = (first..columns)
            .rev()
            .find(|&column| filled(column, row) > 0);
        left = left.min(first);
        right = right.max(last.unwrap_or(first) + 1);
        top = top.min(row);
        bottom = row + 1;
    }
    if left >= right {
        return None;
    }
    let inside = (top..bottom).flat_map(|row| (left..right).map(move |column| (column, row)));
    Some(Mask {
        left,
        top,
        width: right - left,
        filled: inside.map(|(column, row)| filled(column, row)).collect(),
        fractional,
        slice_size: size,
    })
}
