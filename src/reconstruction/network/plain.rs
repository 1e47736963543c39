//! f in plain Rust: for the few points that are asked about after training, in a process that
//! must not load tensors. Slower than `libtorch`, and independent of it.

use super::{Architecture, Layer};
use crate::reconstruction::error::Error;
use crate::reconstruction::settings::Scheme;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::Vec3;

/// Points that go through the layers together: the innermost loops run over them, and the
/// activations of 512 neurons with their derivatives still fit a level-2 cache.
const BLOCK: usize = 32;

/// A network with fixed parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct PlainNetwork {
    architecture: Architecture,
    layers: Vec<Layer>,
    parameters: Vec<f64>,
}

impl PlainNetwork {
    /// The network with these parameters, in the order of [`Architecture::layers`]; `None` where
    /// their number is another.
    pub fn new(architecture: Architecture, parameters: Vec<f64>) -> Option<Self> {
        let layers = architecture.layers();
        (parameters.len() == architecture.parameter_count()).then_some(Self {
            architecture,
            layers,
            parameters,
        })
    }

    /// f, and with four lanes ∂f/∂x, ∂f/∂y, ∂f/∂z behind it, at up to [`BLOCK`] points.
    ///
    /// Derivatives go forward with the values: three directions are too few for a backward pass to
    /// pay, and it would keep all layers.
    fn block<const LANES: usize>(&self, points: &[Vec3]) -> Activations<LANES> {
        let hidden_layers = self.architecture.hidden_layers;
        let mut a = Activations::of(points);
        let encoders = self.encoders(&a);
        for h in 1..=hidden_layers {
            let z = self.affine(h - 1, &a);
            let residual = self.architecture.carries_residual(h);
            a = match (self.architecture.scheme, &encoders) {
                (Scheme::Gated, Some([u, v])) if residual => combine([&z, u, v], |[z, u, v]| {
                    let t = z.tanh();
                    (u + t * (v - u), [(1.0 - t * t) * (v - u), 1.0 - t, t])
                }),
                (Scheme::Resnet, _) if residual => combine([&z, &a, &z], |[z, a, _]| {
                    let t = z.tanh();
                    (t + a, [1.0 - t * t, 1.0, 0.0])
                }),
                (Scheme::Highway, _) if residual => {
                    // Gate k stands on hidden layer k + 2, behind the linear layers and the output.
                    let gate = self.affine(hidden_layers + h - 1, &a);
                    combine([&z, &a, &gate], |[z, a, q]| {
                        let (t, g) = (z.tanh(), 1.0 / (1.0 + (-q).exp()));
                        let slopes = [g * (1.0 - t * t), 1.0 - g, g * (1.0 - g) * (t - a)];
                        (a + g * (t - a), slopes)
                    })
                }
                (Scheme::Hw, _) if residual => combine([&z, &z, &z], |[z, ..]| {
                    let t = z.tanh();
                    (t + z, [2.0 - t * t, 0.0, 0.0])
                }),
                (Scheme::Sqrhw, _) if residual => combine([&z, &z, &z], |[z, ..]| {
                    let t = z.tanh();
                    (t + z * z, [1.0 - t * t + 2.0 * z, 0.0, 0.0])
                }),
                _ => tanh(&z),
            };
        }
        self.affine(hidden_layers, &a)
    }

    /// u and v of `gated`, where it has them: its last two layers.
    fn encoders<const LANES: usize>(
        &self,
        points: &Activations<LANES>,
    ) -> Option<[Activations<LANES>; 2]> {
        let first = self.architecture.hidden_layers + 1;
        let encoder = |k| tanh(&self.affine(first + k, points));
        (self.architecture.encoders() > 0).then(|| [0, 1].map(encoder))
    }

    /// W a + b; derivatives are mapped by W alone.
    fn affine<const LANES: usize>(
        &self,
        layer: usize,
        a: &Activations<LANES>,
    ) -> Activations<LANES> {
        let layer = &self.layers[layer];
        let weights = self.parameters[layer.weight.clone()].chunks_exact(layer.columns);
        let rows = weights.zip(&self.parameters[layer.bias.clone()]);
        let rows = rows.map(|(weights, bias)| {
            let mut row = [[0.0; BLOCK]; LANES];
            row[0] = [*bias; BLOCK];
            for (weight, a) in weights.iter().zip(&a.rows) {
                for (z, a) in row.as_flattened_mut().iter_mut().zip(a.as_flattened()) {
                    *z += weight * a;
                }
            }
            row
        });
        Activations {
            rows: rows.collect(),
        }
    }
}

