//! What a job will cost, roughly, from its settings and the counts of its cloud.

use serde::Serialize;

use super::inspect::Labels;
use crate::reconstruction::Settings;
use crate::reconstruction::network::Architecture;
use crate::reconstruction::settings::{Evaluation, OffSurface, Precision};

/// Floating-point operations that a thread does a second in training, in f32: measured within a
/// factor of two on servers of 2020 to 2025.
const FLOPS_PER_THREAD: f64 = 1.5e10;

/// Operations of loss and gradient for each parameter and sample: a multiplication and an addition
/// forwards, and twice that backwards.
const FLOPS_PER_WEIGHT: f64 = 6.0;

/// Bytes kept for each point of the sparse grid near the surface.
const BYTES_PER_SAMPLE: u64 = 32;

/// Points of the sparse grid near the surface for each square of its resolution: six faces of the
/// box, some layers thick.
const SAMPLES_PER_SQUARE: u64 = 24;

/// The estimate of a `dry_run`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct Estimate {
    /// Trained numbers.
    parameters: u64,
    /// Training samples.
    samples: u64,
    /// Most evaluations of loss and gradient.
    max_evaluations: u64,
    /// Points of the whole grid; the sparse evaluation visits few of them.
    grid_points: u64,
    /// Memory of the grid.
    grid_bytes: u64,
    /// Memory of the training.
    training_bytes: u64,
    /// Longest time of the training: training that converges ends sooner.
    max_training_seconds: f64,
}

impl Estimate {
    /// For a cloud with so many points, by a worker of so many threads.
    pub(super) fn new(settings: &Settings, labels: &Labels, threads: usize) -> Self {
        let parameters = Architecture::new(&settings.network).parameter_count() as u64;
        let samples = samples(settings, labels);
        let f64_factor = match settings.network.precision {
            Precision::F32 => 1,
            Precision::F64 => 2,
        };
        let work = FLOPS_PER_WEIGHT * parameters as f64 * samples as f64 * f64_factor as f64;
        let seconds = work * settings.training.max_evaluations as f64
            / (FLOPS_PER_THREAD * threads.max(1) as f64);
        let limit = settings.training.time_limit_seconds;
        let neurons = (settings.network.width * settings.network.hidden_layers) as u64;
        Self {
            parameters,
            samples,
            max_evaluations: settings.training.max_evaluations,
            grid_points: (settings.surface.resolution as u64).pow(3),
            grid_bytes: Self::grid_bytes(settings),
            // Pre-activation, activation and its gradient of each neuron, and a temporary.
            training_bytes: samples * neurons * 4 * 4 * f64_factor,
            max_training_seconds: if limit > 0.0 {
                seconds.min(limit)
            } else {
                seconds
            },
        }
    }

    /// Memory of the grid: a bit a point where it is dense, and the points near the surface.
    pub(super) fn grid_bytes(settings: &Settings) -> u64 {
        let resolution = settings.surface.resolution as u64;
        let near = resolution.pow(2) * SAMPLES_PER_SQUARE * BYTES_PER_SAMPLE;
        match settings.surface.evaluation {
            Evaluation::Sparse => near,
            Evaluation::Dense => near + resolution.pow(3) / 8,
        }
    }
}

/// Training samples that the settings make of the cloud.
fn samples(settings: &Settings, labels: &Labels) -> u64 {
    let sampling = &settings.sampling;
    let surface = labels.surface.min(sampling.surface_points as u64);
    let labelled = sampling.labelled_points as u64;
    let given = surface + labels.interior.min(labelled) + labels.exterior.min(labelled);
    match sampling.off_surface {
        OffSurface::Labels => given,
        OffSurface::Generated => {
            given + 2 * surface * sampling.near_pairs as u64 + sampling.far_points as u64
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reconstruction::Preset;

    #[test]
    fn samples_are_bounded_by_the_cloud_and_by_the_settings() {
        let labels = |surface| Labels {
            surface,
            interior: 10,
            exterior: 0,
        };
        let settings = Preset::Fast.settings();
        // Surface, two a pair, 10 labelled, 1000 far.
        assert_eq!(samples(&settings, &labels(100)), 3 * 100 + 10 + 1_000);
        assert_eq!(samples(&settings, &labels(9_000)), 3 * 2_000 + 10 + 1_000);
    }

    #[test]
    fn a_finer_grid_takes_more() {
        let mut settings = Preset::Paper.settings();
        let coarse = Estimate::grid_bytes(&settings);
        settings.surface.resolution *= 2;
        assert!(Estimate::grid_bytes(&settings) >= 4 * coarse);
    }
}
