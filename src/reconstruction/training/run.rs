//! The loop around the optimisers: which one steps, when it ends, and what comes out.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::checkpoint::{Refusal, State};
use super::holdout::Holdout;
use super::iterate::{Interrupt, Iterate};
use super::method::Method;
use super::monitor::{Hooks, Monitor};
use super::problem::Problem;
use super::{Metrics, Termination};
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::observer::{Event, Warning};
use crate::reconstruction::settings::Training;

/// A trained network.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(bound = "T: Scalar")]
pub struct Trained<T> {
    /// The best on the hold-out where `patience` is set and there is one, else the last.
    pub parameters: Vec<T>,
    /// Evaluations that were made when `parameters` were reached.
    pub parameters_evaluation: u64,
    /// Training loss of `parameters`, weight decay included.
    pub loss: f64,
    /// Validation loss of `parameters`; none without a hold-out.
    pub validation_loss: Option<f64>,
    /// Why training ended.
    pub termination: Termination,
    /// Accepted steps in all.
    pub iterations: u64,
    /// Evaluations of loss and gradient in all.
    pub evaluations: u64,
}

/// Fits the network to the training samples of the problem, starting from `parameters`, or from the
/// checkpoint that the observer has.
///
/// # Errors
/// [`Error::TrainingDiverged`] when loss or gradient stop being finite; [`Error::Cancelled`] when
/// the observer stops the run before its first evaluation (later this is a [`Termination`]); what
/// the engine and the snapshot hook report. [`Error::Interrupted`] when the observer wants room;
/// it has got a checkpoint then, unless this comes before the first iteration.
///
/// # Determinism
/// The same arguments give the same result, bit by bit also over interruptions, unless
/// `time_limit_seconds` ends the run.
pub fn train<'a, T: Scalar>(
    problem: Problem<'a, T>,
    parameters: Vec<T>,
    settings: &'a Training,
    hooks: Hooks<'a, T>,
) -> Result<Trained<T>, Error> {
    let mut run = match Run::start(problem, parameters, settings, hooks) {
        Ok(run) => run,
        Err(Interrupt::Stop(_)) => return Err(Error::Cancelled),
        Err(Interrupt::Failed(error)) => return Err(error),
    };
    let termination = loop {
        if let Some(termination) = run.ended {
            break termination;
        }
        match run.step() {
            Ok(None) => run.checkpoint()?,
            Ok(Some(termination)) | Err(Interrupt::Stop(termination)) => run.end(termination),
            Err(Interrupt::Failed(error)) => return Err(error),
        }
    };
    run.finish(termination)
}

struct Run<'a, T> {
    monitor: Monitor<'a, T>,
    settings: &'a Training,
    at: Iterate<T>,
    method: Method<T>,
    holdout: Holdout<'a, T>,
    iterations: u64,
    ended: Option<Termination>,
}

impl<'a, T: Scalar> Run<'a, T> {
    fn start(
        problem: Problem<'a, T>,
        parameters: Vec<T>,
        settings: &'a Training,
        hooks: Hooks<'a, T>,
    ) -> Result<Self, Interrupt> {
        let mut monitor = Monitor::new(problem, settings, hooks);
        if let Some(data) = monitor.observer().checkpoint() {
            match State::decode(data, monitor.identity(), parameters.len()) {
                Ok(state) => return Ok(Self::resume(monitor, settings, state)),
                Err(refusal) => monitor.observer().event(Event::Warning(&warning(refusal))),
            }
        }
        let at = Iterate::new(parameters, &mut |p, g| monitor.evaluate(p, g))?;
        let mut holdout = Holdout::new(problem, settings.patience);
        holdout.visit(&at, 0, monitor.evaluations())?;
        Ok(Self {
            method: Method::first(settings, at.parameters.len()),
            monitor,
            settings,
            at,
            holdout,
            iterations: 0,
            ended: None,
        })
    }

