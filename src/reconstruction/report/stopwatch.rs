//! The seconds of the stages, on the observer's clock.

use serde::Serialize;

use crate::reconstruction::observer::{Observer, Phase};

/// Seconds of each stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Normals, samples, hold-out.
    pub sampling: f64,
    /// Fitting the network.
    pub training: f64,
    /// Extracting the surface.
    pub surface: f64,
    /// Measuring the mesh.
    pub report: f64,
    /// All of it.
    pub total: f64,
}

/// Adds up the seconds of the stages on the observer's clock.
pub(in crate::reconstruction) struct Stopwatch<'a> {
    observer: &'a dyn Observer,
    start: f64,
    last: f64,
    seconds: Seconds,
}

impl<'a> Stopwatch<'a> {
    pub(in crate::reconstruction) fn new(observer: &'a dyn Observer) -> Self {
        let start = observer.seconds();
        Self {
            observer,
            start,
            last: start,
            seconds: Seconds::default(),
        }
    }

    /// Ends `stage`: what went by since the last one ended was spent in it.
    pub(in crate::reconstruction) fn lap(&mut self, stage: Phase) {
        let now = self.observer.seconds();
        let spent = now - self.last;
        self.last = now;
        match stage {
            Phase::Sampling => self.seconds.sampling += spent,
            Phase::Training => self.seconds.training += spent,
            Phase::Surface => self.seconds.surface += spent,
            Phase::Report => self.seconds.report += spent,
        }
    }

    pub(in crate::reconstruction) fn seconds(&self) -> Seconds {
        Seconds {
            total: self.last - self.start,
            ..self.seconds
        }
    }
}
