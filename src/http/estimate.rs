//! What a job will cost, roughly, from its settings and the counts of its cloud.

use serde::Serialize;

use super::inspect::Labels;
use crate::reconstruction::Settings;
use crate::reconstruction::network::{Architecture, Ensemble, Fused};
use crate::reconstruction::sampling::MAX_WORKING_POINTS;
use crate::reconstruction::settings::{
    Engine, Evaluation, OffSurface, Optimizer, OutputLayer, Precision,
};

/// Floating-point operations that a thread does a second in training, in f32.
///
/// Measured with `make bench` on one thread of x86-64 with AVX-512 (docs/benchmarks.md): loss and
/// gradient of 3500 samples and 10451 parameters (3-50×5-1, `sqrhw`), which are
/// [`FLOPS_PER_WEIGHT`] · 3500 · 10451 = 2.2e8 operations, take the fused engine 2.4 ms and libtorch
/// 8 ms. Times drift by a factor of two with the load of the machine, and further with its kind.
const FUSED_FLOPS: f64 = 9.1e10;
const LIBTORCH_FLOPS: f64 = 2.7e10;

/// Seconds that a pair of L-BFGS takes for each parameter, in f32: 0.6 ms for 100 pairs of 10451.
const SECONDS_PER_PAIR: f64 = 5.7e-10;

/// Points that the fused engine has in work at a time in each thread.
const TILE_POINTS: u64 = 512;

/// Numbers that libtorch keeps for each neuron and sample, on the way forwards and back.
const LIBTORCH_NUMBERS: u64 = 5;

/// Operations of loss and gradient for each parameter and sample: a multiplication and an addition
/// forwards, and twice that backwards.
const FLOPS_PER_WEIGHT: f64 = 6.0;

/// What solving for the output layer adds to that: once more forwards, and the products of the last hidden
/// layer's outputs.
const FLOPS_PER_WEIGHT_SOLVED: f64 = 2.5;

/// Samples of blocks for each point of the cloud: one of its own and three generated ones, of which a half lies in
/// the reach of two blocks (measured on 30,000 and 100,000 points).
const BLOCK_SAMPLES_PER_POINT: f64 = 4.5;

/// Bytes that a place of the samples of blocks takes, and its number in the lists of the blocks.
const BYTES_PER_PLACE: u64 = 40;

/// Bytes kept for each point of the sparse grid near the surface.
const BYTES_PER_SAMPLE: u64 = 32;

/// Points of the sparse grid near the surface for each square of its resolution: six faces of the
/// box, some layers thick.
const SAMPLES_PER_SQUARE: u64 = 24;

/// The estimate of a `dry_run`, and what jobs are held to the memory of a worker by.
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
    pub(super) training_bytes: u64,
    /// What of it the pairs of L-BFGS take.
    #[serde(skip)]
    pub(super) pairs_bytes: u64,
    /// Longest time of the training: training that converges ends sooner.
    max_training_seconds: f64,
}

impl Estimate {
    /// For a cloud with so many points, by a worker of so many threads.
    pub(super) fn new(settings: &Settings, labels: &Labels, threads: usize) -> Self {
        // Whether the cloud is uncertain is not known yet: the larger of the two.
        let [one, several] = [false, true].map(|u| Ensemble::new(&settings.network, u));
        let ensemble = if several.parameter_count() > one.parameter_count() {
            several
        } else {
            one
        };
        let architecture = &ensemble.architecture;
        let parameters = ensemble.parameter_count() as u64;
        let samples = samples(settings, labels);
        let number_bytes = match settings.network.precision {
            Precision::F32 => 4,
            Precision::F64 => 8,
        };
        let neurons = (architecture.width * architecture.hidden_layers) as u64;
        let (flops, numbers) = if is_fused(settings, architecture) {
            // Value and slope of each neuron of a tile; each tile has a gradient of its own.
            let in_work = 2 * neurons * TILE_POINTS * threads.max(1) as u64;
            let tiles = samples.div_ceil(TILE_POINTS);
            (FUSED_FLOPS, in_work + tiles * parameters)
        } else {
            (LIBTORCH_FLOPS, LIBTORCH_NUMBERS * neurons * samples)
        };
        let pairs = pairs(settings, samples);
        let flops_per_weight = match settings.training.output_layer {
            OutputLayer::Trained => FLOPS_PER_WEIGHT,
            OutputLayer::Solved => FLOPS_PER_WEIGHT + FLOPS_PER_WEIGHT_SOLVED,
        };
        let evaluation = flops_per_weight * (parameters * samples) as f64 / flops
            + SECONDS_PER_PAIR * (pairs * parameters) as f64;
        // Twice the bytes take twice the time.
        let seconds = evaluation * (number_bytes / 4) as f64 / threads.max(1) as f64
            * settings.training.max_evaluations as f64;
        let (block_evaluations, block_bytes) = blocks(settings, labels);
        let seconds = seconds
            + flops_per_weight * block_evaluations / flops * (number_bytes / 4) as f64
                / threads.max(1) as f64;
        let limit = settings.training.time_limit_seconds;
        // Two vectors a pair, and all of them again in a checkpoint.
        let pairs_bytes = 4 * pairs * parameters * number_bytes;
        Self {
            parameters,
            samples,
            max_evaluations: settings.training.max_evaluations,
            grid_points: (settings.surface.resolution as u64).pow(3),
            grid_bytes: Self::grid_bytes(settings),
            training_bytes: numbers * number_bytes + pairs_bytes + block_bytes,
            pairs_bytes,
            max_training_seconds: if limit > 0.0 {
                seconds.min(limit)
            } else {
                seconds
            },
        }
    }

