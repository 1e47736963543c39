//! The reference engine: libtorch's tensors and automatic differentiation, every scheme, both
//! precisions.
//!
//! The number of threads is global to libtorch and is set by whoever starts the run
//! (`tch::set_num_threads`). With the same number the same bits come out.

use std::marker::PhantomData;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tch::{Kind, TchError, Tensor, no_grad};

use super::{Architecture, Engine, OutputEquations, Scalar};
use crate::reconstruction::error::Error;
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::settings::Scheme;
use crate::reconstruction::surface::Field;
use crate::reconstruction::vector::Vec3;

/// Points of a field that are evaluated at once: the activations of one layer stay in the cache
/// (measured: a few times more or fewer cost 10 to 50 % more).
const CHUNK: usize = 2048;

/// A network and its samples in libtorch.
#[derive(Debug)]
pub struct Libtorch<T> {
    architecture: Architecture,
    batch: Batch,
    scalar: PhantomData<T>,
}

impl<T: Scalar> Libtorch<T> {
    /// An engine over these samples.
    ///
    /// # Errors
    /// When libtorch refuses a tensor.
    pub fn new(architecture: Architecture, samples: &Samples) -> Result<Self, Error> {
        Ok(Self {
            architecture,
            batch: Batch::new::<T>(samples)?,
            scalar: PhantomData,
        })
    }
}

impl<T: Scalar> Engine<T> for Libtorch<T> {
    fn name(&self) -> &'static str {
        "libtorch"
    }

    fn architecture(&self) -> &Architecture {
        &self.architecture
    }

    fn training_samples(&self) -> usize {
        self.batch.count
    }

    fn loss_and_gradient(&self, parameters: &[T], gradient: &mut [T]) -> Result<f64, Error> {
        let flat = Tensor::f_from_slice(parameters)?.f_set_requires_grad(true)?;
        let network = Network::new(&self.architecture, &flat)?;
        let loss = self.batch.loss(&network)?;
        let derivative = Tensor::f_run_backward(&[&loss], &[&flat], false, false)?;
        derivative[0].f_copy_data(gradient, parameters.len())?;
        Ok(loss.f_double_value(&[])?)
    }

    fn output_equations(&self, parameters: &[T]) -> Result<OutputEquations, Error> {
        no_grad(|| {
            let flat = Tensor::f_from_slice(parameters)?;
            let network = Network::new(&self.architecture, &flat)?;
            self.batch.output_equations(&network)
        })
    }

    fn field(&self, parameters: &[T]) -> Result<Box<dyn Field + '_>, Error> {
        let flat = Tensor::f_from_slice(parameters)?;
        Ok(Box::new(NetworkField {
            network: Mutex::new(Network::new(&self.architecture, &flat)?),
            scalar: PhantomData::<T>,
        }))
    }
}

/// Samples as tensors: points [n, 3], the others [n, 1].
#[derive(Debug)]
struct Batch {
    points: Tensor,
    targets: Tensor,
    /// Least and greatest values that cost nothing; None where all are the target, as in \[N24\].
    free: Option<[Tensor; 2]>,
    /// None when all are 1, as in \[N24\]: one pass less.
    weights: Option<Tensor>,
    count: usize,
}

impl Batch {
    fn new<T: Scalar>(samples: &Samples) -> Result<Self, TchError> {
        let column = |values: &[f64]| {
            let values: Vec<T> = values.iter().map(|v| T::from_f64(*v)).collect();
            Tensor::f_from_slice(&values)?.f_view((-1, 1))
        };
        let weighted = samples.weights.iter().any(|w| (w - 1.0).abs() > 0.0);
        Ok(Self {
            points: points_tensor::<T>(&samples.points)?,
            targets: column(&samples.targets)?,
            free: if samples.one_sided.contains(&true) {
                let bound = |side: usize| {
                    let bounds = (0..samples.len()).map(|i| samples.free_range(i)[side]);
                    column(&bounds.collect::<Vec<_>>())
                };
                Some([bound(0)?, bound(1)?])
            } else {
                None
            },
            weights: weighted.then(|| column(&samples.weights)).transpose()?,
            count: samples.points.len(),
        })
    }

    /// The normal equations of the output layer, in f64.
    fn output_equations(&self, network: &Network) -> Result<OutputEquations, Error> {
        let a = network.hidden(&self.points)?.f_to_kind(Kind::Double)?;
        let a = Tensor::f_cat(&[&a, &a.f_narrow(1, 0, 1)?.f_ones_like()?], 1)?;
        let weighted = match &self.weights {
            Some(weights) => a.f_mul(weights)?,
            None => a.shallow_clone(),
        };
        let mean = |factor: &Tensor| -> Result<Vec<f64>, Error> {
            let sum = weighted.f_tr()?.f_matmul(factor)?;
            let mean = sum.f_div_scalar(self.count as f64)?.f_flatten(0, -1)?;
            let mut values = vec![0.0; mean.numel()];
            let length = values.len();
            mean.f_contiguous()?.f_copy_data(&mut values, length)?;
            Ok(values)
        };
        Ok(OutputEquations {
            matrix: mean(&a)?,
            right: mean(&self.targets.f_to_kind(Kind::Double)?)?,
        })
    }

    /// Mean weighted squared error.
    fn loss(&self, network: &Network) -> Result<Tensor, TchError> {
        let values = network.values(&self.points)?;
        let residual = match &self.free {
            Some([lower, upper]) => {
                values.f_sub(&values.f_clamp_tensor(Some(lower), Some(upper))?)?
            }
            None => values.f_sub(&self.targets)?,
        };
        let square = residual.f_square()?;
        match &self.weights {
            Some(weights) => square.f_mul(weights)?.f_mean(None),
            None => square.f_mean(None),
        }
    }
}

