//! What is done around each evaluation of the loss: counting, stopping from outside, histograms
//! and snapshots.

use std::ops::Range;

use super::checkpoint::Identity;
use super::iterate::Interrupt;
use super::problem::Problem;
use super::{GradientHistogram, Metrics, Termination};
use crate::reconstruction::error::Error;
use crate::reconstruction::network::Scalar;
use crate::reconstruction::observer::{Event, Observer};
use crate::reconstruction::settings::Training;

/// Does something with the parameters of one evaluation, whose number comes first.
pub type Snapshot<'a, T> = dyn FnMut(u64, &[T]) -> Result<(), Error> + 'a;

/// Told the evaluations of an accepted step, from that before its first to its last, and the parameters after it, says
/// whether training is to end there.
pub type Enough<'a, T> = dyn FnMut(Range<u64>, &[T]) -> Result<bool, Error> + 'a;

/// What training tells and asks.
pub struct Hooks<'a, T> {
    /// Hears of metrics, histograms and progress; lends the clock; can stop the run.
    pub observer: &'a dyn Observer,
    /// Called with the number of the evaluation and its parameters at each of
    /// `snapshot_evaluations`. Like a histogram it belongs to exactly that evaluation, which may
    /// be a trial of a line search, as in \[N24\].
    pub snapshot: &'a mut Snapshot<'a, T>,
    /// Asked after each accepted step whether others go on from there.
    pub enough: &'a mut Enough<'a, T>,
    /// What a checkpoint must belong to.
    pub identity: Identity,
}

/// Stands between the optimiser and the engine.
pub(super) struct Monitor<'a, T> {
    problem: Problem<'a, T>,
    settings: &'a Training,
    hooks: Hooks<'a, T>,
    started: f64,
    evaluations: u64,
}

impl<'a, T: Scalar> Monitor<'a, T> {
    pub(super) fn new(
        problem: Problem<'a, T>,
        settings: &'a Training,
        hooks: Hooks<'a, T>,
    ) -> Self {
        Self {
            problem,
            settings,
            started: hooks.observer.seconds(),
            hooks,
            evaluations: 0,
        }
    }

    pub(super) fn problem(&self) -> Problem<'a, T> {
        self.problem
    }

    /// Evaluations so far.
    pub(super) fn evaluations(&self) -> u64 {
        self.evaluations
    }

    /// Who listens to the run.
    pub(super) fn observer(&self) -> &'a dyn Observer {
        self.hooks.observer
    }

    /// What a checkpoint must belong to.
    pub(super) fn identity(&self) -> &Identity {
        &self.hooks.identity
    }

    /// Seconds of training so far, over all its runs.
    pub(super) fn elapsed_seconds(&self) -> f64 {
        self.hooks.observer.seconds() - self.started
    }

    /// Counts on from an interrupted run.
    pub(super) fn resume(&mut self, evaluations: u64, elapsed_seconds: f64) {
        self.evaluations = evaluations;
        self.started -= elapsed_seconds;
    }

    /// Loss and gradient, unless the run is to stop.
    pub(super) fn evaluate(
        &mut self,
        parameters: &mut [T],
        gradient: &mut [T],
    ) -> Result<f64, Interrupt> {
        self.check_stop()?;
        let loss = self.problem.loss_and_gradient(parameters, gradient)?;
        self.evaluations += 1;
        let due = |evaluations: &[u64]| evaluations.contains(&self.evaluations);
        let finite = loss.is_finite() && gradient.iter().all(|g| g.to_f64().is_finite());
        if finite && due(&self.settings.histogram_evaluations) {
            let architecture = self.problem.engine.architecture();
            let histogram = GradientHistogram::new(architecture, gradient, self.evaluations);
            self.hooks.observer.event(Event::Gradients(&histogram));
        }
        if finite && due(&self.settings.snapshot_evaluations) {
            (self.hooks.snapshot)(self.evaluations, parameters)?;
        }
        Ok(loss)
    }

    fn check_stop(&self) -> Result<(), Interrupt> {
        if self.hooks.observer.cancelled() {
            return Err(Interrupt::Stop(Termination::Cancelled));
        }
        let limit = self.settings.time_limit_seconds;
        // The first evaluation is always made: without it there is no loss to report.
        if limit > 0.0 && self.evaluations > 0 && self.elapsed_seconds() >= limit {
            return Err(Interrupt::Stop(Termination::TimeLimit));
        }
        Ok(())
    }

    /// Whether training is to end at these parameters, for others to go on.
    pub(super) fn is_enough(&mut self, before: u64, parameters: &[T]) -> Result<bool, Error> {
        (self.hooks.enough)(before..self.evaluations, parameters)
    }

    /// Passes on the metrics of an accepted step, and how far the run is.
    pub(super) fn tell(&self, metrics: &Metrics) {
        self.hooks.observer.event(Event::Metrics(metrics));
        let share = self.evaluations as f64 / self.settings.max_evaluations as f64;
        self.hooks.observer.event(Event::Progress(share.min(1.0)));
    }
}
