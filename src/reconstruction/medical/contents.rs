//! What an opened file holds, as lists show it.

use serde::{Deserialize, Serialize};

use super::Affine;
use crate::reconstruction::Warning;
use crate::reconstruction::slices::Grid;
use crate::reconstruction::space::Space;
use crate::reconstruction::vector::{Bounds, Vec3};

/// Most characters of a name.
pub(super) const LONGEST_NAME: usize = 64;

/// What the parts of a file are called.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Values of voxels.
    Labels,
    /// Named segments, which may overlap.
    Segments,
    /// Regions of interest, drawn as contours.
    Rois,
}

/// A part of a file that one surface is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Item {
    /// Value of the label, or number of the segment or region.
    pub number: i64,
    /// Its name.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its colour as `#rrggbb`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub color: Option<String>,
    /// Voxels that belong to it; of contours there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub voxels: Option<u64>,
    /// Closed contours of it; label maps have none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contours: Option<u64>,
    /// Slices in which it is.
    pub slices: u64,
    /// Volume of its voxels, or of its contours over the distance of their planes.
    pub volume_mm3: f64,
}

/// The parts of a file that a surface can be made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parts {
    /// What they are called.
    pub kind: Kind,
    /// Each with its number, in the order of the file.
    pub items: Vec<Item>,
}

/// What a file holds, and how it lies in the patient.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Contents {
    /// The parts to choose from.
    #[serde(flatten)]
    pub parts: Parts,
    /// Voxels along the axes of the file; of contours there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 3]>,
    /// Distances of neighbours along the axes; of contours only the last is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spacing: Option<Vec3>,
    /// Where the axes of the file lead, as `RAS`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orientation: Option<String>,
    /// From the indices of voxels to the patient, where the slices are evenly spaced.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub affine: Option<Affine>,
    /// Whether the file does not say how it lies in the patient, and was taken as it is.
    pub assumed_orientation: bool,
    /// Frame and unit of the coordinates.
    #[serde(flatten)]
    pub space: Space,
    /// Smallest box around all voxels or contours.
    #[serde(skip)]
    pub bounds: Option<Bounds>,
    /// What the user should know.
    #[serde(skip)]
    pub warnings: Vec<Warning>,
}

impl Contents {
    /// Contents in millimetres of the patient, of which nothing else is known yet.
    pub(super) fn new(kind: Kind, items: Vec<Item>) -> Self {
        Self {
            parts: Parts { kind, items },
            size: None,
            spacing: None,
            orientation: None,
            affine: None,
            assumed_orientation: false,
            space: Space::PATIENT,
            bounds: None,
            warnings: Vec::new(),
        }
    }

    /// The same on a regular grid of voxels.
    pub(super) fn on_grid(mut self, size: [usize; 3], affine: Affine) -> Self {
        self.size = Some(size);
        self.spacing = Some(affine.spacing());
        self.orientation = Some(affine.letters());
        self.affine = Some(affine);
        self
    }

    /// The grid of its voxels, where there is a regular one.
    pub fn grid(&self) -> Option<Grid> {
        let (size, affine) = (self.size?, self.affine?);
        let [a, b, c] = affine.steps;
        let row = |i: usize| [a[i], b[i], c[i], affine.origin[i]];
        Some(Grid {
            size,
            affine: [row(0), row(1), row(2)],
        })
    }
}

/// A name as it is kept: one line of text of a bearable length; none if nothing is left.
pub(super) fn name(bytes: &[u8]) -> Option<String> {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        // Latin-1, in which every byte is a character.
        Err(_) => bytes.iter().map(|&b| char::from(b)).collect(),
    };
    let clean = text.chars().filter(|c| !c.is_control());
    let clean: String = clean.take(LONGEST_NAME).collect();
    let clean = clean.trim();
    (!clean.is_empty()).then(|| clean.to_owned())
}

/// A colour from shares of red, green and blue, 0 to 1.
pub(super) fn color(rgb: [f64; 3]) -> String {
    let [r, g, b] = rgb.map(|share| (share.clamp(0.0, 1.0) * 255.0).round() as u8);
    format!("#{r:02x}{g:02x}{b:02x}")
}