fn points_tensor<T: Scalar>(points: &[Vec3]) -> Result<Tensor, TchError> {
    let flat = points.as_flattened();
    let flat: Vec<T> = flat.iter().map(|v| T::from_f64(*v)).collect();
    Tensor::f_from_slice(&flat)?.f_view((points.len() as i64, 3))
}

/// The layers as views into one tensor of parameters, so that one backward pass gives the flat
/// gradient.
#[derive(Debug)]
struct Network<'a> {
    architecture: &'a Architecture,
    /// Weight (rows × columns) and bias (rows) of the linear layers, then of the gates or encoders.
    layers: Vec<(Tensor, Tensor)>,
}

impl<'a> Network<'a> {
    fn new(architecture: &'a Architecture, flat: &Tensor) -> Result<Self, TchError> {
        let layers = architecture.layers();
        let sizes: Vec<i64> = layers
            .iter()
            .flat_map(|layer| [layer.weight.len() as i64, layer.bias.len() as i64])
            .collect();
        let mut parts = flat.f_split_with_sizes(&sizes, 0)?.into_iter();
        let layers = layers
            .iter()
            .map_while(|layer| Some((layer, parts.next()?, parts.next()?)))
            .map(|(layer, weight, bias)| {
                let shape = (layer.rows as i64, layer.columns as i64);
                Ok((weight.f_view(shape)?, bias))
            })
            .collect::<Result<_, TchError>>()?;
        Ok(Self {
            architecture,
            layers,
        })
    }

    /// f at points [n, 3], as [n, 1].
    fn values(&self, points: &Tensor) -> Result<Tensor, TchError> {
        self.affine(self.architecture.hidden_layers, &self.hidden(points)?)
    }

    /// Outputs of the last hidden layer at points [n, 3], as [n, width].
    fn hidden(&self, points: &Tensor) -> Result<Tensor, TchError> {
        let hidden_layers = self.architecture.hidden_layers;
        let encoders = self.encoders(points)?;
        let mut a = points.shallow_clone();
        for h in 1..=hidden_layers {
            let z = self.affine(h - 1, &a)?;
            let tanh = z.f_tanh()?;
            let scheme = if self.architecture.carries_residual(h) {
                self.architecture.scheme
            } else {
                Scheme::Plain
            };
            a = match scheme {
                Scheme::Plain => tanh,
                Scheme::Resnet => tanh.f_add(&a)?,
                Scheme::Highway => {
                    // The gate of layer 2 stands behind the linear layers and the output.
                    let gate = self.affine(hidden_layers + h - 1, &a)?.f_sigmoid()?;
                    a.f_lerp_tensor(&tanh, &gate)?
                }
                Scheme::Hw => tanh.f_add(&z)?,
                Scheme::Sqrhw => tanh.f_addcmul(&z, &z)?,
                Scheme::Gated => match &encoders {
                    Some([u, v]) => u.f_lerp_tensor(v, &tanh)?,
                    None => tanh,
                },
            };
        }
        Ok(a)
    }

    /// u and v of `gated` at points [n, 3], where it has them: its last two layers.
    fn encoders(&self, points: &Tensor) -> Result<Option<[Tensor; 2]>, TchError> {
        if self.architecture.encoders() == 0 {
            return Ok(None);
        }
        let first = self.architecture.hidden_layers + 1;
        let encoder = |k: usize| self.affine(first + k, points)?.f_tanh();
        Ok(Some([encoder(0)?, encoder(1)?]))
    }

    fn affine(&self, layer: usize, a: &Tensor) -> Result<Tensor, TchError> {
        let (weight, bias) = &self.layers[layer];
        a.f_linear(weight, Some(bias))
    }
}

/// A network with fixed parameters. Tensors are used by one thread at a time.
struct NetworkField<'a, T> {
    network: Mutex<Network<'a>>,
    scalar: PhantomData<T>,
}

impl<'a, T> NetworkField<'a, T> {
    fn network(&self) -> MutexGuard<'_, Network<'a>> {
        // Nothing happens under the lock that could leave the network half changed.
        self.network.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Scalar> Field for NetworkField<'_, T> {
    fn values(&self, points: &[Vec3], values: &mut [f64]) -> Result<(), Error> {
        let network = self.network();
        no_grad(|| {
            for (points, values) in points.chunks(CHUNK).zip(values.chunks_mut(CHUNK)) {
                let f = network.values(&points_tensor::<T>(points)?)?;
                copy_to::<T>(&f, values)?;
            }
            Ok(())
        })
    }

    fn values_and_gradients(
        &self,
        points: &[Vec3],
        values: &mut [f64],
        gradients: &mut [Vec3],
    ) -> Result<(), Error> {
        let chunks = points
            .chunks(CHUNK)
            .zip(values.chunks_mut(CHUNK))
            .zip(gradients.chunks_mut(CHUNK));
        let network = self.network();
        for ((points, values), gradients) in chunks {
            let points = points_tensor::<T>(points)?.f_set_requires_grad(true)?;
            let f = network.values(&points)?;
            // Each value depends on its own point only: the gradient of the sum has all of them.
            let derivative = Tensor::f_run_backward(&[&f.f_sum(None)?], &[&points], false, false)?;
            copy_to::<T>(&f, values)?;
            copy_to::<T>(&derivative[0], gradients.as_flattened_mut())?;
        }
        Ok(())
    }
}

fn copy_to<T: Scalar>(tensor: &Tensor, values: &mut [f64]) -> Result<(), TchError> {
    let mut buffer = vec![T::ZERO; values.len()];
    tensor.f_copy_data(&mut buffer, values.len())?;
    for (value, v) in values.iter_mut().zip(buffer) {
        *value = v.to_f64();
    }
    Ok(())
}
