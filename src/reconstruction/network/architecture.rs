//! The shape of a network, and where each layer lies in its flat parameter vector.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::Scalar;
use crate::reconstruction::settings::{Network, Scheme};

/// Fully connected network: `hidden_layers` layers of equal width and a linear output
/// (\[N24\] section 2).
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Architecture {
    /// Residual scheme of the hidden layers.
    pub scheme: Scheme,
    /// Neurons of each hidden layer, at least 1.
    pub width: usize,
    /// Number of hidden layers, at least 1.
    pub hidden_layers: usize,
    /// `hw` and `sqrhw` put the residual on hidden layers 1, 1 + n, 1 + 2n, ….
    pub residual_every: usize,
}

/// One affine map z = W a + b.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Layer {
    /// `linear.0`, … to the output; `gate.0`, … from the second hidden layer (`highway`); `encoder.0` and `encoder.1`
    /// of the point (`gated`).
    pub name: String,
    /// Length of z.
    pub rows: usize,
    /// Length of a.
    pub columns: usize,
    /// Where W lies in the parameters, row by row.
    pub weight: Range<usize>,
    /// Where b lies in the parameters.
    pub bias: Range<usize>,
}

impl Architecture {
    /// The shape that the settings ask for.
    pub fn new(network: &Network) -> Self {
        Self {
            scheme: network.scheme,
            width: network.width,
            hidden_layers: network.hidden_layers,
            residual_every: network.residual_every,
        }
    }

    /// The shape of the network of a block.
    pub fn of_block(network: &Network) -> Self {
        Self {
            width: network.block_width,
            hidden_layers: network.block_layers,
            ..Self::new(network)
        }
    }

    /// All layers in the order of their parameters, which is that of PyTorch's `parameters()`:
    /// weight and bias of each linear layer from input to output, then those of the gates or encoders.
    pub fn layers(&self) -> Vec<Layer> {
        let named = |name: &'static str, count| (0..count).map(move |k| format!("{name}.{k}"));
        let names = named("linear", self.hidden_layers + 1)
            .chain(named("gate", self.gates()))
            .chain(named("encoder", self.encoders()));
        let mut start = 0;
        names
            .zip(self.shapes())
            .map(|(name, [rows, columns])| {
                let weight = start..start + rows * columns;
                let bias = weight.end..weight.end + rows;
                start = bias.end;
                Layer {
                    name,
                    rows,
                    columns,
                    weight,
                    bias,
                }
            })
            .collect()
    }

    /// Rows and columns of each layer, in the same order.
    fn shapes(&self) -> impl Iterator<Item = [usize; 2]> {
        let (width, last) = (self.width, self.hidden_layers);
        let linear = (0..=last).map(move |k| {
            [
                if k == last { 1 } else { width },
                if k == 0 { 3 } else { width },
            ]
        });
        linear
            .chain(std::iter::repeat_n([width, width], self.gates()))
            .chain(std::iter::repeat_n([width, 3], self.encoders()))
    }

    /// Where weight and bias of the output layer lie in the parameters.
    pub fn output_layer(&self) -> Range<usize> {
        let before = count(self.shapes().take(self.hidden_layers));
        before..before + self.width + 1
    }

    /// Number of gate layers.
    fn gates(&self) -> usize {
        match self.scheme {
            Scheme::Highway => self.hidden_layers.saturating_sub(1),
            _ => 0,
        }
    }

    /// Number of encoders of the point: two, where there is a layer to blend them.
    pub(super) fn encoders(&self) -> usize {
        match self.scheme {
            Scheme::Gated if self.hidden_layers > 1 => 2,
            _ => 0,
        }
    }

    /// Length of the parameter vector.
    pub fn parameter_count(&self) -> usize {
        count(self.shapes())
    }

    /// Whether hidden layer `h`, counted from 1, is more than tanh z.
    pub fn carries_residual(&self, h: usize) -> bool {
        match self.scheme {
            Scheme::Plain => false,
            // The first layer changes the dimension, so there is nothing of its length to carry.
            // The first layer of `gated` is what the encoders are: it has nothing to choose yet.
            Scheme::Resnet | Scheme::Highway | Scheme::Gated => h >= 2,
            Scheme::Hw | Scheme::Sqrhw => (h - 1).is_multiple_of(self.residual_every),
        }
    }

    /// Frobenius norm of each layer's weights, in the order of [`Self::layers`]; the root of the mean square
    /// over the members of an ensemble.
    pub fn weight_norms<T: Scalar>(&self, parameters: &[T]) -> Vec<f64> {
        let members = self.members(parameters);
        let norm = |layer: Layer| {
            let weights = members.clone().flat_map(|p| &p[layer.weight.clone()]);
            let sum: f64 = weights.map(|w| w.to_f64().powi(2)).sum();
            (sum / members.len() as f64).sqrt()
        };
        self.layers().into_iter().map(norm).collect()
    }
}

/// Weights and biases of layers of these shapes.
fn count(shapes: impl Iterator<Item = [usize; 2]>) -> usize {
    shapes.map(|[rows, columns]| rows * (columns + 1)).sum()
}