    /// Memory of the grid: a bit a point where it is dense, and the points near the surface.
    pub(super) fn grid_bytes(settings: &Settings) -> u64 {
        grid_bytes(settings.surface.evaluation, settings.surface.resolution)
    }

    /// The finest grid below that of the settings that takes no more than `limit_bytes`.
    pub(super) fn largest_resolution(settings: &Settings, limit_bytes: u64) -> usize {
        let fits = |resolution: &usize| {
            grid_bytes(settings.surface.evaluation, *resolution) <= limit_bytes
        };
        let mut coarser = (0..settings.surface.resolution).rev();
        coarser.find(fits).unwrap_or_default()
    }
}

fn grid_bytes(evaluation: Evaluation, resolution: usize) -> u64 {
    let resolution = resolution as u64;
    let near = resolution.pow(2) * SAMPLES_PER_SQUARE * BYTES_PER_SAMPLE;
    match evaluation {
        Evaluation::Sparse => near,
        Evaluation::Dense => near + resolution.pow(3) / 8,
    }
}

/// Evaluations that the networks of blocks take at most, each counted once for every parameter and sample, and the
/// bytes of their samples. Whether one network is enough is not known yet: it is taken not to be.
fn blocks(settings: &Settings, labels: &Labels) -> (f64, u64) {
    let network = &settings.network;
    let points = labels.surface.min(MAX_WORKING_POINTS as u64);
    if network.block_points == 0
        || points <= network.block_points as u64
        || settings.sampling.off_surface == OffSurface::Labels
    {
        return (0.0, 0);
    }
    let samples = BLOCK_SAMPLES_PER_POINT * points as f64;
    let parameters = Architecture::of_block(network).parameter_count();
    let evaluations = settings.training.most_block_evaluations();
    (
        evaluations as f64 * parameters as f64 * samples,
        samples as u64 * BYTES_PER_PLACE,
    )
}

/// Whether the training is that of the fused engine.
fn is_fused(settings: &Settings, architecture: &Architecture) -> bool {
    settings.training.engine != Engine::Libtorch
        && settings.network.precision == Precision::F32
        && Fused::supports(architecture)
}

