//! What was done with slices, and what of the surface is invented.

use serde::{Deserialize, Serialize};

use super::Mask;
use crate::reconstruction::observer::Warning;

/// A face of the volume that a file covers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Face {
    /// Where columns begin.
    FirstColumn,
    /// Where columns end.
    LastColumn,
    /// Where rows begin.
    FirstRow,
    /// Where rows end.
    LastRow,
    /// Where slices begin.
    FirstSlice,
    /// Where slices end.
    LastSlice,
}

impl Face {
    /// Its name in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::FirstColumn => "first column",
            Self::LastColumn => "last column",
            Self::FirstRow => "first row",
            Self::LastRow => "last row",
            Self::FirstSlice => "first slice",
            Self::LastSlice => "last slice",
        }
    }

    /// The faces in the plane of a slice that its label touches.
    pub(super) fn touched(mask: &Mask) -> Vec<Self> {
        let width = mask.width.max(1);
        let height = mask.filled.len() / width;
        let [columns, rows] = mask.slice_size;
        let filled = |x: usize, y: usize| mask.filled[y * width + x] > 0;
        let column = |x: usize| (0..height).any(|y| filled(x, y));
        let row = |y: usize| (0..mask.width).any(|x| filled(x, y));
        [
            (Self::FirstColumn, mask.left == 0 && column(0)),
            (
                Self::LastColumn,
                mask.left + width == columns && column(width - 1),
            ),
            (Self::FirstRow, mask.top == 0 && height > 0 && row(0)),
            (
                Self::LastRow,
                height > 0 && mask.top + height == rows && row(height - 1),
            ),
        ]
        .into_iter()
        .filter_map(|(face, touched)| touched.then_some(face))
        .collect()
    }
}

/// How a cloud was made from slices; lengths in millimetres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Slices that show the label and were used.
    pub slices: usize,
    /// Usual distance between them.
    pub slice_distance: f64,
    /// Length of a column and of a row.
    pub pixel_size: [f64; 2],
    /// Pixels that the label fills, fractions added up; none of contours.
    pub voxels: Option<f64>,
    /// Volume of the label slice by slice: its area in each times the thickness that the slice stands for.
    pub volume: f64,
    /// Points on its contours.
    pub contour_points: usize,
    /// Distance that the points which were kept of them have from each other at least.
    pub thinning_radius: f64,
    /// How many were kept: the surface points of the cloud.
    pub surface_points: usize,
    /// Places labelled interior.
    pub interior_points: usize,
    /// Places labelled exterior.
    pub exterior_points: usize,
    /// How many slices of the file stand for one slice of the data; 1 unless slices were repeated.
    pub slices_repeated: usize,
    /// Gaps in the stack where slices are missing.
    pub gaps: usize,
    /// Contours of fewer than three points, which were ignored.
    pub contours_ignored: usize,
    /// Faces of the volume that the label touches: the surface there is invented.
    pub invented_at: Vec<Face>,
}

impl Summary {
    /// What the user should know of the slices.
    pub(super) fn warnings(&self) -> Vec<Warning> {
        let mut warnings = Vec::new();
        if !self.invented_at.is_empty() {
            let faces: Vec<&str> = self.invented_at.iter().map(|face| face.words()).collect();
            warnings.push(Warning::new(
                "label_touches_border",
                format!(
                    "the label reaches the border of the volume ({}); the surface there is invented",
                    faces.join(", ")
                ),
            ));
        }
        if self.gaps > 0 {
            warnings.push(Warning::new(
                "slices_missing",
                format!(
                    "slices are missing in {} place(s) between slices that show the label; the surface is \
                     interpolated there",
                    self.gaps
                ),
            ));
        }
        if self.slices_repeated > 1 {
            warnings.push(Warning::new(
                "slices_repeated",
                format!(
                    "slices come in runs of about {} identical ones, as in an upsampled map; the middle of each run \
                     is used",
                    self.slices_repeated
                ),
            ));
        }
        if self.contours_ignored > 0 {
            warnings.push(Warning::new(
                "contours_ignored",
                format!(
                    "{} contour(s) of fewer than three points were ignored",
                    self.contours_ignored
                ),
            ));
        }
        warnings
    }
}
