//! How fine the grid is.

use std::f64::consts::PI;

use super::Plan;
use crate::reconstruction::settings::Evaluation;
use crate::reconstruction::vector::Bounds;

/// Grid step over the spacing of the points where blocks show their detail.
pub(super) const BLOCK_STEP: f64 = 0.9;

/// Grid points across a ball that are enough for what a fit shows of it, over the square root of the spacings of the
/// points across it. What the fit leaves falls faster than the spacing, and what the grid leaves with the square of
/// its step. Chosen on bunny, torus and uterus of the bench (docs/quality.md).
const SMOOTH: f64 = 30.0;

/// The resolution that this was chosen with. A finer one asks for as much more.
const CHOSEN_WITH: f64 = 256.0;

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
    /// Grid points along the longest edge: those of the settings, no more than the spacing of the points carries or
    /// a fit to so many of them shows, and so many more for a body with little surface for its length that the grid
    /// has as many cells at the surface as for a ball; enough for the detail of the blocks where there are `blocks`.
    pub fn resolution(&self, extent: &Extent, blocks: bool) -> usize {
        let settings = &self.settings.surface;
        if settings.steps_per_spacing <= 0.0 {
            return settings.resolution;
        }
        let longest = extent.bounds.longest_edge();
        let step = extent.spacing / settings.steps_per_spacing;
        let enough = ((longest / step).ceil() as usize).max(LEAST_RESOLUTION);
        let detail = if blocks {
            (longest / (BLOCK_STEP * extent.spacing)).min(MOST_RESOLUTION) as usize
        } else {
            0
        };
        let (Evaluation::Sparse, Some(area)) = (settings.evaluation, extent.area) else {
            return settings.resolution.max(detail).min(enough);
        };
        // A body wider than a ball of its surface gets the grid of the settings all the same.
        let slenderness = (PI * longest * longest / area).sqrt().max(1.0);
        let across = longest / slenderness / extent.spacing;
        let asked = settings.resolution as f64;
        let smooth = SMOOTH * across.sqrt() * (asked / CHOSEN_WITH).max(1.0);
        let cube = longest.powi(3) / extent.bounds.extent().into_iter().product::<f64>();
        let most = MOST_RESOLUTION.min((MOST_GRID_POINTS * cube).cbrt());
        let finer = (asked.min(smooth) * slenderness).min(most) as usize;
        finer.max(detail).min(enough)
    }
}
