//! What became of the field: the mesh on its grid, and how much of it the points bear out.

use serde::Serialize;

use crate::reconstruction::mesh::TriangleMesh;
use crate::reconstruction::observer::Warning;
use crate::reconstruction::sampling::Frame;
use crate::reconstruction::settings::Open;
use crate::reconstruction::surface::{Dropped, Extraction};

/// Percent of the area without points from which on the user is warned.
const NOTABLE_PERCENT: f64 = 10.0;

/// The code of the warning of area without points.
pub(super) const UNSUPPORTED: &str = "surface_unsupported";

/// How the surface was extracted; lengths and areas in units of the input.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SurfaceReport {
    /// Grid points along each axis.
    pub grid_points: [usize; 3],
    /// Edge of a grid cell.
    pub grid_spacing: f64,
    /// Grid points at which f was evaluated.
    pub field_evaluations: u64,
    /// Vertices where the surface left the grid and was closed.
    pub closing_vertices: usize,
    /// Components that were dropped.
    pub dropped_components: usize,
    /// Their triangles.
    pub dropped_triangles: usize,
    /// Their area.
    pub dropped_area: f64,
    /// Up to this distance from a surface point of the cloud the mesh is taken as measured: three times the
    /// spacing of the points or of the grid, the larger of the two.
    pub support_distance: f64,
    /// Percent of the area of the closed surface that lies further than that from every surface point: what the network
    /// filled in. The rim of a hole, as wide as that distance, does not count.
    pub unsupported_area_percent: f64,
    /// Percent of the area of the closed surface that was cut away because no point is near.
    pub trimmed_area_percent: f64,
}

impl SurfaceReport {
    pub(in crate::reconstruction) fn new(extraction: &Extraction, frame: &Frame) -> Self {
        Self {
            grid_points: extraction.grid.points,
            grid_spacing: frame.length_to_world(extraction.grid.spacing),
            field_evaluations: extraction.evaluations,
            closing_vertices: extraction.closing_vertices,
            dropped_components: 0,
            dropped_triangles: 0,
            dropped_area: 0.0,
            support_distance: 0.0,
            unsupported_area_percent: 0.0,
            trimmed_area_percent: 0.0,
        }
    }

    pub(in crate::reconstruction) fn dropped(&mut self, dropped: Dropped, frame: &Frame) {
        self.dropped_components = dropped.components;
        self.dropped_triangles = dropped.triangles;
        self.dropped_area = dropped.area * frame.length_to_world(1.0).powi(2);
    }

    /// Takes note of what lies further than `distance` from the points of `mesh`, in units of the input.
    pub(in crate::reconstruction) fn supported(&mut self, mesh: &TriangleMesh, distance: f64) {
        self.support_distance = distance;
        self.unsupported_area_percent = 100.0 * mesh.share_beyond(distance);
    }

    /// Whether to cut away what has no points near, where the user asked for `open`.
    pub(in crate::reconstruction) fn open(&self, open: Open) -> bool {
        match open {
            Open::Auto => self.unsupported_area_percent >= NOTABLE_PERCENT,
            Open::Closed => false,
            Open::Trimmed => true,
        }
    }

    /// Takes note of what was cut from `closed` to get `mesh`.
    pub(in crate::reconstruction) fn trimmed(
        &mut self,
        closed: &TriangleMesh,
        mesh: &TriangleMesh,
    ) {
        let kept = mesh.area() / closed.area();
        // Rounding aside, nothing is added; a surface without area has lost none.
        self.trimmed_area_percent = (100.0 * (1.0 - kept)).max(0.0);
    }

    /// What to warn of: a mesh of which a notable part was not measured.
    pub(in crate::reconstruction) fn warning(&self) -> Option<Warning> {
        if self.trimmed_area_percent > 0.0 {
            return None;
        }
        let message = self.unsupported(NOTABLE_PERCENT)?;
        Some(Warning::new(
            UNSUPPORTED,
            format!(
                "{message}: it is filled in, not measured; `distance_to_points` in PLY tells where"
            ),
        ))
    }

    /// How much of the closed surface was not measured, in words; none below `percent`.
    pub(super) fn unsupported(&self, percent: f64) -> Option<String> {
        if self.trimmed_area_percent > 0.0 {
            return Some(format!(
                "{:.1} % of the closed surface was cut away: no point within {:.4}",
                self.trimmed_area_percent, self.support_distance
            ));
        }
        (self.unsupported_area_percent >= percent).then(|| {
            format!(
                "{:.1} % of the surface has no point within {:.4}",
                self.unsupported_area_percent, self.support_distance
            )
        })
    }
}
