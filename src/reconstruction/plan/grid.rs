//! How fine the grid is.

use std::f64::consts::PI;

use super::Plan;
use crate::reconstruction::settings::Evaluation;
use crate::reconstruction::vector::Bounds;

/// Grid step over the spacing of the points where blocks show their detail.
const BLOCK_STEP: f64 = 0.9;

/// Most grid points along the longest edge, as in the settings.
const MOST_RESOLUTION: f64 = 1024.0;

/// Most grid points in all where slender bodies get more than the settings say.
const MOST_GRID_POINTS: f64 = 1.3e8;

/// Least number of grid points along the longest edge that the spacing of the points leads to.
const LEAST_RESOLUTION: usize = 64;

/// The body that the grid goes around.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extent {
    /// The padded box of its points.
    pub bounds: Bounds,
    /// Median distance between neighbouring points.
    pub spacing: f64,
    /// Area of its surface; none where nothing is known of it.
    pub area: Option<f64>,
}

impl Plan<'_> {
    /// Grid points along the longest edge: those of the settings, no more than the spacing of the points carries,
    /// and so many more for a body with little surface for its length that the grid has as many cells at the
    /// surface as for a ball; enough for the detail of the blocks where there are `blocks`.
    pub fn resolution(&self, extent: &Extent, blocks: bool) -> usize {
        let settings = &self.settings.surface;
        if settings.steps_per_spacing <= 0.0 {
            return settings.resolution;
        }
        let longest = extent.bounds.longest_edge();
        let step = extent.spacing / settings.steps_per_spacing;
        let enough = ((longest / step).ceil() as usize).max(LEAST_RESOLUTION);
        let chosen = if blocks {
            let detail = longest / (BLOCK_STEP * extent.spacing);
            settings
                .resolution
                .max(detail.min(MOST_RESOLUTION) as usize)
                .min(enough)
        } else {
            settings.resolution.min(enough)
        };
        let (Evaluation::Sparse, Some(area)) = (settings.evaluation, extent.area) else {
            return chosen;
        };
        let slenderness = (PI * longest * longest / area).sqrt();
        let cube = longest.powi(3) / extent.bounds.extent().into_iter().product::<f64>();
        let most = MOST_RESOLUTION.min((MOST_GRID_POINTS * cube).cbrt());
        let finer = (settings.resolution as f64 * slenderness).min(most) as usize;
        chosen.max(finer.min(enough))
    }
}
