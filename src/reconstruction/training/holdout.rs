//! Early stopping: on the hold-out, or, without one, where the loss itself stands still.

use serde::{Deserialize, Serialize};

use super::iterate::Iterate;
use super::problem::Problem;
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;

/// Share of the work of an evaluation that an accepted step may spend on the hold-out.
const WORK_SHARE: f64 = 0.1;
/// Work of a loss with its gradient over that of a loss alone: besides the forward product, each
/// layer has one product for the weights and one for the activations.
const GRADIENT_WORK: f64 = 3.0;

/// Without a hold-out, the share by which the loss must fall to count as an improvement. Weight decay keeps
/// it from falling for ever.
const LEAST_FALL: f64 = 0.01;

/// Watches the validation loss and keeps the best parameters; without a hold-out, the loss.
pub(super) struct Holdout<'a, T> {
    problem: Problem<'a, T>,
    /// Evaluations without improvement that are allowed; 0: any number.
    patience: u64,
    /// Accepted steps from one validation loss to the next.
    interval: u64,
    best: Option<Chosen<T>>,
}

/// Parameters that training may end with.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub(super) struct Chosen<T> {
    pub(super) parameters: Vec<T>,
    pub(super) evaluation: u64,
    pub(super) loss: f64,
    pub(super) validation_loss: Option<f64>,
}

impl<'a, T: Scalar> Holdout<'a, T> {
    pub(super) fn new(problem: Problem<'a, T>, patience: u64) -> Self {
        let training = problem.engine.training_samples().max(1) as f64;
        let work = problem.validation.len() as f64 / (GRADIENT_WORK * training);
        Self {
            problem,
            patience,
            interval: (work / WORK_SHARE).ceil().max(1.0) as u64,
            best: None,
        }
    }

    /// The best so far, where it is kept.
    pub(super) fn best(&self) -> Option<&Chosen<T>> {
        self.best.as_ref()
    }

    /// Goes on from the best of an interrupted run.
    pub(super) fn resume(&mut self, best: Option<Chosen<T>>) {
        self.best = best;
    }

    /// The validation loss of an accepted iterate, where it is due.
    pub(super) fn visit(
        &mut self,
        at: &Iterate<T>,
        iteration: u64,
        evaluation: u64,
    ) -> Result<Option<f64>, Error> {
        if !iteration.is_multiple_of(self.interval) {
            return Ok(None);
        }
        let validation_loss = self.problem.validation_loss(&at.parameters)?;
        let improves = match (&self.best, validation_loss) {
            (None, loss) => loss.is_none_or(f64::is_finite),
            (Some(best), Some(loss)) => best.validation_loss.is_none_or(|lowest| loss < lowest),
            (Some(best), None) => at.loss < (1.0 - LEAST_FALL) * best.loss,
        };
        if improves && self.patience > 0 {
            self.best = Some(Chosen {
                parameters: at.parameters.clone(),
                evaluation,
                loss: at.loss,
                validation_loss,
            });
        }
        Ok(validation_loss)
    }

    /// Whether there has been no improvement for `patience` evaluations.
    pub(super) fn exhausted(&self, evaluation: u64) -> bool {
        let best = self.best.as_ref();
        self.patience > 0 && best.is_some_and(|b| evaluation - b.evaluation >= self.patience)
    }

    /// The best parameters on the hold-out, where they were kept, else the last.
    pub(super) fn choose(
        mut self,
        last: Iterate<T>,
        iteration: u64,
        evaluation: u64,
    ) -> Result<Chosen<T>, Error> {
        // The last iterate need not have been due.
        self.interval = 1;
        let validation_loss = self.visit(&last, iteration, evaluation)?;
        let best = self.best.filter(|best| best.validation_loss.is_some());
        Ok(best.unwrap_or(Chosen {
            parameters: last.parameters,
            evaluation,
            loss: last.loss,
            validation_loss,
        }))
    }
}
