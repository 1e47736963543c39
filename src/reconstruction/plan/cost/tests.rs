use super::*;
use crate::reconstruction::Preset;

fn surface(surface: usize) -> Counts {
    Counts {
        surface,
        ..Counts::default()
    }
}

fn cost(settings: &Settings, points: usize, threads: usize) -> Cost {
    Cost::estimated(settings, &surface(points), threads)
}

#[test]
fn samples_are_bounded_by_the_cloud_and_by_the_settings() {
    let settings = Preset::Fast.settings();
    let samples = |surface| {
        let counts = Counts {
            surface,
            interior: 10,
            exterior: 0,
        };
        Cost::estimated(&settings, &counts, 1).samples
    };
    // Surface, two a pair, 10 labelled, 1000 far. A sparse cloud holds nothing out.
    assert_eq!(samples(100), 3 * 100 + 10 + 1_000);
    assert_eq!(samples(1_800), 3 * 1_620 + 10 + 1_000);
    assert_eq!(samples(9_000), 3 * 2_000 + 10 + 1_000);
}

#[test]
fn pairs_of_the_optimiser_take_memory() {
    // 7000 samples are enough for 110 pairs.
    let mut settings = Preset::Fast.settings();
    let bytes = |settings: &Settings| cost(settings, 2_001, 1).training_bytes;
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
    settings.network.members = 1;
    settings.network.block_points = 0;
    let bytes =
        |settings: &Settings, points, threads| cost(settings, points, threads).training_bytes;
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
    settings.network.members = 1;
    settings.sampling.validation_fraction = 0.0;
    // All pairs that so many samples keep, 55, need as many evaluations.
    settings.training.max_evaluations = 100;
    settings.sampling.near_pairs = 0;
    settings.sampling.far_points = 3_500 - 2_000;
    for (engine, output_layer, expected) in [
        (Engine::Auto, OutputLayer::Trained, 2.7),
        (Engine::Auto, OutputLayer::Solved, 3.1),
        (Engine::Libtorch, OutputLayer::Trained, 8.4),
    ] {
        settings.training.engine = engine;
        settings.training.output_layer = output_layer;
        let cost = cost(&settings, 2_000, 1);
        assert_eq!((cost.samples, cost.parameters), (3_500, 10_451));
        let milliseconds = 1e3 * cost.max_training_seconds / 100.0;
        assert!((milliseconds - expected).abs() < 0.2, "{milliseconds}");
    }
}

#[test]
fn blocks_take_time_and_memory_with_the_points() {
    let mut settings = Preset::Balanced.settings();
    let with = [50_000, 100_000].map(|points| cost(&settings, points, 2));
    settings.network.block_points = 0;
    let without = [50_000, 100_000].map(|points| cost(&settings, points, 2));
    let more = |i: usize| {
        (
            with[i].max_training_seconds - without[i].max_training_seconds,
            with[i].training_bytes - without[i].training_bytes,
        )
    };
    let ((seconds, bytes), (twice, twice_bytes)) = (more(0), more(1));
    assert!(seconds > 1.0 && bytes > 1 << 20, "{seconds} {bytes}");
    assert!((twice / seconds - 2.0).abs() < 0.05, "{twice} {seconds}");
    assert_eq!(twice_bytes, 2 * bytes);
    assert_eq!(with[0].blocks, (50_000 - 2_500_u64).div_ceil(110));
    assert_eq!(without[0].blocks, 0);
    assert!(with[1].seconds > 1.5 * with[0].seconds);
    assert!(with[1].seconds < with[1].max_training_seconds);
}

#[test]
fn the_largest_grid_that_fits_is_just_below_one_that_does_not() {
    for evaluation in [Evaluation::Sparse, Evaluation::Dense] {
        let mut settings = Preset::Paper.settings();
        settings.surface.evaluation = evaluation;
        settings.surface.resolution = 500;
        let limit = 44 << 20;
        settings.surface.resolution = largest_resolution(&settings, limit);
        assert!(grid_bytes(&settings) <= limit);
        settings.surface.resolution += 1;
        assert!(grid_bytes(&settings) > limit);
    }
}

#[test]
fn a_finer_grid_takes_more() {
    let mut settings = Preset::Paper.settings();
    let coarse = cost(&settings, 1_000, 1);
    settings.surface.resolution *= 2;
    let fine = cost(&settings, 1_000, 1);
    assert!(fine.grid_bytes >= 4 * coarse.grid_bytes);
    assert!(fine.seconds > coarse.seconds && fine.memory_bytes > coarse.memory_bytes);
}

#[test]
fn triangles_grow_with_the_points_where_the_grid_does_not() {
    let settings = Preset::Balanced.settings();
    let of_each = |points| cost(&settings, points, 1).triangles as f64 / points as f64;
    // The grid has its largest size from about 1.2 million points on. A face of one million and of five million has
    // 3.9 and 3.3, with pieces that are dropped.
    let (below, above) = (of_each(1_000_000), of_each(5_000_000));
    assert!((3.0..4.5).contains(&below), "{below}");
    assert!((above / below - 1.0).abs() < 0.05, "{above} {below}");
}
