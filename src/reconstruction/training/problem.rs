//! What training minimises.

use super::linear_algebra::dot;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::{Engine, Scalar};
use crate::reconstruction::settings::OutputLayer;

/// Least weight decay of an output layer that is solved for: it keeps the solution a smooth function of the
/// hidden layers where their outputs are nearly dependent.
const LEAST_DECAY: f64 = 2e-3;

/// The loss over the samples of an engine, and λ/2 |parameters|².
#[derive(Clone, Copy)]
pub struct Problem<'a, T> {
    /// Evaluates the loss.
    pub engine: &'a dyn Engine<T>,
    /// λ; 0 in \[N24\].
    pub weight_decay: f64,
    /// Whether the output layer is solved for. f is linear in it, so that its best weights for given hidden
    /// layers are those of a linear least-squares problem; what is left is a function of the hidden layers,
    /// whose gradient is that of the loss at the solution (Golub, Pereyra, "The differentiation of
    /// pseudo-inverses and nonlinear least squares problems whose variables separate", 1973).
    pub output_layer: OutputLayer,
}

impl<T: Scalar> Problem<'_, T> {
    /// Loss and gradient; an output layer that is solved for is set to its solution, and the gradient along
    /// it to 0.
    pub(super) fn loss_and_gradient(
        &self,
        parameters: &mut [T],
        gradient: &mut [T],
    ) -> Result<f64, Error> {
        let output = self.engine.architecture().output_layer();
        let solves = self.output_layer == OutputLayer::Solved;
        let output_decay = if solves {
            self.weight_decay.max(LEAST_DECAY)
        } else {
            self.weight_decay
        };
        if solves {
            let equations = self.engine.output_equations(parameters)?;
            // Without a solution the hidden layers are out of range, and so will the loss be.
            let solution = equations.solve(output_decay).unwrap_or_default();
            for (parameter, value) in parameters[output.clone()].iter_mut().zip(solution) {
                *parameter = T::from_f64(value);
            }
        }
        let mut loss = self.engine.loss_and_gradient(parameters, gradient)?;
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
