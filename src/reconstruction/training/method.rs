//! Which optimiser steps: L-BFGS, Adam, or the one after the other.

use serde::{Deserialize, Serialize};

use super::Termination;
use super::adam::Adam;
use super::iterate::{Interrupt, Iterate, Objective, Step};
use super::lbfgs::{Lbfgs, Options};
use crate::reconstruction::network::Scalar;
use crate::reconstruction::settings::{Optimizer, Training};

/// The optimiser at work.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub(super) enum Method<T> {
    Adam(Adam),
    Lbfgs(Lbfgs<T>),
}

impl<T: Scalar> Method<T> {
    /// The one to begin with, after the first evaluation.
    pub(super) fn first(settings: &Training, dimension: usize) -> Self {
        match settings.optimizer {
            Optimizer::Lbfgs => Self::lbfgs(settings, dimension, 1),
            Optimizer::Adam | Optimizer::AdamLbfgs => {
                Self::Adam(Adam::new(dimension, settings.adam_learning_rate))
            }
        }
    }

    fn lbfgs(settings: &Training, dimension: usize, evaluations: u64) -> Self {
        let options = Options {
            learning_rate: settings.learning_rate,
            history: settings.history,
            tolerance_gradient: settings.tolerance_gradient,
            tolerance_change: settings.tolerance_change,
            max_iterations: settings.max_iterations,
            max_evaluations: settings.max_evaluations,
        };
        Self::Lbfgs(Lbfgs::new(dimension, options, evaluations))
    }

    /// Goes from Adam to L-BFGS when it is time; the last evaluation of Adam is the first of L-BFGS.
    pub(super) fn switch(&mut self, settings: &Training, at: &Iterate<T>, evaluations: u64) {
        let due = settings.optimizer == Optimizer::AdamLbfgs
            && evaluations >= settings.adam_evaluations.max(1);
        if due && matches!(self, Self::Adam(_)) {
            *self = Self::lbfgs(settings, at.parameters.len(), evaluations);
        }
    }

    /// One accepted step.
    pub(super) fn step(
        &mut self,
        at: &mut Iterate<T>,
        settings: &Training,
        objective: &mut Objective<'_, T>,
    ) -> Result<Step, Interrupt> {
        match self {
            Self::Lbfgs(lbfgs) => lbfgs.step(at, objective),
            Self::Adam(_) if at.is_stationary(settings.tolerance_gradient) => {
                Err(Interrupt::Stop(Termination::ConvergedGradient))
            }
            Self::Adam(_) if settings.max_evaluations <= 1 => {
                Err(Interrupt::Stop(Termination::MaxEvaluations))
            }
            Self::Adam(adam) => adam.step(at, objective),
        }
    }
}
