//! Point clouds and the formats they are read from.

mod error;
mod write;

use serde::{Deserialize, Serialize};

use super::vector::{Bounds, Vec3};

pub use error::Error;
pub use write::{write_ply, write_xyz};

/// Where a point lies, as the user says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Label {
    /// On the surface.
    Surface,
    /// Inside.
    Interior,
    /// Outside.
    Exterior,
}

impl Label {
    /// Target of the field there: 0 on the surface, 1 inside, -1 outside ([N24] section 1).
    pub fn target(self) -> f64 {
        match self {
            Self::Surface => 0.0,
            Self::Interior => 1.0,
            Self::Exterior => -1.0,
        }
    }
}

/// Points as they were given, in the units of their file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PointCloud {
    /// Coordinates; finite.
    pub points: Vec<Vec3>,
    /// One normal a point, as given (neither checked nor scaled); outward by convention.
    pub normals: Option<Vec<Vec3>>,
    /// One label a point; without them every point is a surface point.
    pub labels: Option<Vec<Label>>,
}

impl PointCloud {
    /// Label of point `i`.
    pub fn label(&self, i: usize) -> Label {
        self.labels
            .as_ref()
            .map_or(Label::Surface, |labels| labels[i])
    }

    /// Indices of the points with the given label, in order.
    pub fn indices(&self, label: Label) -> impl Iterator<Item = usize> + '_ {
        (0..self.points.len()).filter(move |&i| self.label(i) == label)
    }

    /// Smallest box around all points.
    pub fn bounds(&self) -> Option<Bounds> {
        Bounds::of(&self.points)
    }
}
