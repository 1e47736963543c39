//! Histograms of the gradient, layer by layer: the figure of \[N24\] on vanishing gradients.

use super::{GradientHistogram, LayerHistogram};
use crate::reconstruction::network::{Architecture, Scalar};

/// Number of bins.
const BINS: usize = 100;

impl GradientHistogram {
    /// Histograms of ∂L/∂W of each layer, over all members of an ensemble; `gradient` is finite.
    pub fn new<T: Scalar>(architecture: &Architecture, gradient: &[T], evaluation: u64) -> Self {
        let layers = architecture.layers().into_iter();
        let layers = layers.map(|layer| {
            let members = architecture.members(gradient);
            let of_members = members.flat_map(|gradient| &gradient[layer.weight.clone()]);
            let values: Vec<f64> = of_members.map(|g| g.to_f64()).collect();
            LayerHistogram::new(layer.name, &values)
        });
        Self {
            evaluation,
            layers: layers.collect(),
        }
    }
}

impl LayerHistogram {
    fn new(layer: String, values: &[f64]) -> Self {
        let values = || values.iter().copied();
        let min = values().fold(f64::INFINITY, f64::min);
        let max = values().fold(f64::NEG_INFINITY, f64::max);
        let mut counts = vec![0; BINS];
        for value in values() {
            // The right edge belongs to the last bin; equal values (0/0) all fall into the first.
            let bin = (value - min) / (max - min) * BINS as f64;
            counts[(bin as usize).min(BINS - 1)] += 1;
        }
        Self {
            layer,
            min,
            max,
            counts,
        }
    }
}
