//! Keeps the worker processes running: starts and restarts them, wakes them, and cleans up after
//! those that die.
//!
//! A worker gets its orders as the first line of its standard input. After that, pipes only wake. A
//! byte to a worker says that a job waits. The end of its input says that the server is gone, for
//! whatever reason: the worker gives its job back and ends. A line from a worker says that it wrote
//! rows, so that event streams read them. Without the pipes, polls every second would do the same.
//!
//! The job of a worker that dies is settled at once, not when its lease expires. Leases are for what
//! the supervisor cannot see: a worker that is stopped, or the death of worker and server. A worker
//! that gives signs of life keeps its job even if its lease has expired: a slow disk delays renewals,
//! and the time of day jumps when a machine wakes up.

mod child;
mod pulse;
mod sweep;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use serde::Serialize;
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use super::{Error, FailureReason, Store};
use child::Child;
use pulse::Pulse;

/// First pause before a worker is started again; it doubles with each early death.
const FIRST_PAUSE: Duration = Duration::from_millis(100);
/// Longest pause.
const LONGEST_PAUSE: Duration = Duration::from_secs(5);
/// A worker that lived this long was started successfully.
const HEALTHY: Duration = Duration::from_secs(10);
/// Pause between two wake-ups, so that one covers several changes.
const RING_PAUSE: Duration = Duration::from_millis(5);
/// Tries to settle a dead worker's job, half a second apart; after that its lease runs out.
const TRIES: u32 = 10;

/// Options of a supervisor.
#[derive(Debug, Clone)]
pub struct Options {
    /// The program that is a worker.
    pub program: PathBuf,
    /// Its arguments, except `--slot`.
    pub arguments: Vec<OsString>,
    /// The first line on its standard input.
    pub orders: String,
    /// Name of this start of the service; empty where no other one shares its database.
    pub node: String,
    /// Number of worker processes.
    pub workers: u16,
    /// Most resident bytes of a worker; none: no limit.
    pub memory_limit_bytes: Option<u64>,
    /// How long workers may take to give their jobs back when the service stops.
    pub drain: Duration,
}

/// Worker processes, as they were last seen.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct Workers {
    /// Those that run and hold a job, or fit blocks of one.
    pub busy: u32,
    /// Those that run and wait for one.
    pub idle: u32,
    /// Those that are about to be started again.
    pub starting: u32,
    /// Starts after a death since the service started.
    pub restarts: u64,
}

/// A worker process that has not ended.
#[derive(Clone, Default)]
struct Living {
    pulse: Pulse,
    condemned: CancellationToken,
}

/// Keeps the worker processes of a service.
pub struct Supervisor {
    store: Store,
    options: Options,
    shutdown: CancellationToken,
    /// Living workers by name.
    living: Mutex<BTreeMap<String, Living>>,
    busy: AtomicU32,
    restarts: AtomicU64,
    seen: watch::Sender<Workers>,
    ring: watch::Sender<u64>,
}

impl Supervisor {
    /// A supervisor over an open store; nothing is started yet.
    pub fn new(store: Store, options: Options, shutdown: CancellationToken) -> Arc<Self> {
        let (seen, _) = watch::channel(Workers::default());
        let (ring, _) = watch::channel(0);
        Arc::new(Self {
            store,
            options,
            shutdown,
            living: Mutex::default(),
            busy: AtomicU32::new(0),
            restarts: AtomicU64::new(0),
            seen,
            ring,
        })
    }

    /// What is known of the workers; changes with them.
    pub fn workers(&self) -> watch::Receiver<Workers> {
        self.seen.subscribe()
    }

    /// Keeps the workers until the shutdown, and ends when all of them have ended.
    pub async fn run(self: Arc<Self>) {
        let slots = TaskTracker::new();
        for slot in 0..self.options.workers {
            slots.spawn(Arc::clone(&self).keep(slot));
        }
        slots.close();
        tokio::select! {
            () = async { tokio::join!(self.shutdown.cancelled(), slots.wait()); } => {}
            () = self.ring_bell() => {}
            () = self.sweep() => {}
        }
    }

    /// Starts the worker of a slot again and again.
    async fn keep(self: Arc<Self>, slot: u16) {
        let mut pause = FIRST_PAUSE;
        while !self.shutdown.is_cancelled() {
            let started = Instant::now();
            match Child::spawn(&self.options, slot).await {
                Ok(child) => self.attend(child).await,
                Err(error) => {
                    tracing::error!(slot, error.message = %error, "a worker cannot be started");
                }
            }
            if self.shutdown.is_cancelled() {
                return;
            }
            if started.elapsed() >= HEALTHY {
                pause = FIRST_PAUSE;
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => {}
                () = self.shutdown.cancelled() => {}
            }
            pause = (2 * pause).min(LONGEST_PAUSE);
            self.restarts.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Stays with a worker to its end, and settles what it leaves.
    async fn attend(&self, child: Child) {
        let name = child.name().to_owned();
        let living = Living::default();
        self.living().insert(name.clone(), living.clone());
        self.publish();
        tracing::info!(worker = %name, "a worker was started");
        let reason = child.attend(self, &living).await;
        self.living().remove(&name);
        self.publish();
        if !self.shutdown.is_cancelled() {
            tracing::warn!(worker = %name, ?reason, "a worker ended");
        }
        self.settle(&name, &reason).await;
        // It may have died while it wrote content.
        if let Err(error) = self.store.collect_garbage(Some(&name)).await {
            tracing::warn!(worker = %name, error.message = %error, "content without a row stays");
        }
    }

    /// Counts a failed attempt for the job that a dead worker held.
    async fn settle(&self, worker: &str, reason: &FailureReason) {
        for _ in 0..TRIES {
            let result = match self.store.held_by(worker).await {
                Ok(None) => return,
                Ok(Some(job)) => {
                    tracing::warn!(job = %job.id, attempt = job.attempt, worker, ?reason,
                        "an attempt failed");
                    let reason = reason.clone();
                    self.store
                        .attempt_failed(&job.id, job.attempt, reason)
                        .await
                }
                Err(error) => Err(error),
            };
            match result {
                // Stale: somebody else settled it.
                Ok(_) | Err(Error::Stale | Error::Closed) => return,
                Err(error) => {
                    tracing::warn!(worker, error.message = %error, "a dead worker's job waits");
                    tokio::time::sleep(Duration::from_millis(500)).await;
                }
            }
        }
    }

    /// Wakes the workers when a job waits or is to be cancelled.
    async fn ring_bell(&self) {
        let mut changed = self.store.changed();
        while changed.changed().await.is_ok() {
            changed.mark_unchanged();
            let waits = matches!(self.store.oldest_queued().await, Ok(Some(_)));
            if waits || self.cancels().await {
                self.ring.send_modify(|rings| *rings += 1);
            }
            tokio::time::sleep(RING_PAUSE).await;
        }
    }

    /// Whether a running job is to be cancelled.
    async fn cancels(&self) -> bool {
        let running = self.running().await.unwrap_or_default();
        running.iter().any(|job| job.cancel_requested)
    }

    fn living(&self) -> std::sync::MutexGuard<'_, BTreeMap<String, Living>> {
        self.living.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn publish(&self) {
        let living = self.living().len() as u32;
        let busy = self.busy.load(Ordering::Relaxed).min(living);
        let workers = Workers {
            busy,
            idle: living - busy,
            starting: u32::from(self.options.workers).saturating_sub(living),
            restarts: self.restarts.load(Ordering::Relaxed),
        };
        self.seen
            .send_if_modified(|seen| std::mem::replace(seen, workers) != workers);
    }
}
