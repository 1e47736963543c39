//! Loss and gradient by each engine, beside PyTorch and JAX, in one run: `make bench-engines`.
//!
//! Engines and peers take turns, so that what else the machine does hits them alike; the fastest
//! evaluation of each counts. The figures go to `target/bench/engines.json` too.

#![expect(
    clippy::inline_always,
    clippy::print_stdout,
    reason = "compiles for an instruction set; prints a table"
)]

mod peers;

use std::fs;
use std::hint::black_box;
use std::time::Instant;

use meshway::reconstruction::network::{Architecture, Engine, Fused, Libtorch, initial_parameters};
use meshway::reconstruction::sampling::Samples;
use meshway::reconstruction::settings::Scheme;
use peers::Peers;
use pulp::{Arch, Simd, WithSimd};
use serde_json::{Value, json};

/// Points and width.
const SIZES: [(usize, usize); 6] = [
    (3_500, 50),
    (11_000, 50),
    (3_500, 100),
    (11_000, 100),
    (3_500, 200),
    (11_000, 200),
];

/// How often each takes its turn.
const ROUNDS: usize = 8;

/// Seconds of evaluations in one turn, about.
const TURN: f64 = 0.25;

/// Threads of the second column of the fused engine.
const THREADS: usize = 2;

fn main() {
    tch::set_num_threads(1);
    let mut peers = Peers::start();
    if peers.is_none() {
        println!("PyTorch and JAX are left out: `make bench-engines` installs them.");
    }
    println!(
        "| points × width | FMA peak | libtorch | PyTorch | JAX | fused | products of the peak | to PyTorch | to JAX | {THREADS} threads |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let rows: Vec<Value> = SIZES
        .iter()
        .map(|&(points, width)| measure(points, width, peers.as_mut()))
        .collect();
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/bench");
    let text = serde_json::to_string_pretty(&rows).expect("figures are plain numbers");
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(format!("{folder}/engines.json"), text))
        .expect("target/ can be written");
}

/// One row of the table.
fn measure(points: usize, width: usize, mut peers: Option<&mut Peers>) -> Value {
    let architecture = Architecture {
        scheme: Scheme::Sqrhw,
        width,
        hidden_layers: 5,
        residual_every: 2,
    };
    let samples = samples(points);
    let fused = Fused::new(architecture.clone(), &samples).expect("sqrhw is supported");
    let libtorch =
        Libtorch::<f32>::new(architecture.clone(), &samples).expect("libtorch takes the samples");
    let parameters = initial_parameters::<f32>(&architecture, 1);
    let [one, many] = [1, THREADS].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads can be started")
    });

    let mut best = [f64::INFINITY; 6];
    let mut least = |column: usize, seconds: f64| best[column] = best[column].min(seconds);
    for _ in 0..ROUNDS {
        least(
            0,
            fastest(|| {
                Arch::new().dispatch(MultiplyAdds);
            }),
        );
        least(1, fastest(|| evaluation(&libtorch, &parameters)));
        if let Some(peers) = &mut peers {
            least(2, peers.fastest("torch", points, width));
            least(3, peers.fastest("jax", points, width));
        }
        least(
            4,
            one.install(|| fastest(|| evaluation(&fused, &parameters))),
        );
        least(
            5,
            many.install(|| fastest(|| evaluation(&fused, &parameters))),
        );
    }
    let [peak, libtorch, torch, jax, fused, threads] = best;
    let peak = Arch::new().dispatch(MultiplyAdds) as f64 / peak / 1e9;
    let rate = operations(&architecture, points) / fused / 1e9;
    let ms = |seconds: f64| format!("{:.2} ms", 1e3 * seconds);
    println!(
        "| {points} × {width} | {peak:.0} GFLOP/s | {} | {} | {} | {} | {:.0} % | {:.2} | {:.2} | {} ({:.2} times) |",
        ms(libtorch),
        ms(torch),
        ms(jax),
        ms(fused),
        100.0 * rate / peak,
        torch / fused,
        jax / fused,
        ms(threads),
        fused / threads,
    );
    json!({
        "points": points, "width": width, "fma_peak_gflops": peak, "libtorch_seconds": libtorch,
        "pytorch_seconds": torch, "jax_seconds": jax, "fused_seconds": fused,
        "fused_gflops": rate, "threads": THREADS, "fused_threads_seconds": threads,
    })
}

/// Points in a cube with unlike targets.
fn samples(count: usize) -> Samples {
    let spread = |i: usize, step: f64| (i as f64 * step).fract() * 2.0 - 1.0;
    let points = (0..count).map(|i| [0.618_034, 0.754_878, 0.569_840].map(|step| spread(i, step)));
    points
        .map(|[x, y, z]| ([x, y, z], (x * y + z).tanh()))
        .collect()
}

/// Operations of the matrix products: each weight is multiplied and added once on the way there,
/// twice on the way back, but that nothing flows back through the first layer.
fn operations(architecture: &Architecture, points: usize) -> f64 {
    let layers = architecture.layers();
    let weights: usize = layers.iter().map(|layer| layer.weight.len()).sum();
    let first = layers[0].weight.len();
    (points * 2 * (3 * weights - first)) as f64
}

fn evaluation(engine: &dyn Engine<f32>, parameters: &[f32]) {
    let mut gradient = vec![0.0; parameters.len()];
    let loss = engine.loss_and_gradient(parameters, &mut gradient);
    black_box((loss.expect("the engine takes its parameters"), gradient));
}

/// Seconds of the fastest call in one turn.
fn fastest(mut call: impl FnMut()) -> f64 {
    let begin = Instant::now();
    let mut best = f64::INFINITY;
    while begin.elapsed().as_secs_f64() < TURN {
        let start = Instant::now();
        call();
        best = best.min(start.elapsed().as_secs_f64());
    }
    best
}

/// Multiply-adds that do not wait for each other: enough to hide their latency.
const CHAINS: usize = 12;

/// Multiply-adds of each chain, some tenths of a millisecond.
const LENGTH: usize = 100_000;

/// Multiply-adds in registers and nothing else; returns the number of operations.
struct MultiplyAdds;

impl WithSimd for MultiplyAdds {
    type Output = usize;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> usize {
        let [factor, term] = [0.999, 0.001].map(|v| simd.splat_f32s(black_box(v)));
        let mut sums = [simd.splat_f32s(1.0); CHAINS];
        for _ in 0..LENGTH {
            for sum in &mut sums {
                *sum = simd.mul_add_e_f32s(*sum, factor, term);
            }
        }
        black_box(sums.map(|sum| simd.reduce_sum_f32s(sum)));
        2 * CHAINS * LENGTH * S::F32_LANES
    }
}
