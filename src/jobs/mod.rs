//! A job's life: what work exists, in which state it is, and who runs it.
//!
//! The decisions, each with its reason:
//!
//! - **The database is the truth, signals only wake.** Events, progress and metrics are rows with
//!   an id, read past the reader's last one; so resuming, joining late, lagging behind and starting
//!   again are one way through the code. A lost wake-up costs at most a poll.
//! - **Training runs in worker processes** that open the same database: libtorch can abort or be
//!   killed for memory, and a blocked thread cannot be cancelled.
//! - **Leases with a fence.** A claim raises `jobs.attempt` by one, and every write of a worker
//!   names the attempt and must change one row of a running job. A worker that was stopped and
//!   wakes after its lease can write nothing: it gets [`Error::Stale`].
//! - **A job ends in one transaction**: mesh, report, model, last metrics, event and status
//!   together, or nothing. Event ids are `jobs.events + 1`, taken in the transaction that writes
//!   the event: no gap and no repeat, over attempts and restarts.
//! - **`SQLite`, one writer a process.** The write-ahead log lets readers go on while one writes.
//!   Write transactions start IMMEDIATE: a deferred one that reads and then writes fails at once
//!   under contention, whatever the busy timeout. `synchronous=FULL`, because with NORMAL the last
//!   commits can be lost with the power although they were answered.
//! - **One transaction writes at a time on Postgres, too**, over all processes: it takes an advisory
//!   lock first. So a statement means the same on both databases, and numbers of events and of the
//!   audit trail are in the order of the commits.
//! - **Group commit.** A durable commit costs a flush of the disk, some milliseconds. The writer
//!   takes all requests that wait, runs each in its own savepoint, and commits them together; an
//!   answer is given only after that commit.
//! - **No transaction is held while training**, nor over a wait for a client: on `SQLite` the first
//!   stops every writer, the second keeps the log from being checkpointed.
//! - **SQL lives in [`store`] only**, and the clock is an argument of the store.

pub mod assessment;
mod attempt;
mod batch;
pub mod clock;
mod cloud;
mod error;
mod event;
mod id;
mod job;
pub mod store;
pub mod supervisor;
mod upload;
mod webhook;
pub mod worker;

pub use crate::reconstruction::report::Verdict;
pub use attempt::{Claim, FailureReason, Fault, Lease, NewMesh, Problem, Record, Success};
pub use batch::{Batch, BatchJob, Track};
pub use cloud::{Cloud, CloudDeletion, NewCloud};
pub use error::Error;
pub use event::{Event, EventKind, NewEvent, Requeue};
pub use id::{BatchId, CloudId, DeliveryId, InvalidId, JobId, UploadId, WebhookId};
pub use job::{
    Counts, Job, JobFilter, Keep, KeepChange, Lookup, NewJob, Place, Reason, Status, Tombstone,
};
pub use store::{
    Act, Acts, AuditFault, AuditHead, AuditOutcome, AuditRow, Checkpoint, Idempotency,
    IdempotencyState, LocalFile, MeshInfo, NewNode, Options, Records, Role, Session, Share, Store,
    StoredResponse, Subject,
};

pub use supervisor::{Supervisor, Workers};
pub use upload::{NewUpload, Step, Upload, UploadEnd};
pub use webhook::{
    Delivery, DeliveryState, Due, NewWebhook, News, Next, Tried, Webhook, WebhookChange,
    WebhookState,
};
pub use worker::Worker;

/// Result of the room.
pub type Result<T> = std::result::Result<T, Error>;
