//! L-BFGS with a strong Wolfe line search, one accepted step at a time.
//!
//! Follows `torch.optim.LBFGS` (\[N24\] uses it), so that its runs can be repeated evaluation by
//! evaluation: first step, curvature test, scaling, and every stopping test in its order. The
//! direction is algorithm 7.4 of \[NW06\]. Deviations, besides those of the line search:
//!
//! - A search makes at most 25 evaluations; recent versions of PyTorch limit it only by what is
//!   left of the whole budget, and may overrun that by one.
//! - A pair is stored at the end of its step, not at the start of the next one, so that nothing
//!   but this struct and the [`Iterate`] is needed to go on; the numbers are the same.
//! - Scalars (loss, curvature, slope) are f64 even where the parameters are f32.
//! - Where every trial of a search is not finite, this is an error.

use serde::{Deserialize, Serialize};

use super::Termination;
use super::iterate::{Interrupt, Iterate, Objective, Step};
use super::line_search::{Line, strong_wolfe};
use super::linear_algebra::{difference, dot, max_norm, scaled, sum_norm};
use super::pairs::Pairs;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;

/// Most evaluations of one line search.
const SEARCH_EVALUATIONS: u64 = 25;

/// What steers L-BFGS; the fields mean the same as in [`crate::reconstruction::settings::Training`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// First trial step of each line search.
    pub learning_rate: f64,
    /// Pairs that are kept.
    pub history: usize,
    /// Stop when no component of the gradient is larger.
    pub tolerance_gradient: f64,
    /// Stop when neither the loss nor any parameter changes by more.
    pub tolerance_change: f64,
    /// Most accepted steps.
    pub max_iterations: u64,
    /// Most evaluations, those before the first step included.
    pub max_evaluations: u64,
}

/// State of L-BFGS between two steps. Saved and restored together with its [`Iterate`], it goes on
/// bit by bit as if it had never stopped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct Lbfgs<T> {
    options: Options,
    pairs: Pairs<T>,
    iterations: u64,
    evaluations: u64,
}

impl<T: Scalar> Lbfgs<T> {
    /// Starts at an iterate of `dimension` parameters for which `evaluations` were made so far.
    pub fn new(dimension: usize, options: Options, evaluations: u64) -> Self {
        Self {
            pairs: Pairs::new(dimension, options.history),
            options,
            iterations: 0,
            evaluations,
        }
    }

    /// Accepted steps so far.
    pub fn iterations(&self) -> u64 {
        self.iterations
    }

    /// Evaluations so far, up to the last accepted step.
    pub fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Makes one step. When it is interrupted, `at` is as it was before, and the step can be made
    /// again with the same outcome.
    ///
    /// # Errors
    /// [`Interrupt::Stop`] when no step is to be made: the start is stationary, a limit is reached,
    /// or the direction no longer descends. [`Error::TrainingDiverged`] when nothing finite lies on
    /// the way; what the objective reports.
    pub fn step(
        &mut self,
        at: &mut Iterate<T>,
        objective: &mut Objective<'_, T>,
    ) -> Result<Step, Interrupt> {
        self.check_start(at)?;
        let direction = self.pairs.direction(&at.gradient);
        let slope = dot(&at.gradient, &direction);
        if slope > -self.options.tolerance_change {
            return Err(Interrupt::Stop(Termination::ConvergedChange));
        }
        let line = Line {
            start: at,
            direction: &direction,
            slope,
        };
        let budget = (self.options.max_evaluations - self.evaluations).min(SEARCH_EVALUATIONS);
        let found = strong_wolfe(&line, self.first_step(at), budget, objective)?;
        let evaluations = self.evaluations + found.evaluations;
        if let Some(loss) = found.diverged {
            let evaluation = evaluations;
            return Err(Error::TrainingDiverged { evaluation, loss }.into());
        }

        let length = found.trial.step;
        let step = scaled(length, &direction);
        let change = difference(&found.trial.gradient, &at.gradient);
        self.pairs.push(&step, &change);
        self.iterations += 1;
        self.evaluations = evaluations;
        let loss_change = found.trial.loss - at.loss;
        *at = Iterate {
            parameters: found.trial.parameters,
            loss: found.trial.loss,
            gradient: found.trial.gradient,
        };
        Ok(Step {
            length,
            termination: self.termination(at, max_norm(&step), loss_change),
        })
    }

    fn check_start(&self, at: &Iterate<T>) -> Result<(), Interrupt> {
        let stop = if self.iterations == 0 && at.is_stationary(self.options.tolerance_gradient) {
            Termination::ConvergedGradient
        } else if self.iterations >= self.options.max_iterations {
            Termination::MaxIterations
        } else if self.evaluations >= self.options.max_evaluations {
            Termination::MaxEvaluations
        } else {
            return Ok(());
        };
        Err(Interrupt::Stop(stop))
    }

    /// The first trial of a search; without pairs the gradient says nothing of the right length, so
    /// the first of all moves the parameters by no more than the learning rate in sum.
    fn first_step(&self, at: &Iterate<T>) -> f64 {
        let rate = self.options.learning_rate;
        if self.iterations == 0 {
            (1.0 / sum_norm(&at.gradient)).min(1.0) * rate
        } else {
            rate
        }
    }

    /// The stopping tests after a step, in the order of PyTorch.
    fn termination(
        &self,
        at: &Iterate<T>,
        largest_move: f64,
        loss_change: f64,
    ) -> Option<Termination> {
        let options = &self.options;
        if self.iterations >= options.max_iterations {
            Some(Termination::MaxIterations)
        } else if self.evaluations >= options.max_evaluations {
            Some(Termination::MaxEvaluations)
        } else if at.is_stationary(options.tolerance_gradient) {
            Some(Termination::ConvergedGradient)
        } else if largest_move <= options.tolerance_change
            || loss_change.abs() < options.tolerance_change
        {
            Some(Termination::ConvergedChange)
        } else {
            None
        }
    }
}
