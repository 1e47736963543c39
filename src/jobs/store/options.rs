//! What a store is opened with, and what holds for its database.

use std::time::Duration;

use crate::config::ObjectsUrl;
use crate::jobs::clock::{self, Clock};

/// Options of a store.
#[derive(Clone)]
pub struct Options {
    /// Most jobs that may wait; a job that goes back into the queue is never refused.
    pub queue_limit: u64,
    /// Failed attempts after which a job fails.
    pub max_failures: i64,
    /// Events of a job after which `job.progress` and `training.metrics` are left out.
    pub events_limit: i64,
    /// Metric rows of a job after which further ones are left out.
    pub metrics_limit: i64,
    /// How long a write waits for another process before it fails with `Busy`.
    pub busy_timeout: Duration,
    /// Name of the process, by which its unfinished content is found; empty for the server of the
    /// folder.
    pub process: String,
    /// Name of this start among the processes that share the database; empty where it is alone.
    pub node: String,
    /// The object store with the content; none: it is in the folder.
    pub objects: Option<ObjectsUrl>,
    /// How old an object in an object store is that no row names, before it is garbage: longer than
    /// any writing takes.
    pub garbage_age: Duration,
    /// The process works on jobs, and does nothing besides: the place of the content is as a service left it.
    pub only_works: bool,
    /// Rows are read, and nothing else is done: content stays where it is, whoever has it.
    pub rows_only: bool,
    /// Bytes of the disk that are set aside for erasing on a full one.
    pub ballast_bytes: u64,
    /// The time, in milliseconds since the epoch; none: that of the database, which for `SQLite` is
    /// that of the machine.
    pub clock: Option<Clock>,
    /// Address of a Postgres database for the rows, with its password where that is not in the
    /// environment; none: `SQLite` in the data folder.
    pub database: Option<String>,
    /// A pooler is between here and it, which hands each transaction to a session of its own choice.
    pub database_pooled: bool,
}

impl Options {
    pub(in crate::jobs::store) fn now(&self) -> i64 {
        self.clock.as_ref().map_or_else(clock::now, |clock| clock())
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            queue_limit: 1_000,
            max_failures: 3,
            events_limit: 100_000,
            metrics_limit: 200_000,
            // Below the lease of 6 s: a worker learns that it could not renew before it lost it.
            busy_timeout: Duration::from_secs(5),
            process: String::new(),
            node: String::new(),
            objects: None,
            garbage_age: Duration::from_hours(1),
            only_works: false,
            rows_only: false,
            ballast_bytes: 0,
            clock: None,
            database: None,
            database_pooled: false,
        }
    }
}

/// How long claims on jobs last, and how long a worker waits for the database: a server may be away
/// for some seconds to start again, or for an hour to be mended.
#[derive(Debug, Clone, Copy)]
pub struct Terms {
    /// How long a job is held without a renewal, in milliseconds.
    pub lease_ms: i64,
    /// Time between two renewals; also the longest time until a cancellation is heard. At least three may
    /// be lost.
    pub renewal: Duration,
    /// How often a worker asks, with half a second between, before it gives a job up.
    pub tries: u32,
}

/// On `SQLite`, where only a stopped process or a full disk is in the way.
pub(in crate::jobs::store) const LOCAL: Terms = Terms {
    lease_ms: 6_000,
    renewal: Duration::from_millis(1_500),
    tries: 20,
};

/// With a server: two hours, since one is promised.
pub(in crate::jobs::store) const REMOTE: Terms = Terms {
    lease_ms: 30_000,
    renewal: Duration::from_secs(5),
    tries: 14_400,
};
