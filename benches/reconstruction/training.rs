//! One evaluation of loss and gradient, and what L-BFGS adds to it.

use criterion::{BatchSize, Criterion};
use meshway::reconstruction::cloud::Label;
use meshway::reconstruction::network::{
    Architecture, Engine, Libtorch, Scalar, engine, initial_parameters,
};
use meshway::reconstruction::sampling::Samples;
use meshway::reconstruction::settings::{self, Scheme};
use meshway::reconstruction::shapes::{Recipe, Shape, sample};
use meshway::reconstruction::training::{Interrupt, Iterate, Lbfgs, Options};

/// 3-50x5-1, the network of \[N24\].
fn architecture(scheme: Scheme) -> Architecture {
    Architecture {
        scheme,
        width: 50,
        hidden_layers: 5,
        residual_every: 2,
    }
}

/// A hand in the sizes of \[N24\]: 3000 surface points and 500 interior ones.
fn hand() -> Samples {
    let recipe = Recipe {
        interior: 500,
        ..Recipe::default()
    };
    let cloud = sample(&Shape::Hand, &recipe);
    let targets = (0..cloud.points.len()).map(|i| cloud.label(i).target());
    assert_eq!(cloud.indices(Label::Surface).count(), 3_000);
    cloud.points.iter().copied().zip(targets).collect()
}

pub(super) fn loss(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("loss and gradient");
    group.bench_function("plain f32", |b| evaluate::<f32>(b, Scheme::Plain));
    group.bench_function("sqrhw f32", |b| evaluate::<f32>(b, Scheme::Sqrhw));
    group.bench_function("sqrhw f64", |b| evaluate::<f64>(b, Scheme::Sqrhw));
    group.bench_function("sqrhw f32, fused", fused);
    group.finish();
}

fn evaluate<T: Scalar>(bencher: &mut criterion::Bencher<'_>, scheme: Scheme) {
    tch::set_num_threads(1);
    let parameters = initial_parameters::<T>(&architecture(scheme), 1);
    let engine = Libtorch::<T>::new(architecture(scheme), &hand());
    let engine = engine.expect("libtorch takes the samples");
    let mut gradient = vec![T::ZERO; parameters.len()];
    bencher.iter(|| engine.loss_and_gradient(&parameters, &mut gradient));
}

/// With all threads.
fn fused(bencher: &mut criterion::Bencher<'_>) {
    let architecture = architecture(Scheme::Sqrhw);
    let parameters = initial_parameters::<f32>(&architecture, 1);
    let engine = engine::<f32>(settings::Engine::Fused, &architecture, &hand());
    let engine = engine.expect("sqrhw is supported");
    let mut gradient = vec![0.0; parameters.len()];
    bencher.iter(|| engine.loss_and_gradient(&parameters, &mut gradient));
}

/// Pairs that [N24] keeps.
const PAIRS: usize = 100;

pub(super) fn lbfgs(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("L-BFGS iteration with 100 pairs");
    group.bench_function("f32", iterate::<f32>);
    group.bench_function("f64", iterate::<f64>);
    group.finish();
}

fn iterate<T: Scalar>(bencher: &mut criterion::Bencher<'_>) {
    let dimension = architecture(Scheme::Sqrhw).parameter_count();
    let options = Options {
        learning_rate: 1.0,
        history: PAIRS,
        tolerance_gradient: 0.0,
        tolerance_change: 0.0,
        max_iterations: u64::MAX,
        max_evaluations: u64::MAX,
    };
    let start = vec![T::from_f64(1.0); dimension];
    let mut at = Iterate::new(start, &mut valley).expect("the loss is finite");
    let mut lbfgs = Lbfgs::new(dimension, options, 1);
    for _ in 0..PAIRS {
        lbfgs
            .step(&mut at, &mut valley)
            .expect("far from the minimum");
    }
    bencher.iter_batched_ref(
        || (lbfgs.clone(), at.clone()),
        |(lbfgs, at)| lbfgs.step(at, &mut valley),
        BatchSize::PerIteration,
    );
}

/// ½ Σ cᵢ xᵢ² with cᵢ from 1 to 10⁴: costs next to nothing, and a hundred steps do not solve it.
#[expect(clippy::unnecessary_wraps, reason = "an objective may be interrupted")]
fn valley<T: Scalar>(x: &mut [T], gradient: &mut [T]) -> Result<f64, Interrupt> {
    let last = (x.len() - 1) as f64;
    let mut value = 0.0;
    for (i, (x, g)) in x.iter().zip(gradient).enumerate() {
        let curvature = 1.0 + 9_999.0 * i as f64 / last;
        let slope = curvature * x.to_f64();
        value += 0.5 * slope * x.to_f64();
        *g = T::from_f64(slope);
    }
    Ok(value)
}