    /// Goes on where an interrupted run stood.
    fn resume(
        mut monitor: Monitor<'a, T>,
        settings: &'a Training,
        state: State<'static, T>,
    ) -> Self {
        monitor.resume(state.evaluations, state.elapsed_seconds);
        let mut holdout = Holdout::new(monitor.problem(), settings.patience);
        holdout.resume(state.best.map(Cow::into_owned));
        Self {
            monitor,
            settings,
            at: state.at.into_owned(),
            method: state.method.into_owned(),
            holdout,
            iterations: state.iterations,
            ended: state.ended,
        }
    }

    /// Hands out the state between two iterations where that is due, and ends the run when room is
    /// wanted.
    fn checkpoint(&self) -> Result<(), Error> {
        let observer = self.monitor.observer();
        let released = observer.released();
        if released || observer.checkpoint_due() {
            self.hand_out(&self.method);
        }
        if released {
            return Err(Error::Interrupted);
        }
        Ok(())
    }

    /// Notes why training ended, and hands out a last state: what comes after it may be interrupted
    /// too, and training shall not be repeated then.
    fn end(&mut self, termination: Termination) {
        self.ended = Some(termination);
        if termination != Termination::Cancelled {
            // No step follows: the pairs, nearly all of a state, are not needed.
            self.hand_out(&Method::first(self.settings, self.at.parameters.len()));
        }
    }

    fn hand_out(&self, method: &Method<T>) {
        let state = State {
            at: Cow::Borrowed(&self.at),
            method: Cow::Borrowed(method),
            best: self.holdout.best().map(Cow::Borrowed),
            iterations: self.iterations,
            evaluations: self.monitor.evaluations(),
            elapsed_seconds: self.monitor.elapsed_seconds(),
            ended: self.ended,
        };
        self.monitor.observer().event(Event::Checkpoint {
            evaluation: state.evaluations,
            data: &state.encode(self.monitor.identity()),
        });
    }

    /// One accepted step; the reason when it was the last.
    fn step(&mut self) -> Result<Option<Termination>, Interrupt> {
        let (at, monitor, settings) = (&mut self.at, &mut self.monitor, self.settings);
        let before = monitor.evaluations();
        self.method.switch(settings, at, before);
        let step = self
            .method
            .step(at, settings, &mut |p, g| monitor.evaluate(p, g))?;
        let evaluation = monitor.evaluations();
        at.require_finite(evaluation)?;
        self.iterations += 1;
        let validation_loss = self.holdout.visit(at, self.iterations, evaluation)?;
        let architecture = monitor.problem().engine.architecture();
        monitor.tell(&Metrics {
            iteration: self.iterations,
            evaluation,
            loss: at.loss,
            validation_loss,
            gradient_norm: at.gradient_norm(),
            step_length: step.length,
            weight_norms: architecture.weight_norms(&at.parameters),
            blocks: None,
        });
        Ok(if step.termination.is_some() {
            step.termination
        } else if evaluation >= settings.max_evaluations {
            Some(Termination::MaxEvaluations)
        } else if self.holdout.exhausted(evaluation) {
            Some(Termination::NoImprovement)
        } else if monitor.is_enough(before, &at.parameters)? {
            Some(Termination::HandedOver)
        } else {
            None
        })
    }

    fn finish(self, termination: Termination) -> Result<Trained<T>, Error> {
        let evaluations = self.monitor.evaluations();
        let chosen = self.holdout.choose(self.at, self.iterations, evaluations)?;
        Ok(Trained {
            parameters: chosen.parameters,
            parameters_evaluation: chosen.evaluation,
            loss: chosen.loss,
            validation_loss: chosen.validation_loss,
            termination,
            iterations: self.iterations,
            evaluations,
        })
    }
}

fn warning(refusal: Refusal) -> Warning {
    Warning::new(
        "checkpoint_refused",
        format!("training starts anew, because the checkpoint {refusal}"),
    )
}
