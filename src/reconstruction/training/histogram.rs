//! Histograms of the gradient, layer by layer: the figure of \[N24\] on vanishing gradients.

use super::{GradientHistogram, LayerHistogram};
use crate::reconstruction::network::{Architecture, Scalar};

/// Number of bins.
const BINS: usize = 100;

impl GradientHistogram {
    /// Histograms of ∂L/∂W of each layer; `gradient` is as long as the parameters, and finite.
    pub fn new<T: Scalar>(architecture: &Architecture, gradient: &[T], evaluation: u64) -> Self {
        let layers = architecture.layers().into_iter();
        let layers = layers.map(|layer| LayerHistogram::new(layer.name, &gradient[layer.weight]));
        Self {
            evaluation,
            layers: layers.collect(),
        }
    }
}

impl LayerHistogram {
    fn new<T: Scalar>(layer: String, values: &[T]) -> Self {
        let values = || values.iter().map(|v| v.to_f64());
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
