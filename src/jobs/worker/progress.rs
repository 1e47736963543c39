//! What a job reported since the last write: progress, series, events.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use crate::jobs::{NewEvent, Record};
use crate::reconstruction::training::{GradientHistogram, Metrics};
use crate::reconstruction::{Phase, Warning};

/// Collects reports until the next write. Only the newest progress and metrics become events; the
/// whole series is in the metric rows.
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
            meter: Meter::default(),
            rows_left,
        }
    }

    pub(super) fn phase(&mut self, phase: Phase) {
        // Its last metrics come before the stage that follows.
        self.close_metrics();
        self.phase = phase;
        self.meter = Meter::default();
        self.share = Some(0.0);
        self.record.phase = Some(phase);
        self.record.events.push(NewEvent::Phase { phase });
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
        let event = NewEvent::Warning(warning.clone());
        self.record.events.push(event);
    }

    /// Takes what is to be written; `None` if nothing was reported.
    pub(super) fn take(&mut self) -> Option<Record> {
        self.close_metrics();
        if let Some(share) = self.share.take() {
            let fraction = whole(self.phase, share);
            // The start is not measured: a run that continues from a checkpoint jumps ahead from it.
            let eta_seconds = (share > 0.0)
                .then(|| self.meter.remaining(self.phase, share, Instant::now()))
                .flatten();
            self.record.progress = Some(fraction);
            self.record.eta_seconds = eta_seconds;
            self.record.events.push(NewEvent::Progress {
                fraction,
                eta_seconds,
            });
        }
        let record = std::mem::take(&mut self.record);
        (record != Record::default()).then_some(record)
    }

    fn close_metrics(&mut self) {
        if let Some(metrics) = self.newest.take() {
            self.record.evaluations = Some(metrics.evaluation);
            self.record.loss = Some(metrics.loss);
            self.record.events.push(NewEvent::Metrics(metrics));
        }
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

/// Time over which the speed of a stage is measured: an early line search must not set it for good.
const WINDOW: Duration = Duration::from_mins(1);
/// Shorter measurements are noise.
const SHORTEST: Duration = Duration::from_secs(1);

/// Estimates the end from the speed of the present stage.
#[derive(Default)]
struct Meter {
    /// Times and shares of the present stage, oldest first. The first may be in its middle.
    marks: VecDeque<(Instant, f64)>,
}

impl Meter {
    /// Estimated seconds to the end of the job at this share of the stage.
    fn remaining(&mut self, phase: Phase, share: f64, now: Instant) -> Option<f64> {
        self.marks.push_back((now, share));
        while let Some(&(second, _)) = self.marks.get(1)
            && self.marks.len() > 2
            && now - second > WINDOW
        {
            self.marks.pop_front();
        }
        let &(since, from) = self.marks.front()?;
        let elapsed = now - since;
        let afterwards = afterwards(phase)?;
        (share > from && elapsed >= SHORTEST).then(|| {
            let whole = elapsed.as_secs_f64() / (share - from);
            whole * (1.0 - share + afterwards)
        })
    }
}

/// How long the stages after this one take, as a share of its own time. The longer a training, the
/// less they count: this is for one of some minutes.
fn afterwards(phase: Phase) -> Option<f64> {
    match phase {
        // Nobody knows yet how fast training will be.
        Phase::Sampling => None,
        Phase::Training => Some(0.05),
        Phase::Surface => Some(0.2),
        Phase::Report => Some(0.0),
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
            blocks: None,
        }
    }

    fn kinds(record: &Record) -> Vec<&str> {
        record
            .events
            .iter()
            .map(|event| event.kind().name())
            .collect()
    }

    /// Estimates at so many seconds and shares of a training.
    fn estimates(marks: &[(f64, f64)]) -> Vec<Option<f64>> {
        let start = Instant::now();
        let mut meter = Meter::default();
        let estimate = |&(seconds, share): &(f64, f64)| {
            let now = start + Duration::from_secs_f64(seconds);
            meter.remaining(Phase::Training, share, now)
        };
        marks.iter().map(estimate).collect()
    }

    fn close(found: Option<f64>, expected: f64) -> bool {
        found.is_some_and(|found| (found - expected).abs() < 1e-6 * expected)
    }

    #[test]
    fn the_end_follows_from_the_speed_of_training() {
        // An hour of it, a tenth done at a time; the stages after it take 3 minutes.
        let marks: Vec<_> = (0..10)
            .map(|k| (360.0 * f64::from(k), 0.1 * f64::from(k)))
            .collect();
        let found = estimates(&marks);
        assert_eq!(found[0], None);
        for (k, &found) in found.iter().enumerate().skip(1) {
            let expected = 3_600.0 - 360.0 * k as f64 + 180.0;
            assert!(close(found, expected), "{k}: {found:?}");
        }
    }

    #[test]
    fn only_the_recent_speed_counts() {
        // Ten times slower after the first minute.
        let mut marks: Vec<_> = (0..=60)
            .map(|s| (f64::from(s), 0.01 * f64::from(s)))
            .collect();
        marks.extend((1..=120).map(|s| (60.0 + f64::from(s), 0.6 + 0.001 * f64::from(s))));
        let last = *estimates(&marks).last().unwrap();
        assert!(close(last, (0.28 + 0.05) * 1_000.0), "{last:?}");
    }

    #[test]
    fn a_training_that_goes_on_is_measured_from_there() {
        let found = estimates(&[(3.0, 0.8), (3.5, 0.805), (13.0, 0.9)]);
        assert_eq!(found[..2], [None, None]);
        assert!(close(found[2], 15.0), "{found:?}");
    }

    #[test]
    fn sampling_tells_no_end() {
        let mut meter = Meter::default();
        let start = Instant::now();
        meter.remaining(Phase::Sampling, 0.1, start);
        let later = start + Duration::from_secs(5);
        assert_eq!(meter.remaining(Phase::Sampling, 0.9, later), None);
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
