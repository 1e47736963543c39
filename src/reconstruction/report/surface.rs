//! What became of the field: the mesh on its grid, and how much of it the points bear out.

use serde::Serialize;

use crate::reconstruction::mesh::{Limits, Simplified, TriangleMesh};
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
    /// How the mesh was simplified; none where that was not asked for, or it had no more triangles than asked for.
    pub simplification: Option<Simplification>,
}

/// How a mesh was simplified; lengths in units of the input.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Simplification {
    /// Triangles that were asked for.
    pub target_triangles: usize,
    /// Triangles before.
    pub triangles_before: usize,
    /// Triangles after.
    pub triangles: usize,
    /// Furthest that the surface was allowed to move.
    pub error_bound: f64,
    /// Furthest that it was found to have moved.
    pub error: f64,
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
            simplification: None,
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

    /// Takes note of what was made, within `limits`, of a mesh of so many triangles.
    pub(in crate::reconstruction) fn simplified(
        &mut self,
        triangles_before: usize,
        limits: Limits,
        simplified: &Simplified,
    ) {
        self.simplification = Some(Simplification {
            target_triangles: limits.triangles,
            triangles_before,
            triangles: simplified.mesh.triangles.len(),
            error_bound: limits.error,
            error: simplified.error,
        });
    }

    /// What to warn of.
    pub(in crate::reconstruction) fn warnings(&self) -> impl Iterator<Item = Warning> {
        let above = self.simplification.and_then(Simplification::warning);
        self.warning().into_iter().chain(above)
    }

    /// What to warn of: a mesh of which a notable part was not measured.
    pub(super) fn warning(&self) -> Option<Warning> {
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

impl Simplification {
    /// What to warn of: more triangles than asked for.
    fn warning(self) -> Option<Warning> {
        (self.triangles > self.target_triangles).then(|| {
            Warning::new(
                "triangles_above_target",
                format!(
                    "{} triangles are left for the {} of surface.target_triangles: fewer would move the surface by \
                     more than {:.4}, which is what its points support, or fold it; take these, or simplify the \
                     mesh with another program",
                    self.triangles, self.target_triangles, self.error_bound
                ),
            )
        })
    }

    /// What was done, in words.
    pub(super) fn summary(&self) -> String {
        format!(
            "simplified from {} triangles, which moved the surface by {:.4} at most",
            self.triangles_before, self.error
        )
    }
}
