//! A worker process: takes one job after another, and does each on a thread of its own.
//!
//! The thread computes and nothing else; what it tells goes through a channel to the async side,
//! which writes rows, renews the lease and hears of cancellations. So a job that computes for
//! minutes between two looks at its flag still holds its lease, and one that never looks is given
//! up after [`Options::grace`].

mod attempt;
mod control;
mod desk;
mod help;
mod insist;
mod lease;
mod progress;
mod puts;
mod sink;
mod work;

use std::sync::Arc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use uuid::Uuid;

use super::{JobId, Result, Store};
use crate::reconstruction::processor;
use attempt::Attempt;
use help::Help;

pub use work::{Assignment, Failure, Product, Work, reconstruction};

/// Pause between two looks at an empty queue; what a lost wake-up costs.
const POLL: Duration = Duration::from_secs(1);

/// Hexadecimal digits of the name of a node.
const NODE_DIGITS: usize = 10;

/// Line that a worker process writes to its standard output every second.
pub const SIGN_OF_LIFE: &str = "A";

/// What a worker is told by its server, as JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Options {
    /// Threads to compute with.
    pub threads: usize,
    /// Longest time of a job, over its attempts.
    pub time_limit: Duration,
    /// Time between two checkpoints of a training run.
    pub checkpoint_interval: Duration,
    /// How long the thread may take to stop before it is given up.
    pub grace: Duration,
    /// Most events of a job.
    pub events_limit: i64,
    /// Most metric rows of a job.
    pub metrics_limit: i64,
    /// Worker processes of this service, itself among them.
    pub slots: u16,
}

/// What comes into a worker from outside, and what it tells there.
pub struct Signals {
    /// Changes when the queue or a cancellation is to be looked at.
    pub wake: watch::Receiver<u64>,
    /// Cancelled when the worker is to give its job back and end.
    pub stopping: CancellationToken,
    /// Called after something about a job was committed.
    pub committed: Box<dyn Fn(&JobId) + Send + Sync>,
}

/// The name of the worker process of a slot: no two processes have the same at one time. On machines that
/// share a database the same slot and number can be of two processes; the node tells them apart, and is
/// empty where there is one machine only.
pub fn worker_name(slot: u16, pid: u32, node: &str) -> String {
    let dash = if node.is_empty() { "" } else { "-" };
    format!("worker-{slot}-{pid}{dash}{node}")
}

/// A name for this start of a service, which no other start of any has.
pub fn new_node() -> String {
    let uuid = Uuid::now_v7().simple().to_string();
    // Its second half is by chance.
    uuid[uuid.len() - NODE_DIGITS..].to_owned()
}

/// The slot of the worker of this name.
pub fn slot_of(name: &str) -> Option<u16> {
    let (slot, _pid) = name.strip_prefix("worker-")?.split_once('-')?;
    slot.parse().ok()
}

/// How a worker ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// It was asked to, and holds no job.
    Stopped,
    /// The thread of its last job does not stop: only the end of the process ends it.
    Hung,
}

/// A worker process.
pub struct Worker {
    /// Its name, as no other process has it.
    pub name: String,
    /// The service's rows.
    pub store: Store,
    /// What it does with a job.
    pub work: Arc<Work>,
    /// What it is told.
    pub options: Options,
    /// What comes in.
    pub signals: Signals,
}

impl Worker {
    /// Works until it is asked to stop.
    ///
    /// # Errors
    /// When the store was closed. Other errors of the store are logged, and the work goes on.
    pub async fn run(&self) -> Result<End> {
        let mut wake = self.signals.wake.clone();
        while !self.signals.stopping.is_cancelled() {
            // What comes after this look wakes the wait below.
            wake.mark_unchanged();
            match self
                .store
                .claim(&self.name, self.store.terms().lease_ms)
                .await
            {
                Ok(Some(claim)) => {
                    if Attempt::new(self, claim).run().await == End::Hung {
                        return Ok(End::Hung);
                    }
                    continue;
                }
                Ok(None) => {
                    if self.help().await {
                        continue;
                    }
                }
                Err(super::Error::Closed) => return Err(super::Error::Closed),
                Err(error) => tracing::warn!(error.message = %error, "no job can be claimed"),
            }
            tokio::select! {
                _ = wake.changed() => {}
                () = tokio::time::sleep(POLL) => {}
                () = self.signals.stopping.cancelled() => {}
            }
        }
        Ok(End::Stopped)
    }

    /// Fits blocks of a job of another worker, if there are any; whether there were.
    async fn help(&self) -> bool {
        match self.store.take_share(&self.name, &processor()).await {
            Ok(Some(share)) => {
                Help::new(self, share).run().await;
                true
            }
            Ok(None) => false,
            Err(error) => {
                tracing::warn!(error.message = %error, "no blocks of another job can be fitted");
                false
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_tells_its_slot() {
        assert_eq!(worker_name(3, 6_944, ""), "worker-3-6944");
        for node in ["", &new_node()] {
            assert_eq!(slot_of(&worker_name(3, 6_944, node)), Some(3));
        }
        assert_eq!(slot_of("another"), None);
    }
}
