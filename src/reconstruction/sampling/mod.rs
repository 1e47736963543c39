//! From points to training samples: frame, normals, winding number, off-surface samples, hold-out.
//!
//! [`prepare()`] is the whole room. It works in the unit frame; what it knows about the surface (which
//! way is out, which side a place is on) comes from all its points, what is trained on from an even
//! subset within the budget.

mod body;
mod evenness;
pub mod frame;
mod given;
pub mod jets;
mod lattice;
pub mod neighbours;
pub mod normals;
pub mod orientation;
pub mod oriented;
mod prepare;
pub mod samples;
pub mod selection;
mod sides;
mod solid;
mod stairs;
mod strays;
mod told;
mod uncertainty;
pub mod winding;
mod working;

use serde::{Deserialize, Serialize};

use super::cloud::{Label, PointCloud};
use super::observer::Warning;
use super::vector::Vec3;

pub use frame::Frame;
pub use normals::NormalSource;
pub(super) use orientation::MANY;
pub use prepare::prepare;
pub(super) use prepare::{Scan, held_out_share, scan};
pub(super) use solid::boundary;
pub use uncertainty::Uncertainty;
pub(super) use working::MAX_WORKING_POINTS;

/// Points with targets and weights of the least-squares fit, in the frame of training.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Samples {
    /// Positions, `[n, 3]`.
    pub points: Vec<Vec3>,
    /// Targets, `[n]`.
    pub targets: Vec<f64>,
    /// Weights, `[n]`; 1 in \[N24\].
    pub weights: Vec<f64>,
    /// Whether f may go beyond the target, away from 0, at no cost, `[n]`; never in \[N24\].
    pub one_sided: Vec<bool>,
}

impl Samples {
    /// Number of samples.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// Puts `other` behind these.
    pub fn append(&mut self, other: Self) {
        self.points.extend(other.points);
        self.targets.extend(other.targets);
        self.weights.extend(other.weights);
        self.one_sided.extend(other.one_sided);
    }

    /// The same samples, each of this weight.
    #[must_use]
    pub fn weighing(mut self, weight: f64) -> Self {
        self.weights.fill(weight);
        self
    }

    /// The same samples, each of them one-sided.
    #[must_use]
    pub fn at_least(mut self) -> Self {
        self.one_sided.fill(true);
        self
    }

    /// The points on the surface: those whose target is 0.
    pub fn on_surface(&self) -> Vec<Vec3> {
        let on_surface = self.points.iter().zip(&self.targets);
        let on_surface = on_surface.filter(|(_, target)| **target == 0.0);
        on_surface.map(|(point, _)| *point).collect()
    }

    /// The least and the greatest f that costs nothing at sample `i`.
    pub fn free_range(&self, i: usize) -> [f64; 2] {
        let target = self.targets[i];
        if !self.one_sided[i] {
            [target, target]
        } else if target < 0.0 {
            [f64::NEG_INFINITY, target]
        } else {
            [target, f64::INFINITY]
        }
    }
}

impl Extend<(Vec3, f64)> for Samples {
    fn extend<I: IntoIterator<Item = (Vec3, f64)>>(&mut self, samples: I) {
        for (point, target) in samples {
            self.points.push(point);
            self.targets.push(target);
            self.weights.push(1.0);
            self.one_sided.push(false);
        }
    }
}

impl FromIterator<(Vec3, f64)> for Samples {
    fn from_iter<I: IntoIterator<Item = (Vec3, f64)>>(samples: I) -> Self {
        let mut all = Self::default();
        all.extend(samples);
        all
    }
}

/// How many samples of each kind there are.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Surface points trained on.
    pub surface: usize,
    /// Points labelled interior trained on.
    pub interior: usize,
    /// Points labelled exterior trained on.
    pub exterior: usize,
    /// Generated samples along the normals.
    pub near: usize,
    /// Generated samples in the box and on its shell.
    pub far: usize,
    /// Surface points held out.
    pub held_out: usize,
    /// Validation samples of every kind.
    pub validation: usize,
}

/// All that training needs, and what the report says about it.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared {
    /// The frame of training.
    pub frame: Frame,
    /// Samples to fit, unit frame.
    pub training: Samples,
    /// Samples of the same kinds from what was held out, unit frame; empty without a hold-out, as on sparse
    /// clouds.
    pub validation: Samples,
    /// Surface points that are worked with.
    pub points: usize,
    /// Indices into the cloud of the surface points trained on.
    pub surface: Vec<usize>,
    /// Indices into the cloud of the surface points held out; at most 20,000.
    pub held_out: Vec<usize>,
    /// How many samples of each kind there are.
    pub counts: Counts,
    /// Median distance between neighbouring trained points, unit frame.
    pub spacing: f64,
    /// How many times farther apart the points are across slices or scan lines than along them; 1 where they are
    /// even.
    pub anisotropy: f64,
    /// Area of the surface as the points tell it, unit frame; none where nothing is generated.
    pub area: Option<f64>,
    /// How far the surface points can be trusted, unit frame; none where nothing is generated.
    pub uncertainty: Option<Uncertainty>,
    /// Blocks that the points were cut into, each with a network of its own; 0 where one network is enough.
    pub blocks: usize,
    /// Diagonal of the box of the surface points, unit frame.
    pub diagonal: f64,
    /// Where the normals come from; none where none were needed.
    pub normals: Option<NormalSource>,
    /// Share of the points whose normal the winding number of all of them bears out, 0 to 1
    /// ([`OrientedSurface::confidence`](oriented::OrientedSurface::confidence)); none where no normals were
    /// needed.
    pub orientation_confidence: Option<f64>,
    /// Indices into the cloud of the surface points that were left out as strays, ascending.
    pub strays: Vec<usize>,
    /// What the user should know.
    pub warnings: Vec<Warning>,
}

impl Prepared {
    /// Standard deviation of the surface points from the surface, unit frame; none where nothing is generated.
    pub fn noise(&self) -> Option<f64> {
        self.uncertainty.map(|u| u.noise)
    }

    /// The surface points of `cloud`, in its coordinates, without strays: what the mesh is held against.
    pub(super) fn measured<'a>(&'a self, cloud: &'a PointCloud) -> impl Iterator<Item = Vec3> + 'a {
        cloud
            .indices(Label::Surface)
            .filter(|i| self.strays.binary_search(i).is_err())
            .map(|i| cloud.points[i])
    }
}
