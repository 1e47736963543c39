//! What training minimises.

use super::linear_algebra::dot;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Engine, MeanField, Scalar};
use crate::reconstruction::sampling::Samples;
use crate::reconstruction::settings::OutputLayer;
use crate::reconstruction::surface::Field;

/// Least weight decay of an output layer that is solved for: it keeps the solution a smooth function of the
/// hidden layers where their outputs are nearly dependent.
const LEAST_DECAY: f64 = 2e-3;

/// The loss of a network over the samples of an engine, and λ/2 |parameters|²; of an ensemble, the mean over
/// its members, whose parameters stand one after the other.
///
/// The members share nothing but the steps of the optimiser. That costs some evaluations on clean points, and
/// leaves one run to follow, to interrupt and to take up again.
#[derive(Clone, Copy)]
pub struct Problem<'a, T> {
    /// Evaluates the loss of a network.
    pub engine: &'a dyn Engine<T>,
    /// Samples that the field is held against; none without a hold-out.
    pub validation: &'a Samples,
    /// λ; 0 in \[N24\].
    pub weight_decay: f64,
    /// Whether the output layer is solved for. f is linear in it, so that its best weights for given hidden
    /// layers are those of a linear least-squares problem; what is left is a function of the hidden layers,
    /// whose gradient is that of the loss at the solution (Golub, Pereyra, "The differentiation of
    /// pseudo-inverses and nonlinear least squares problems whose variables separate", 1973).
    pub output_layer: OutputLayer,
}

impl<'a, T: Scalar> Problem<'a, T> {
    /// The field of the network, or the mean of those of an ensemble.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn field(&self, parameters: &[T]) -> Result<MeanField<'a>, Error> {
        MeanField::of(self.engine, parameters)
    }

    /// Mean weighted squared error of the field at the validation samples; `None` without a hold-out.
    pub(super) fn validation_loss(&self, parameters: &[T]) -> Result<Option<f64>, Error> {
        let samples = self.validation;
        if samples.points.is_empty() {
            return Ok(None);
        }
        let mut values = vec![0.0; samples.len()];
        self.field(parameters)?
            .values(&samples.points, &mut values)?;
        let errors = values.iter().enumerate().map(|(i, f)| {
            let [lower, upper] = samples.free_range(i);
            // Not `clamp`, which panics where an end is not a number.
            samples.weights[i] * (f - f.max(lower).min(upper)).powi(2)
        });
        Ok(Some(errors.sum::<f64>() / samples.len() as f64))
    }

    /// Loss and gradient; an output layer that is solved for is set to its solution, and the gradient along
    /// it to 0.
    ///
    /// # Errors
    /// What the engine reports.
    pub fn loss_and_gradient(
        &self,
        parameters: &mut [T],
        gradient: &mut [T],
    ) -> Result<f64, Error> {
        let length = self.engine.architecture().parameter_count();
        let members = parameters.chunks(length).len();
        let mut sum = 0.0;
        for (parameters, gradient) in parameters
            .chunks_mut(length)
            .zip(gradient.chunks_mut(length))
        {
            sum += self.of_member(parameters, gradient)?;
            if members > 1 {
                let share = T::from_f64(1.0 / members as f64);
                for g in gradient {
                    *g = share * *g;
                }
            }
        }
        Ok(sum / members as f64)
    }

    fn of_member(&self, parameters: &mut [T], gradient: &mut [T]) -> Result<f64, Error> {
        let output = self.engine.architecture().output_layer();
        let solves = self.output_layer == OutputLayer::Solved;
        let output_decay = if solves {
            self.weight_decay.max(LEAST_DECAY)
        } else {
            self.weight_decay
        };
        let mut loss = if solves {
            self.engine
                .solved_loss_and_gradient(parameters, gradient, output_decay)?
        } else {
            self.engine.loss_and_gradient(parameters, gradient)?
        };
        if output_decay > 0.0 {
            let of_output = dot(&parameters[output.clone()], &parameters[output.clone()]);
            let of_all = dot(parameters, parameters);
            loss += 0.5 * (self.weight_decay * (of_all - of_output) + output_decay * of_output);
            let decay = T::from_f64(self.weight_decay);
            for (g, p) in gradient.iter_mut().zip(&*parameters) {
                *g += decay * *p;
            }
        }
        if solves {
            gradient[output].fill(T::ZERO);
        }
        Ok(loss)
    }
}