/// Pairs that L-BFGS keeps in the end.
fn pairs(settings: &Settings, samples: u64) -> u64 {
    let training = &settings.training;
    let most = training.max_iterations.min(training.max_evaluations);
    match training.optimizer {
        Optimizer::Adam => 0,
        Optimizer::Lbfgs | Optimizer::AdamLbfgs => {
            most.min(settings.kept_pairs(samples as usize) as u64)
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

    fn surface(surface: u64) -> Labels {
        Labels {
            surface,
            interior: 0,
            exterior: 0,
        }
    }

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
    fn pairs_of_the_optimiser_take_memory() {
        // 7000 samples are enough for 110 pairs.
        let labels = surface(2_000);
        let mut settings = Preset::Fast.settings();
        let bytes = |settings: &Settings| Estimate::new(settings, &labels, 1).training_bytes;
        let before = bytes(&settings);
        settings.training.history += 10;
        // 10 pairs of two vectors of 10451 numbers of 4 bytes, kept and written down.
        assert_eq!(bytes(&settings), before + 2 * 10 * 2 * 10_451 * 4);
        settings.training.optimizer = Optimizer::Adam;
        assert_eq!(bytes(&settings), before - 2 * 100 * 2 * 10_451 * 4);
        // No more pairs than steps.
        settings.training.optimizer = Optimizer::Lbfgs;
        settings.training.max_iterations = 100;
        assert_eq!(bytes(&settings), before);
    }

    #[test]
    fn memory_is_that_of_the_engine() {
        let mut settings = Preset::Fast.settings();
        settings.training.optimizer = Optimizer::Adam;
        let bytes = |settings: &Settings, points, threads| {
            Estimate::new(settings, &surface(points), threads).training_bytes
        };
        let tile = 2 * 5 * 50 * 512 * 4;
        assert_eq!(bytes(&settings, 100, 2) - bytes(&settings, 100, 1), tile);
        settings.training.engine = Engine::Libtorch;
        // 3 samples a point.
        let sample = 5 * 5 * 50 * 4;
        let more = bytes(&settings, 101, 1) - bytes(&settings, 100, 1);
        assert_eq!(more, 3 * sample);
        let singles = bytes(&settings, 100, 1);
        settings.training.engine = Engine::Auto;
        settings.network.precision = Precision::F64;
        assert_eq!(bytes(&settings, 100, 1), 2 * singles);
    }

    #[test]
    fn a_measured_evaluation_takes_its_time() {
        let mut settings = Preset::Fast.settings();
        settings.network.block_points = 0;
        // All pairs that so many samples keep, 55, need as many evaluations.
        settings.training.max_evaluations = 100;
        settings.sampling.far_points = 3_500 - 3 * 500;
        for (engine, output_layer, expected) in [
            (Engine::Auto, OutputLayer::Trained, 2.7),
            (Engine::Auto, OutputLayer::Solved, 3.7),
            (Engine::Libtorch, OutputLayer::Trained, 8.5),
        ] {
            settings.training.engine = engine;
            settings.training.output_layer = output_layer;
            let estimate = Estimate::new(&settings, &surface(500), 1);
            assert_eq!((estimate.samples, estimate.parameters), (3_500, 10_451));
            let milliseconds = 1e3 * estimate.max_training_seconds / 100.0;
            assert!((milliseconds - expected).abs() < 0.2, "{milliseconds}");
        }
    }

    #[test]
    fn blocks_take_time_and_memory_with_the_points() {
        let mut settings = Preset::Balanced.settings();
        let of = |settings: &Settings, points| Estimate::new(settings, &surface(points), 2);
        let with = [50_000, 100_000].map(|points| of(&settings, points));
        settings.network.block_points = 0;
        let without = [50_000, 100_000].map(|points| of(&settings, points));
        let more = |i: usize| {
            let (with, without): (&Estimate, &Estimate) = (&with[i], &without[i]);
            (
                with.max_training_seconds - without.max_training_seconds,
                with.training_bytes - without.training_bytes,
            )
        };
        let ((seconds, bytes), (twice, twice_bytes)) = (more(0), more(1));
        assert!(seconds > 1.0 && bytes > 1 << 20, "{seconds} {bytes}");
        assert!((twice - 2.0 * seconds).abs() < 1e-6 * twice);
        assert_eq!(twice_bytes, 2 * bytes);
    }

    #[test]
    fn the_largest_grid_that_fits_is_just_below_one_that_does_not() {
        for evaluation in [Evaluation::Sparse, Evaluation::Dense] {
            let mut settings = Preset::Paper.settings();
            settings.surface.evaluation = evaluation;
            settings.surface.resolution = 500;
            let limit = 44 << 20;
            settings.surface.resolution = Estimate::largest_resolution(&settings, limit);
            assert!(Estimate::grid_bytes(&settings) <= limit);
            settings.surface.resolution += 1;
            assert!(Estimate::grid_bytes(&settings) > limit);
        }
    }

    #[test]
    fn a_finer_grid_takes_more() {
        let mut settings = Preset::Paper.settings();
        let coarse = Estimate::grid_bytes(&settings);
        settings.surface.resolution *= 2;
        assert!(Estimate::grid_bytes(&settings) >= 4 * coarse);
    }
}
