//! Processes tell each other of their commits, so that streams and workers need not wait for a poll.
//!
//! A notice is sent after the commit and beside it: within the transaction it would make all commits
//! of the server wait for each other. One that is lost costs a poll.

use std::sync::Arc;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgListener, PgPool, PgPoolOptions};
use tokio::sync::{Notify, watch};
use tokio::time::MissedTickBehavior;
use tokio_util::task::AbortOnDropHandle;
use uuid::Uuid;

/// Where it is told.
const CHANNEL: &str = "meshway";

/// Pause between two notices of a process: one tells of all commits before it.
const GATHERED: Duration = Duration::from_millis(20);

/// Time between two looks at what no notice told of.
const POLL: Duration = Duration::from_secs(1);

/// Tells others of this process's commits, and `changed` of theirs.
pub(in crate::jobs::store) struct Notices {
    tasks: Vec<AbortOnDropHandle<()>>,
}

impl Notices {
    /// Starts the tasks. Needs a tokio runtime.
    pub(in crate::jobs::store) fn start(
        connect: &PgConnectOptions,
        senders: PgPool,
        committed: Arc<Notify>,
        changed: &watch::Sender<u64>,
    ) -> Self {
        // By its name a process knows its own notices.
        let name = Uuid::now_v7().to_string();
        let connection = PgPoolOptions::new()
            .max_connections(1)
            .connect_lazy_with(connect.clone());
        let tasks = [
            tokio::spawn(tell(senders, name.clone(), committed)),
            tokio::spawn(hear(connection, name, changed.clone())),
            tokio::spawn(poll(changed.clone())),
        ];
        Self {
            tasks: tasks.map(AbortOnDropHandle::new).into(),
        }
    }

    /// As [`Notices::start`] where no session stays that could be told: others are only seen.
    pub(in crate::jobs::store) fn polled(changed: &watch::Sender<u64>) -> Self {
        let poll = tokio::spawn(poll(changed.clone()));
        Self {
            tasks: vec![AbortOnDropHandle::new(poll)],
        }
    }

    /// Ends the tasks.
    pub(in crate::jobs::store) fn stop(&self) {
        self.tasks.iter().for_each(AbortOnDropHandle::abort);
    }
}

async fn tell(senders: PgPool, name: String, committed: Arc<Notify>) {
    loop {
        committed.notified().await;
        let notice = sqlx::query("SELECT pg_notify($1, $2)");
        let sent = notice.bind(CHANNEL).bind(&name).execute(&senders).await;
        if let Err(error) = sent {
            tracing::debug!(%error, "others hear of a commit by their poll");
        }
        tokio::time::sleep(GATHERED).await;
    }
}

async fn hear(connection: PgPool, name: String, changed: watch::Sender<u64>) {
    loop {
        if let Err(error) = listen(&connection, &name, &changed).await {
            tracing::debug!(%error, "commits of others are seen by the poll");
        }
        tokio::time::sleep(POLL).await;
    }
}

async fn listen(connection: &PgPool, name: &str, changed: &watch::Sender<u64>) -> sqlx::Result<()> {
    let mut listener = PgListener::connect_with(connection).await?;
    listener.listen(CHANNEL).await?;
    loop {
        match listener.try_recv().await? {
            Some(notice) if notice.payload() == name => {}
            // None: the connection was lost and made again, and what was told meanwhile is not known.
            _ => changed.send_modify(|commits| *commits += 1),
        }
    }
}

async fn poll(changed: watch::Sender<u64>) {
    let mut interval = tokio::time::interval(POLL);
    interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        interval.tick().await;
        changed.send_modify(|commits| *commits += 1);
    }
}
