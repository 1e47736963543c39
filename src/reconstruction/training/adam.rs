//! Adam on the full batch.

use serde::{Deserialize, Serialize};

use super::iterate::{Interrupt, Iterate, Objective, Step};
use crate::reconstruction::network::Scalar;

/// Decay of the first moment; this and the next two are the defaults of \[KB15\] and of PyTorch.
const BETA1: f64 = 0.9;
/// Decay of the second moment.
const BETA2: f64 = 0.999;
/// Keeps the division finite.
const EPSILON: f64 = 1e-8;

/// State of Adam (\[KB15\] algorithm 1) between two steps. The moments are f64 whatever the precision
/// of the parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Adam {
    learning_rate: f64,
    first_moment: Vec<f64>,
    second_moment: Vec<f64>,
    steps: i32,
}

impl Adam {
    /// Starts at an iterate of `dimension` parameters.
    pub fn new(dimension: usize, learning_rate: f64) -> Self {
        Self {
            learning_rate,
            first_moment: vec![0.0; dimension],
            second_moment: vec![0.0; dimension],
            steps: 0,
        }
    }

    /// Makes one step and one evaluation, that at its end.
    ///
    /// # Errors
    /// What the objective reports. The caller checks that the result is finite.
    pub fn step<T: Scalar>(
        &mut self,
        at: &mut Iterate<T>,
        objective: &mut Objective<'_, T>,
    ) -> Result<Step, Interrupt> {
        self.steps += 1;
        let correction1 = 1.0 - BETA1.powi(self.steps);
        let correction2 = 1.0 - BETA2.powi(self.steps);
        let moments = self.first_moment.iter_mut().zip(&mut self.second_moment);
        let mut parameters = at.parameters.clone();
        for ((parameter, g), (m, v)) in parameters.iter_mut().zip(&at.gradient).zip(moments) {
            let g = g.to_f64();
            *m = BETA1 * *m + (1.0 - BETA1) * g;
            *v = BETA2 * *v + (1.0 - BETA2) * g * g;
            let change = *m / correction1 / ((*v / correction2).sqrt() + EPSILON);
            *parameter = T::from_f64(parameter.to_f64() - self.learning_rate * change);
        }
        let mut gradient = vec![T::ZERO; parameters.len()];
        let loss = objective(&mut parameters, &mut gradient)?;
        *at = Iterate {
            parameters,
            loss,
            gradient,
        };
        Ok(Step {
            length: self.learning_rate,
            termination: None,
        })
    }
}
