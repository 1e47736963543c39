//! What the optimisers share: where they stand, what they minimise, what one step gives.

use serde::{Deserialize, Serialize};

use super::Termination;
use super::linear_algebra::{dot, max_norm};
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;

/// What is minimised: returns the loss at the given parameters and writes its gradient. Values
/// that are not finite are allowed: the line search backs away from them. Parameters that it solves for
/// it sets to the solution; its gradient along them is 0.
pub type Objective<'a, T> = dyn FnMut(&mut [T], &mut [T]) -> Result<f64, Interrupt> + 'a;

/// Why an optimiser makes no further step.
#[derive(Debug)]
pub enum Interrupt {
    /// Training ends, and where it stands is its result.
    Stop(Termination),
    /// There is no result.
    Failed(Error),
}

impl From<Error> for Interrupt {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

/// One accepted step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Step length along the search direction.
    pub length: f64,
    /// Set when this was the last step.
    pub termination: Option<Termination>,
}

/// Parameters, with the loss and its gradient there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct Iterate<T> {
    /// Parameters of the network.
    pub parameters: Vec<T>,
    /// Loss at the parameters, finite.
    pub loss: f64,
    /// Gradient at the parameters, finite.
    pub gradient: Vec<T>,
}

impl<T: Scalar> Iterate<T> {
    /// Evaluates the objective at `parameters`.
    ///
    /// # Errors
    /// [`Error::TrainingDiverged`] unless loss and gradient are finite; what the objective reports.
    pub fn new(
        mut parameters: Vec<T>,
        objective: &mut Objective<'_, T>,
    ) -> Result<Self, Interrupt> {
        let mut gradient = vec![T::ZERO; parameters.len()];
        let loss = objective(&mut parameters, &mut gradient)?;
        let iterate = Self {
            parameters,
            loss,
            gradient,
        };
        iterate.require_finite(1)?;
        Ok(iterate)
    }

    /// An error unless loss and gradient are finite.
    pub(super) fn require_finite(&self, evaluation: u64) -> Result<(), Interrupt> {
        let loss = self.loss;
        if loss.is_finite() && self.gradient_norm().is_finite() {
            return Ok(());
        }
        Err(Error::TrainingDiverged { evaluation, loss }.into())
    }

    /// Euclidean norm of the gradient.
    pub fn gradient_norm(&self) -> f64 {
        dot(&self.gradient, &self.gradient).sqrt()
    }

    /// Whether no component of the gradient is larger than `tolerance`.
    pub fn is_stationary(&self, tolerance: f64) -> bool {
        max_norm(&self.gradient) <= tolerance
    }
}
