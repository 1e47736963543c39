//! Point clouds and the formats they are read from.
//!
//! A file goes through [`read()`]: unpacked, its format recognised, its rows poured by one of the
//! readers into a `collector`, which holds the limits. Readers see bytes, not files. What meshes have
//! in common with clouds (headers, vertices, numbers) is read by the same code.

pub(super) mod binary;
mod cells;
mod collector;
pub(super) mod columns;
mod error;
mod foreign;
mod format;
mod labels;
mod layout;
mod names;
mod npy;
pub(super) mod obj;
pub(super) mod off;
mod pcd;
pub(super) mod ply;
mod precision;
pub(super) mod private;
mod ptx;
mod read;
mod roles;
mod shape;
pub(super) mod stl;
pub(super) mod text;
mod validate;
mod vtk;
mod write;
mod xyz;

use serde::{Deserialize, Serialize};

use super::space::{Frame, Space};
use super::vector::{Bounds, Vec3, multiplied};

pub use error::Error;
pub use format::Format;
pub use ply::MAX_HEADER_BYTES;
pub use private::{Cleaned, cleaned};
pub use read::{Found, Limits, Opened, Options, Source, identifiers, look, open, read, read_part};
pub(super) use read::{content, unpack};
pub use validate::MIN_POINTS;
pub(super) use validate::{MAX_COORDINATE, enough_points};
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

/// Number of points by label.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// On the surface.
    pub surface: usize,
    /// Inside.
    pub interior: usize,
    /// Outside.
    pub exterior: usize,
}

impl Label {
    /// Target of the field there: 0 on the surface, 1 inside, -1 outside (\[N24\] section 1).
    pub fn target(self) -> f64 {
        match self {
            Self::Surface => 0.0,
            Self::Interior => 1.0,
            Self::Exterior => -1.0,
        }
    }

    /// The label that a number in a file stands for: the reverse of [`Label::target`].
    fn from_number(number: f64) -> Option<Self> {
        [Self::Surface, Self::Interior, Self::Exterior]
            .into_iter()
            .find(|label| label.target().total_cmp(&(number + 0.0)).is_eq())
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
    /// What the coordinates mean, as far as the file says it.
    pub space: Space,
}

impl PointCloud {
    /// Label of point `i`; a point without one lies on the surface.
    pub fn label(&self, i: usize) -> Label {
        let labels = self.labels.as_ref();
        labels
            .and_then(|labels| labels.get(i).copied())
            .unwrap_or(Label::Surface)
    }

    /// Indices of the points with the given label, in order.
    pub fn indices(&self, label: Label) -> impl Iterator<Item = usize> + '_ {
        (0..self.points.len()).filter(move |&i| self.label(i) == label)
    }

    /// Number of points by label.
    pub fn counts(&self) -> Counts {
        let count = |label| self.indices(label).count();
        Counts {
            surface: count(Label::Surface),
            interior: count(Label::Interior),
            exterior: count(Label::Exterior),
        }
    }

    /// Smallest box around all points.
    pub fn bounds(&self) -> Option<Bounds> {
        Bounds::of(&self.points)
    }

    /// The cloud with one label for all its points.
    #[must_use]
    pub fn with_label(mut self, label: Label) -> Self {
        self.labels = Some(vec![label; self.points.len()]);
        self
    }

    /// The cloud in another frame; as it is where one of the two frames is unknown.
    #[must_use]
    pub fn in_frame(mut self, frame: Frame) -> Self {
        if frame != self.space.frame
            && let Some(factors) = self.space.frame.turn(frame)
        {
            for vector in self
                .points
                .iter_mut()
                .chain(self.normals.iter_mut().flatten())
            {
                *vector = multiplied(*vector, factors);
            }
            self.space.frame = frame;
        }
        self
    }

    /// Adds the points of `other` behind the own ones, turned into the own frame.
    ///
    /// Where only one cloud has normals, the points of the other get zeros, which stand for none;
    /// where only one has labels, the points of the other are surface points.
    pub fn append(&mut self, other: Self) {
        if self.points.is_empty() {
            *self = other;
            return;
        }
        if other.points.is_empty() {
            return;
        }
        let other = other.in_frame(self.space.frame);
        if self.normals.is_some() || other.normals.is_some() {
            let none = |count| vec![[0.0; 3]; count];
            let all = self.normals.get_or_insert_with(|| none(self.points.len()));
            all.extend(other.normals.unwrap_or_else(|| none(other.points.len())));
        }
        if self.labels.is_some() || other.labels.is_some() {
            let surface = |count| vec![Label::Surface; count];
            let all = self
                .labels
                .get_or_insert_with(|| surface(self.points.len()));
            all.extend(other.labels.unwrap_or_else(|| surface(other.points.len())));
        }
        self.points.extend(other.points);
    }
}
