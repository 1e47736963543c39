//! Segmentations from medical imaging: label maps, segments and contours, as files bring them.
//!
//! A file is opened once: its header is checked against the bytes that are there, its labels are
//! counted. Then the slices of one label are handed over one after the other, so that beside the
//! bytes of the file no volume is ever in memory. Positions are millimetres of the patient (LPS).

mod affine;
mod choice;
mod contents;
mod dicom;
mod metaimage;
mod nifti;
mod nrrd;
mod private;
mod raster;
mod tally;

use std::fmt;

use super::slices::{Content, Geometry, Plane};
use super::vector::{Bounds, Vec3, add, scale};

pub use affine::Affine;
pub use choice::Choice;
pub use contents::{Contents, Item, Kind, Parts};

pub(super) use dicom::{clean as clean_dicom, identifiers, is_dicom, read as dicom};
pub(super) use metaimage::{is_metaimage, read as metaimage};
pub(super) use nifti::{is_nifti, read as nifti};
pub(super) use nrrd::{is_nrrd, read as nrrd};
pub(super) use private::{texts_of_metaimage, texts_of_nifti, texts_of_nrrd};

/// How a file is to be understood where it leaves something open.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// Takes a file that does not say how it lies in the patient as it lies in its own axes.
    pub assume_orientation: bool,
    /// Most bytes that what is packed inside of the file may expand to.
    pub max_expanded_bytes: usize,
}

/// Where the slices come from.
trait Source: fmt::Debug {
    /// Where the slices of an item lie.
    fn geometry(&self, item: usize) -> Geometry;

    /// What a slice shows of an item; `None` where that is nothing.
    fn content(&self, item: usize, slice: usize) -> Option<Content>;
}

/// An opened file.
#[derive(Debug)]
pub struct Segmentation<'a> {
    contents: Box<Contents>,
    source: Box<dyn Source + 'a>,
}

impl<'a> Segmentation<'a> {
    fn new(contents: Contents, source: impl Source + 'a) -> Self {
        Self {
            contents: Box::new(contents),
            source: Box::new(source),
        }
    }

    /// What there is in the file.
    pub fn contents(&self) -> &Contents {
        &self.contents
    }

    /// Where the slices of an item lie.
    pub fn geometry(&self, item: usize) -> Geometry {
        self.source.geometry(item)
    }

    /// The slices in which an item is, in order.
    pub fn planes(&self, item: usize) -> impl Iterator<Item = Plane> + '_ {
        let slices = self.geometry(item).origins.len();
        (0..slices).filter_map(move |slice| {
            let content = self.source.content(item, slice)?;
            Some(Plane { slice, content })
        })
    }
}

/// The smallest box around the first and the last pixels of all slices.
fn bounds(geometry: &Geometry, size: [usize; 2]) -> Option<Bounds> {
    let [last_column, last_row] = size.map(|count| count.saturating_sub(1) as f64);
    let across: [Vec3; 4] = [
        [0.0; 3],
        scale(geometry.column, last_column),
        scale(geometry.row, last_row),
        add(
            scale(geometry.column, last_column),
            scale(geometry.row, last_row),
        ),
    ];
    let ends = geometry.origins.first().into_iter();
    let corners: Vec<Vec3> = ends
        .chain(geometry.origins.last())
        .flat_map(|&origin| across.map(|step| add(origin, step)))
        .collect();
    Bounds::of(&corners)
}
