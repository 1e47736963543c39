//! The observer of a job: runs on the thread that computes, and hands over to the async side.

use std::cell::Cell;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::mpsc;

use super::control::{Control, Stop};
use super::desk::Desk;
use super::work::encode;
use crate::jobs::NewMesh;
use crate::reconstruction::training::{GradientHistogram, Metrics};
use crate::reconstruction::{Event, Helpers, Observer, Phase, Warning};

/// What the thread tells.
#[derive(Debug)]
pub(super) enum Message {
    Phase(Phase),
    Progress(f64),
    Metrics(Metrics),
    Gradients(GradientHistogram),
    Warning(Warning),
    Snapshot { evaluation: u64, mesh: NewMesh },
    Checkpoint { evaluation: u64, data: Vec<u8> },
}

/// Sends what it hears; waits when the async side is behind.
pub(super) struct Sink {
    messages: mpsc::Sender<Message>,
    control: Arc<Control>,
    start: Instant,
    checkpoint: Option<Vec<u8>>,
    checkpoint_interval: Duration,
    last_checkpoint: Cell<Instant>,
    desk: Arc<Desk>,
}

impl Sink {
    pub(super) fn new(
        messages: mpsc::Sender<Message>,
        control: Arc<Control>,
        checkpoint: Option<Vec<u8>>,
        checkpoint_interval: Duration,
        desk: Arc<Desk>,
    ) -> Self {
        let start = Instant::now();
        Self {
            messages,
            control,
            start,
            checkpoint,
            checkpoint_interval,
            last_checkpoint: Cell::new(start),
            desk,
        }
    }
}

impl Observer for Sink {
    fn event(&self, event: Event<'_>) {
        let message = match event {
            Event::Phase(phase) => Message::Phase(phase),
            Event::Progress(share) => Message::Progress(share),
            Event::Metrics(metrics) => Message::Metrics(metrics.clone()),
            Event::Gradients(histogram) => Message::Gradients(histogram.clone()),
            Event::Warning(warning) => Message::Warning(warning.clone()),
            Event::Snapshot {
                evaluation,
                mesh,
                verdict,
            } => match encode(mesh) {
                Ok(mesh) => Message::Snapshot {
                    evaluation,
                    mesh: mesh.judged(verdict),
                },
                Err(error) => Message::Warning(Warning::new(
                    "snapshot_not_written",
                    format!("the snapshot at evaluation {evaluation} cannot be encoded: {error}"),
                )),
            },
            Event::Checkpoint { evaluation, data } => {
                self.last_checkpoint.set(Instant::now());
                let data = data.to_vec();
                Message::Checkpoint { evaluation, data }
            }
        };
        // Nobody listens any more when the attempt was given up; the flags tell the thread.
        drop(self.messages.blocking_send(message));
    }

    fn cancelled(&self) -> bool {
        matches!(
            self.control.reason(),
            Some(Stop::Cancel | Stop::TimeLimit | Stop::Lost)
        )
    }

    fn released(&self) -> bool {
        self.control.reason() == Some(Stop::Release)
    }

    fn checkpoint_due(&self) -> bool {
        self.last_checkpoint.get().elapsed() >= self.checkpoint_interval
    }

    fn checkpoint(&self) -> Option<&[u8]> {
        self.checkpoint.as_deref()
    }

    fn helpers(&self) -> Option<&dyn Helpers> {
        Some(&*self.desk)
    }

    fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
