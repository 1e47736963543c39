//! What a job told since its rows were last written: how far it is, its series, its events.

use std::time::Instant;

use serde_json::json;

use crate::jobs::{NewEvent, Record};
use crate::reconstruction::training::{GradientHistogram, Metrics};
use crate::reconstruction::{Phase, Warning};

/// Gathers until the next write. Of progress and metrics only the newest becomes an event: the
/// series itself is in the metric rows.
pub(super) struct Pending {
    record: Record,
    share: Option<f64>,
    newest: Option<Metrics>,
    phase: Phase,
    meter: Meter,
    /// Metric rows that the job may still have.
    rows_left: i64,
}

impl Pending {
    pub(super) fn new(rows_left: i64) -> Self {
        Self {
            record: Record::default(),
            share: None,
            newest: None,
            phase: Phase::Sampling,
            meter: Meter::new(),
            rows_left,
        }
    }

    pub(super) fn phase(&mut self, phase: Phase) {
        // Its last metrics come before the stage that follows.
        self.close_metrics();
        self.phase = phase;
        self.share = Some(0.0);
        self.record.phase = Some(phase);
        self.event("job.phase", json!({ "phase": phase }));
    }

    pub(super) fn progress(&mut self, share: f64) {
        self.share = Some(share);
    }

    pub(super) fn metrics(&mut self, metrics: Metrics) {
        self.rows_left -= 1;
        if self.rows_left >= 0 {
            self.record.metrics.push(metrics.clone());
        } else if self.rows_left == -1 {
            self.warning(&Warning::new(
                "metrics_limit",
                "no further rows of the training series are kept",
            ));
        }
        self.newest = Some(metrics);
    }

    pub(super) fn gradients(&mut self, histogram: GradientHistogram) {
        self.record.gradients.push(histogram);
    }

    pub(super) fn warning(&mut self, warning: &Warning) {
        self.event("job.warning", json!(warning));
    }

    /// What is to be written now; `None` when nothing was told.
    pub(super) fn take(&mut self) -> Option<Record> {
        self.close_metrics();
        if let Some(share) = self.share.take() {
            let fraction = whole(self.phase, share);
            let eta_seconds = self.meter.remaining(fraction);
            self.record.progress = Some(fraction);
            self.record.eta_seconds = eta_seconds;
            let data = json!({ "fraction": fraction, "eta_seconds": eta_seconds });
            self.event("job.progress", data);
        }
        let record = std::mem::take(&mut self.record);
        (record != Record::default()).then_some(record)
    }

    fn close_metrics(&mut self) {
        if let Some(metrics) = self.newest.take() {
            self.record.evaluations = Some(metrics.evaluation);
            self.record.loss = Some(metrics.loss);
            self.event("training.metrics", json!(metrics));
        }
    }

    fn event(&mut self, kind: &str, data: serde_json::Value) {
        self.record.events.push(NewEvent::new(kind, data));
    }
}

/// Share of the whole work, from that of a stage. The stages' parts are those of the preset
/// `balanced`, measured roughly.
fn whole(phase: Phase, share: f64) -> f64 {
    let (from, to) = match phase {
        Phase::Sampling => (0.0, 0.05),
        Phase::Training => (0.05, 0.85),
        Phase::Surface => (0.85, 0.97),
        Phase::Report => (0.97, 1.0),
    };
    from + (to - from) * share.clamp(0.0, 1.0)
}

/// Estimates the end from the speed of this attempt, which may have begun in the middle.
struct Meter {
    start: Instant,
    first: Option<f64>,
}

impl Meter {
    fn new() -> Self {
        Self {
            start: Instant::now(),
            first: None,
        }
    }

    fn remaining(&mut self, fraction: f64) -> Option<f64> {
        let done = fraction - *self.first.get_or_insert(fraction);
        let elapsed = self.start.elapsed().as_secs_f64();
        // Earlier an estimate would be noise.
        (done > 0.02).then(|| elapsed * (1.0 - fraction) / done)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn metrics(evaluation: u64) -> Metrics {
        Metrics {
            iteration: evaluation,
            evaluation,
            loss: 1.0 / evaluation as f64,
            validation_loss: None,
            gradient_norm: 1.0,
            step_length: 1.0,
            weight_norms: vec![1.0],
        }
    }

    fn kinds(record: &Record) -> Vec<&str> {
        record
            .events
            .iter()
            .map(|event| event.event.as_str())
            .collect()
    }

    #[test]
    fn all_rows_are_kept_and_only_the_newest_is_an_event() {
        let mut pending = Pending::new(100);
        pending.phase(Phase::Training);
        (1..=5).for_each(|evaluation| pending.metrics(metrics(evaluation)));
        pending.progress(0.5);
        let record = pending.take().unwrap();
        assert_eq!(
            kinds(&record),
            ["job.phase", "training.metrics", "job.progress"]
        );
        assert_eq!(record.metrics.len(), 5);
        assert_eq!(record.evaluations, Some(5));
        // Half of the training's part, 0.05 to 0.85.
        assert!((record.progress.unwrap() - 0.45).abs() < 1e-12);
        assert_eq!(pending.take(), None);
    }

    #[test]
    fn the_last_metrics_come_before_the_next_stage() {
        let mut pending = Pending::new(100);
        pending.metrics(metrics(1));
        pending.phase(Phase::Surface);
        let record = pending.take().unwrap();
        assert_eq!(
            kinds(&record),
            ["training.metrics", "job.phase", "job.progress"]
        );
    }

    #[test]
    fn rows_end_at_their_limit_with_one_warning() {
        let mut pending = Pending::new(2);
        (1..=5).for_each(|evaluation| pending.metrics(metrics(evaluation)));
        let record = pending.take().unwrap();
        assert_eq!(record.metrics.len(), 2);
        assert_eq!(kinds(&record), ["job.warning", "training.metrics"]);
        assert_eq!(record.evaluations, Some(5));
    }
}
