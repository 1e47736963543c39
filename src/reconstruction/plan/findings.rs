//! What decisions rest on: what the scan of a cloud found, or what is assumed of one that is only counted.

use std::f64::consts::PI;

use super::grid::Extent;
use crate::reconstruction::cloud::Counts;
use crate::reconstruction::sampling::selection::trained_points;
use crate::reconstruction::sampling::{MAX_WORKING_POINTS, Prepared, Uncertainty, held_out_share};
use crate::reconstruction::settings::{OffSurface, Settings};
use crate::reconstruction::vector::Bounds;

/// Spacing of points that were drawn from a surface at random, over the edge of a square that each has of it:
/// measured on balls, a bunny and a horse.
const SPACING_OF_SQUARE: f64 = 0.95;

/// Noise over spacing of a cloud that is taken to be uncertain.
const NOISE_OF_UNCERTAIN: f64 = 0.5;

/// What is known of a cloud.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Findings {
    /// Surface points that are worked with.
    pub points: usize,
    /// Training samples of the networks that fit the whole.
    pub samples: usize,
    /// Whether the field may go beyond the target at some of them.
    pub one_sided: bool,
    /// How far the points can be trusted; none where nothing is generated from them.
    pub uncertainty: Option<Uncertainty>,
}

impl Findings {
    /// Whether there are different surfaces that fit the points equally well: they are sparse, or their noise is
    /// above a tenth of their spacing.
    pub fn is_uncertain(&self) -> bool {
        self.uncertainty
            .is_some_and(|u| u.leaves_the_surface_open())
    }

    /// What is assumed of a cloud that is only counted: points at random places of a ball, exact, different, without
    /// strays; every sample that the settings ask for.
    pub fn assumed(settings: &Settings, counted: &Counts) -> Self {
        let sampling = &settings.sampling;
        let labelled = |points: usize| points.min(sampling.labelled_points);
        let given = labelled(counted.interior) + labelled(counted.exterior);
        let trained = |sparse| {
            let points = counted.surface.min(MAX_WORKING_POINTS);
            let share = held_out_share(sampling, sparse);
            (
                points,
                trained_points(points, sampling.surface_points, share),
            )
        };
        if sampling.off_surface == OffSurface::Labels {
            return Self {
                points: counted.surface,
                samples: trained(false).1 + given,
                one_sided: false,
                uncertainty: None,
            };
        }
        let band = sampling.band * ball(settings, 0.0).bounds.diagonal();
        let spacing = |points| ball_spacing(settings, points);
        let sparse = Uncertainty::is_sparse(spacing(counted.surface), band);
        let (points, trained) = trained(sparse);
        Self {
            points,
            samples: trained * (1 + 2 * sampling.near_pairs) + given + sampling.far_points,
            one_sided: sparse,
            uncertainty: Some(Uncertainty {
                noise: 0.0,
                spacing: spacing(trained),
                band,
                sparse,
                missing: 0.0,
                crowding: 1.0,
            }),
        }
    }

    /// The same of points that are uncertain by their noise, or not at all.
    #[must_use]
    pub fn taken_as(self, uncertain: bool) -> Self {
        let share = if uncertain { NOISE_OF_UNCERTAIN } else { 0.0 };
        let uncertainty = self.uncertainty.map(|u| Uncertainty {
            noise: share * u.spacing,
            sparse: false,
            ..u
        });
        Self {
            uncertainty,
            ..self
        }
    }

    /// The ball that these are assumed to be findings of, in the frame of training, as the grid sees it: by all of
    /// its points where blocks are fitted to them.
    pub(super) fn extent(&self, settings: &Settings, blocks: bool) -> Extent {
        let ball = ball(settings, settings.surface.padding);
        let spacing = match self.uncertainty {
            Some(u) if !blocks => u.spacing,
            _ => ball_spacing(settings, self.points),
        };
        Extent { spacing, ..ball }
    }
}

impl From<&Prepared> for Findings {
    fn from(prepared: &Prepared) -> Self {
        Self {
            points: prepared.points,
            samples: prepared.training.len(),
            one_sided: prepared.training.one_sided.contains(&true),
            uncertainty: prepared.uncertainty,
        }
    }
}

/// The ball that fills the box of training, with a margin in shares of its diameter.
fn ball(settings: &Settings, margin: f64) -> Extent {
    let radius = settings.sampling.half_extent;
    let bounds = Bounds {
        min: [-radius; 3],
        max: [radius; 3],
    };
    Extent {
        bounds: bounds.padded(margin * bounds.longest_edge()),
        spacing: 0.0,
        area: Some(4.0 * PI * radius * radius),
    }
}

/// Spacing of so many points on it.
fn ball_spacing(settings: &Settings, points: usize) -> f64 {
    let area = ball(settings, 0.0).area.unwrap_or_default();
    SPACING_OF_SQUARE * (area / points.max(1) as f64).sqrt()
}
