//! What the report says of the slices that a cloud was made of.

use std::fmt::Write;

use serde::Serialize;

use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::slices::{Record, Summary};

/// How the cloud was made from slices, and how the mesh agrees with them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SlicesReport {
    /// What was done.
    #[serde(flatten)]
    pub summary: Summary,
    /// Dice of the label's pixels and those whose centres are inside the mesh: 1 where they are the same. None where
    /// there are none.
    pub dice: Option<f64>,
    /// How much larger the mesh is than the label slice by slice, in percent of the label; none of a mesh that is not
    /// closed.
    pub volume_change_percent: Option<f64>,
}

impl SlicesReport {
    /// Holds a mesh, of this volume if it is closed, against the slices.
    pub(super) fn new(record: &Record, mesh: &TriangleMesh, volume: Option<f64>) -> Self {
        let label = record.summary.volume;
        Self {
            summary: record.summary.clone(),
            dice: record.occupancy.overlap(mesh).dice(),
            volume_change_percent: volume
                .filter(|_| label > 0.0)
                .map(|volume| 100.0 * (volume / label - 1.0)),
        }
    }

    /// The slices in one line for people.
    pub(super) fn line(&self) -> String {
        let summary = &self.summary;
        let mut line = format!(
            "{} slices {:.2} mm apart, {} of {} contour points at least {:.2} mm apart, {} + {} places inside and outside",
            summary.slices,
            summary.slice_distance,
            summary.surface_points,
            summary.contour_points,
            summary.thinning_radius,
            summary.interior_points,
            summary.exterior_points,
        );
        if let Some(dice) = self.dice {
            let _ = write!(line, "; Dice {dice:.4}");
        }
        if let Some(change) = self.volume_change_percent {
            let _ = write!(line, ", volume {change:+.2} %");
        }
        line
    }
}
