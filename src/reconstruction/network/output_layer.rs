//! The output layer as the solution of a linear least-squares problem.

use super::{Architecture, Scalar};
use crate::reconstruction::cholesky;

/// What makes L least over the output layer while the hidden layers stay as they are.
///
/// With a the outputs of the last hidden layer, followed by a 1 for the bias, and m their number, f = c · a.
#[derive(Debug, Clone, PartialEq)]
pub struct OutputEquations {
    /// 1/n Σ wᵢ aᵢ aᵢᵀ, `[m, m]`.
    pub matrix: Vec<f64>,
    /// 1/n Σ wᵢ yᵢ aᵢ, `[m]`.
    pub right: Vec<f64>,
}

impl OutputEquations {
    /// The c that makes L + `decay`/2 |c|² least, weights first; `None` where the equations are singular or
    /// not finite.
    pub fn solve(mut self, decay: f64) -> Option<Vec<f64>> {
        let m = self.right.len();
        for diagonal in self.matrix.iter_mut().step_by(m + 1) {
            *diagonal += 0.5 * decay;
        }
        cholesky::solve(&mut self.matrix, m, &mut self.right)?;
        Some(self.right)
    }
}

/// Sets the output layer of `parameters` to a solution. Without one it stays as it is: its equations are not finite
/// then, and so will the loss be, or singular, and it is one of many that fit as well.
pub(super) fn set_output_layer<T: Scalar>(
    architecture: &Architecture,
    parameters: &mut [T],
    solution: Option<Vec<f64>>,
) {
    let output = &mut parameters[architecture.output_layer()];
    for (parameter, value) in output.iter_mut().zip(solution.unwrap_or_default()) {
        *parameter = T::from_f64(value);
    }
}
