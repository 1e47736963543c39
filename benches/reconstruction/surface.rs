//! Extraction of a trained hand at growing resolution: it is to grow with the surface.

use std::cell::OnceCell;

use criterion::{BenchmarkId, Criterion};
use meshway::reconstruction::network::{Architecture, Engine, engine};
use meshway::reconstruction::sampling::Samples;
use meshway::reconstruction::settings::{self, Preset};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::surface::{Field, Request, extract};
use meshway::reconstruction::vector::Bounds;
use meshway::reconstruction::{Event, Observer, reconstruct};

/// A network that was trained on a hand, and the box to look for its surface in.
struct Hand {
    engine: Box<dyn Engine<f32>>,
    parameters: Vec<f32>,
    bounds: Bounds,
}

struct Nobody;

impl Observer for Nobody {
    fn event(&self, _: Event<'_>) {}

    fn seconds(&self) -> f64 {
        0.0
    }
}

impl Hand {
    fn trained() -> Self {
        let mut settings = Preset::Balanced.settings();
        settings.training.max_evaluations = 400;
        // The mesh of this run is not looked at.
        settings.surface.resolution = 64;
        let cloud = sample(&Shape::Hand, &Recipe::default());
        let made = reconstruct(&cloud, &settings, &Nobody).expect("a hand can be reconstructed");
        let architecture = Architecture::new(&settings.network);
        let none = Samples::default();
        let engine = engine(settings::Engine::Auto, &architecture, &none)
            .expect("there is an engine for the preset");
        let points = cloud.points.iter().map(|&p| made.model.frame.to_unit(p));
        let bounds = Bounds::of(points).expect("there are points");
        Self {
            engine,
            parameters: made.model.parameters.iter().map(|&p| p as f32).collect(),
            bounds: bounds.padded(settings.surface.padding * bounds.longest_edge()),
        }
    }

    fn field(&self) -> Box<dyn Field + '_> {
        let field = self.engine.field(&self.parameters);
        field.expect("the parameters are those of the network")
    }
}

pub(super) fn extraction(criterion: &mut Criterion) {
    // Only when a piece is asked for.
    let hand = OnceCell::new();
    let mut group = criterion.benchmark_group("extraction");
    group.sample_size(10);
    for resolution in [128, 256, 512] {
        group.bench_function(BenchmarkId::from_parameter(resolution), |bencher| {
            let hand = hand.get_or_init(Hand::trained);
            let field = hand.field();
            let request = Request::new(hand.bounds, resolution);
            bencher.iter(|| extract(field.as_ref(), &request).expect("the hand has a surface"));
        });
    }
    group.finish();
    if hand.get().is_some() {
        tell_peak_memory();
    }
}

#[expect(
    clippy::print_stdout,
    reason = "it belongs into the table of the benchmark"
)]
fn tell_peak_memory() {
    // Linux only; elsewhere there is nothing to tell.
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    if let Some(peak) = status.lines().find_map(|line| line.strip_prefix("VmHWM:")) {
        println!("peak memory after the extractions: {}", peak.trim());
    }
}
