//! What a job will cost, roughly, from its settings and the counts of its cloud.

use serde::Serialize;

use super::inspect::Labels;
use crate::reconstruction::Settings;
use crate::reconstruction::network::Architecture;
use crate::reconstruction::settings::{Evaluation, OffSurface, Optimizer, Precision};

/// Floating-point operations that a thread does a second in training, in f32.
///
/// Measured with `make bench` on one thread of x86-64 with AVX-512 (docs/benchmarks.md): loss and
/// gradient of 3500 samples and 10451 parameters (3-50×5-1, `sqrhw`), which are
/// [`FLOPS_PER_WEIGHT`] · 3500 · 10451 = 2.2e8 operations, take libtorch 8.7 ms, and the
/// step of L-BFGS with 100 pairs between them 0.75 ms: 2.2e8 / 9.45e-3. Times drift by a factor of
/// two with the load of the machine, and further with its kind; a faster engine stays below.
const FLOPS_PER_THREAD: f64 = 2.3e10;

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
        let number_bytes = match settings.network.precision {
            Precision::F32 => 4,
            Precision::F64 => 8,
        };
        // Twice the bytes take twice the time.
        let work = FLOPS_PER_WEIGHT * (parameters * samples * number_bytes / 4) as f64;
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
            training_bytes: (samples * neurons * 4 + history(settings) * parameters) * number_bytes,
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

/// Vectors of the length of the parameters that the optimiser keeps: two for each pair of L-BFGS.
fn history(settings: &Settings) -> u64 {
    match settings.training.optimizer {
        Optimizer::Adam => 0,
        Optimizer::Lbfgs | Optimizer::AdamLbfgs => 2 * settings.training.history as u64,
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
    fn pairs_of_the_optimiser_and_longer_numbers_take_memory() {
        let labels = Labels {
            surface: 100,
            interior: 0,
            exterior: 0,
        };
        let mut settings = Preset::Fast.settings();
        let bytes = |settings: &Settings| Estimate::new(settings, &labels, 1).training_bytes;
        let before = bytes(&settings);
        settings.training.history += 10;
        // 10 pairs of two vectors of 10451 numbers of 4 bytes.
        assert_eq!(bytes(&settings), before + 10 * 2 * 10_451 * 4);
        let singles = bytes(&settings);
        settings.network.precision = Precision::F64;
        assert_eq!(bytes(&settings), 2 * singles);
        settings.training.optimizer = Optimizer::Adam;
        assert_eq!(bytes(&settings), 2 * (before - 100 * 2 * 10_451 * 4));
    }

    #[test]
    fn a_measured_evaluation_takes_its_time() {
        let mut settings = Preset::Fast.settings();
        settings.training.max_evaluations = 1;
        settings.sampling.far_points = 3_500 - 3 * 500;
        let labels = Labels {
            surface: 500,
            interior: 0,
            exterior: 0,
        };
        let estimate = Estimate::new(&settings, &labels, 1);
        assert_eq!((estimate.samples, estimate.parameters), (3_500, 10_451));
        let milliseconds = 1e3 * estimate.max_training_seconds;
        assert!((milliseconds - 9.45).abs() < 0.2, "{milliseconds}");
    }

    #[test]
    fn a_finer_grid_takes_more() {
        let mut settings = Preset::Paper.settings();
        let coarse = Estimate::grid_bytes(&settings);
        settings.surface.resolution *= 2;
        assert!(Estimate::grid_bytes(&settings) >= 4 * coarse);
    }
}