impl Field for PlainNetwork {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        for (points, values) in points.chunks(BLOCK).zip(values.chunks_mut(BLOCK)) {
            let [f] = self.block::<1>(points).rows[0];
            values.copy_from_slice(&f[..values.len()]);
        }
        Ok(())
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        let chunks = points
            .chunks(BLOCK)
            .zip(values.chunks_mut(BLOCK))
            .zip(gradients.chunks_mut(BLOCK));
        for ((points, values), gradients) in chunks {
            let [f, dx, dy, dz] = self.block::<4>(points).rows[0];
            values.copy_from_slice(&f[..values.len()]);
            for (i, gradient) in gradients.iter_mut().enumerate() {
                *gradient = [dx[i], dy[i], dz[i]];
            }
        }
        Ok(())
    }
}

/// One row a neuron; lane 0 has the values at the points, lanes 1 to 3 their derivatives.
struct Activations<const LANES: usize> {
    rows: Vec<[[f64; BLOCK]; LANES]>,
}

impl<const LANES: usize> Activations<LANES> {
    /// The coordinates of the points, and the derivative of each by itself.
    fn of(points: &[Vec3]) -> Self {
        let rows = (0..3).map(|axis| {
            let mut row = [[0.0; BLOCK]; LANES];
            for (value, point) in row[0].iter_mut().zip(points) {
                *value = point[axis];
            }
            if let Some(derivative) = row.get_mut(axis + 1) {
                *derivative = [1.0; BLOCK];
            }
            row
        });
        Self {
            rows: rows.collect(),
        }
    }
}

fn tanh<const LANES: usize>(z: &Activations<LANES>) -> Activations<LANES> {
    combine([z, z, z], |[z, ..]| {
        let t = z.tanh();
        (t, [1.0 - t * t, 0.0, 0.0])
    })
}

/// Applies `unit`, which gives a value and its slopes by its three inputs, to each neuron.
fn combine<const LANES: usize>(
    inputs: [&Activations<LANES>; 3],
    unit: impl Fn([f64; 3]) -> (f64, [f64; 3]),
) -> Activations<LANES> {
    let neurons = 0..inputs[0].rows.len();
    let rows = neurons.map(|neuron| {
        let inputs = inputs.map(|input| &input.rows[neuron]);
        let mut row = [[0.0; BLOCK]; LANES];
        for i in 0..BLOCK {
            let (value, slopes) = unit(inputs.map(|input| input[0][i]));
            row[0][i] = value;
            for lane in 1..LANES {
                row[lane][i] = (0..3).map(|k| slopes[k] * inputs[k][lane][i]).sum();
            }
        }
        row
    });
    Activations {
        rows: rows.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Engine, Libtorch, initial_parameters};
    use super::*;
    use crate::reconstruction::sampling::Samples;

    #[test]
    fn values_and_gradients_are_those_of_libtorch() {
        // Not a multiple of the block, so that the last one is short.
        let points: Vec<Vec3> = (0..75)
            .map(|i| {
                let t = f64::from(i);
                [(0.7 * t).sin(), (1.3 * t).cos(), (0.1 * t).sin()]
            })
            .collect();
        for scheme in [
            Scheme::Plain,
            Scheme::Resnet,
            Scheme::Highway,
            Scheme::Hw,
            Scheme::Sqrhw,
            Scheme::Gated,
        ] {
            let architecture = Architecture {
                scheme,
                width: 7,
                hidden_layers: 4,
                residual_every: 2,
            };
            let parameters: Vec<f64> = initial_parameters(&architecture, 3);
            let none = Samples::default();
            let engine = Libtorch::<f64>::new(architecture.clone(), &none).unwrap();
            let reference = evaluate(engine.field(&parameters).unwrap().as_ref(), &points);
            let plain = PlainNetwork::new(architecture, parameters).unwrap();
            let ours = evaluate(&plain, &points);
            let mut values = vec![0.0; points.len()];
            plain.values(&points, &mut values).unwrap();
            for (i, (ours, reference)) in ours.iter().zip(&reference).enumerate() {
                assert!((values[i] - ours[0]).abs() < 1e-12, "{scheme:?}");
                for (a, b) in ours.iter().zip(reference) {
                    // Both in f64, sums of at most a hundred terms of order 1 in another order.
                    assert!((a - b).abs() < 1e-12, "{scheme:?}: {a} {b}");
                }
            }
        }
    }

    /// f and its gradient at each point.
    fn evaluate(field: &dyn Field, points: &[Vec3]) -> Vec<[f64; 4]> {
        let mut values = vec![0.0; points.len()];
        let mut gradients = vec![[0.0; 3]; points.len()];
        field
            .values_and_gradients(points, &mut values, &mut gradients)
            .unwrap();
        let both = values.iter().zip(&gradients);
        both.map(|(f, [x, y, z])| [*f, *x, *y, *z]).collect()
    }

    #[test]
    fn a_wrong_number_of_parameters_is_refused() {
        let architecture = Architecture {
            scheme: Scheme::Plain,
            width: 2,
            hidden_layers: 1,
            residual_every: 1,
        };
        assert!(PlainNetwork::new(architecture, vec![0.0; 10]).is_none());
    }
}
