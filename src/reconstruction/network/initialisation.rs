//! The parameters that training starts from.

use rand_distr::{Distribution, StandardNormal};

use super::{Architecture, Scalar};
use crate::reconstruction::random::{Generator, Purpose, stream};

/// Bias that keeps the gates of `highway` mostly shut at the start, so that layers pass their
/// input on: T = sigmoid(-1) ≈ 0.27 (\[N24\] section 2).
const GATE_BIAS: f64 = -1.0;

/// Xavier normal weights, N(0, 2 / (rows + columns)) (equation 12 of \[GB10\] as a normal
/// distribution of the same variance), and biases 0; gates have biases -1.
///
/// # Determinism
/// Drawn in f64 in the order of the parameters, then rounded: `f32` and `f64` start alike.
pub fn initial_parameters<T: Scalar>(architecture: &Architecture, seed: u64) -> Vec<T> {
    draw(architecture, &mut stream(seed, Purpose::Initialisation))
}

/// The same, drawn from where `generator` stands.
pub(super) fn draw<T: Scalar>(architecture: &Architecture, generator: &mut Generator) -> Vec<T> {
    let mut parameters = vec![T::ZERO; architecture.parameter_count()];
    for layer in architecture.layers() {
        let deviation = (2.0 / (layer.rows + layer.columns) as f64).sqrt();
        for weight in &mut parameters[layer.weight] {
            let normal: f64 = StandardNormal.sample(generator);
            *weight = T::from_f64(deviation * normal);
        }
        if layer.name.starts_with("gate") {
            parameters[layer.bias].fill(T::from_f64(GATE_BIAS));
        }
    }
    parameters
}
