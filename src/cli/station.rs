//! What `meshway serve` and `meshway worker` have in common: they open the records, are one of the processes
//! that share them, and keep worker processes.

use std::path::Path;
use std::time::Duration;

use rustix::system::uname;
use tokio::signal::unix::{SignalKind, signal};
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;

use super::slot::Orders;
use super::{Failure, Substitute};
use crate::config::{Backend, Work};
use crate::jobs::{NewNode, Role, Store, store, supervisor, worker};

/// How long workers may take to give their jobs back at the end; then they are killed. With the ten
/// seconds that requests have after that it stays below the longest end.
const DRAIN: Duration = Duration::from_secs(17);

/// Room on the disk for erasing: a removal writes some MiB to the logs before it gives space back.
const BALLAST_BYTES: u64 = 8 << 20;

/// Time between two beats of a process that shares its records with others: it counts as gone after six.
const BEAT: Duration = Duration::from_secs(10);

/// A process that works on jobs, and what it was told.
pub(super) struct Station<'a> {
    /// Where rows and bytes are.
    pub(super) backend: &'a Backend,
    /// How jobs are worked on.
    pub(super) work: &'a Work,
    /// The folder.
    pub(super) data_dir: &'a Path,
    /// Number of worker processes.
    pub(super) slots: u16,
    /// What it is.
    pub(super) role: Role,
    /// Its name, see [`new_node`].
    pub(super) node: String,
}

/// A name for this start; none is needed with a folder of its own.
pub(super) fn new_node(backend: &Backend) -> String {
    let server = backend.database.as_ref();
    server.map_or_else(String::new, |_| worker::new_node())
}

impl Station<'_> {
    /// Opens the rows and the content, wherever they are; so many jobs may wait.
    ///
    /// # Errors
    /// `Output`: why they cannot be used.
    pub(super) async fn open(&self, queue_limit: u32) -> Result<Store, Failure> {
        let options = store::Options {
            queue_limit: queue_limit.into(),
            events_limit: self.work.max_events.into(),
            metrics_limit: self.work.max_metrics.into(),
            ballast_bytes: BALLAST_BYTES,
            database: self.secret(),
            database_pooled: self.backend.database_pooled,
            objects: self.backend.objects.clone(),
            node: self.node.clone(),
            only_works: self.role == Role::Worker,
            ..store::Options::default()
        };
        let store = Store::open(self.data_dir, options);
        store.await.map_err(|error| match &self.backend.database {
            Some(database) => Failure::Output(format!("--database {database}: {error}")),
            None => Failure::Output(error.to_string()),
        })
    }

    /// Makes this one of the processes that share the records, before its first request: requests that were
    /// in flight with processes that died are forgotten.
    ///
    /// # Errors
    /// Those of the store.
    pub(super) async fn enter(&self, store: &Store) -> Result<Node, Failure> {
        let failed = |error: crate::jobs::Error| Failure::Output(error.to_string());
        if !store.is_shared() {
            store.idempotency_abandon_all().await.map_err(failed)?;
            return Ok(Node(None));
        }
        let node = NewNode {
            name: self.node.clone(),
            host: uname().nodename().to_string_lossy().into_owned(),
            role: self.role,
            slots: self.slots,
        };
        store.join(&node).await.map_err(failed)?;
        let beats = tokio::spawn(beat(store.clone(), node.clone()));
        let beats = AbortOnDropHandle::new(beats);
        Ok(Node(Some((store.clone(), node, beats))))
    }

    /// How the worker processes are kept.
    ///
    /// # Errors
    /// `Output` if their orders have no form.
    pub(super) fn supervisor(
        &self,
        program: &Path,
        grace_milliseconds: u32,
        substitute: Option<&Substitute>,
    ) -> Result<supervisor::Options, Failure> {
        let orders = serde_json::to_string(&self.orders(grace_milliseconds))
            .map_err(|error| Failure::Output(format!("orders of the workers: {error}")))?;
        let folder = self.data_dir.as_os_str().to_owned();
        let mut arguments = vec!["slot".into(), "--data-dir".into(), folder];
        arguments.extend(substitute.map(|substitute| substitute.flag.clone()));
        Ok(supervisor::Options {
            program: program.to_owned(),
            arguments,
            orders,
            node: self.node.clone(),
            workers: self.slots,
            memory_limit_bytes: self.work.memory_bytes(),
            drain: DRAIN,
        })
    }

    /// What workers are told first.
    fn orders(&self, grace_milliseconds: u32) -> Orders {
        let (work, cores) = (self.work, cores());
        Orders {
            options: worker::Options {
                threads: work.threads(cores, self.slots),
                time_limit: Duration::from_secs(work.job_time_limit_seconds.into()),
                checkpoint_interval: Duration::from_secs(work.checkpoint_seconds.into()),
                grace: Duration::from_millis(grace_milliseconds.into()),
                events_limit: work.max_events.into(),
                metrics_limit: work.max_metrics.into(),
                slots: self.slots,
            },
            objects: self.backend.objects.clone(),
            log_format: work.log_format,
            log: work.log.clone(),
            database: self.secret(),
            database_pooled: self.backend.database_pooled,
            node: self.node.clone(),
        }
    }

    /// The address of the database with its password, for those who connect.
    fn secret(&self) -> Option<String> {
        let url = self.backend.database.as_ref();
        url.map(|url| url.secret().to_owned())
    }
}

/// Cores of this machine.
pub(super) fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// One of the processes that share the records, if several do.
pub(super) struct Node(Option<(Store, NewNode, AbortOnDropHandle<()>)>);

impl Node {
    /// Tells the others that it is gone, at its end.
    pub(super) async fn leave(self) {
        if let Some((store, node, beats)) = self.0 {
            drop(beats);
            if let Err(error) = store.leave(&node.name).await {
                tracing::warn!(error.message = %error, "others take this process for a living one for a while");
            }
        }
    }
}

/// Tells the others that this process is there, and forgets requests of those that are not. Never ends.
async fn beat(store: Store, node: NewNode) {
    let mut beats = tokio::time::interval(BEAT);
    beats.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        beats.tick().await;
        let beaten = async {
            store.join(&node).await?;
            store.forget_lost_requests().await
        };
        match beaten.await {
            Ok(0) => {}
            Ok(requests) => {
                tracing::info!(
                    requests,
                    "requests of processes that are gone are forgotten"
                );
            }
            Err(error) => {
                tracing::warn!(error.message = %error, "others may take this process for a dead one");
            }
        }
    }
}

/// Cancels the token at SIGTERM and SIGINT.
///
/// # Errors
/// When they cannot be caught.
pub(super) fn end_on_signals(shutdown: &CancellationToken) -> Result<(), Failure> {
    for kind in [SignalKind::terminate(), SignalKind::interrupt()] {
        let mut signals =
            signal(kind).map_err(|error| Failure::Output(format!("no signals: {error}")))?;
        let shutdown = shutdown.clone();
        tokio::spawn(async move {
            signals.recv().await;
            shutdown.cancel();
        });
    }
    Ok(())
}
