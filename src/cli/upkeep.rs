//! What a service does besides answering: it reads its keys again when it is told to, and looks after
//! its audit trail and the worked time.

use std::path::PathBuf;
use std::time::Duration;

use tokio::signal::unix::{SignalKind, signal};

use super::Failure;
use crate::config::Config;
use crate::identity::Keyring;
use crate::jobs::{Error, Store};

/// How often the head of the audit trail is logged, and what is old is removed.
const DAILY: Duration = Duration::from_hours(24);

/// Time between two looks whether jobs are to be packed, and between two jobs; and how many are packed before
/// it is told, by whom it is for so long.
const PACKED: Duration = Duration::from_mins(5);
const BETWEEN: Duration = Duration::from_millis(10);
const PACKED_AT_ONCE: u32 = 500;
const DUTY_MS: i64 = 10 * 60 * 1_000;

const HOUR_MS: i64 = 60 * 60 * 1_000;
const DAY_MS: i64 = 24 * 60 * 60 * 1_000;

/// Logs what an operator will hardly have meant in the file of keys.
pub(super) fn tell_doubts(keys: &Keyring, store: &Store) {
    for doubt in keys.doubts(store.now()) {
        tracing::warn!(doubt, "is this meant?");
    }
}

/// Takes the keys of the file over at each SIGHUP. A file with faults changes nothing.
///
/// # Errors
/// When the signal cannot be caught.
pub(super) fn reload_keys(file: PathBuf, keys: Keyring, store: Store) -> Result<(), Failure> {
    let mut signals = signal(SignalKind::hangup())
        .map_err(|error| Failure::Output(format!("no signals: {error}")))?;
    tokio::spawn(async move {
        while signals.recv().await.is_some() {
            let read = tokio::fs::read_to_string(&file).await;
            let read = read.map_err(|error| error.to_string());
            let new = read.and_then(|text| Keyring::of_file(&text).map_err(|e| e.to_string()));
            let taken = new.and_then(|new| keys.replace(&new).map_err(|e| e.to_string()));
            match taken {
                Ok(()) => {
                    tracing::info!(keys = keys.all().len(), "the keys were read again");
                    tell_doubts(&keys, &store);
                }
                Err(error) => tracing::error!(
                    file = %file.display(),
                    error.message = error,
                    "the keys stay as they were"
                ),
            }
        }
    });
    Ok(())
}

/// Removes what no row names from the object store, now and daily. Never ends.
pub(super) async fn collect_garbage(store: Store) {
    loop {
        match store.collect_garbage(None).await {
            Ok(0) => {}
            Ok(objects) => tracing::info!(objects, "objects that no row names are removed"),
            Err(error) => tracing::warn!(error.message = %error, "objects without a row stay"),
        }
        tokio::time::sleep(DAILY).await;
    }
}

/// Packs what jobs told that ended so many hours ago, again and again. Never ends. Of several services one
/// does it for all.
pub(super) async fn keep_histories(store: Store, hours: u32) {
    if hours == 0 {
        return;
    }
    loop {
        let ours = store.take_duty("histories", DUTY_MS).await.unwrap_or(false);
        let before = store.now() - i64::from(hours) * HOUR_MS;
        let packed = if ours {
            pack(&store, before).await
        } else {
            Ok(0)
        };
        match packed {
            Ok(0) => tokio::time::sleep(PACKED).await,
            Ok(jobs) => tracing::info!(jobs, "events and series of old jobs are packed"),
            Err(error) => {
                tracing::warn!(error.message = %error, "events and series of old jobs stay rows");
                tokio::time::sleep(PACKED).await;
            }
        }
    }
}

/// Packs some jobs; how many.
async fn pack(store: &Store, before: i64) -> Result<usize, Error> {
    let jobs = store.jobs_to_archive(before, PACKED_AT_ONCE).await?;
    for (job, tenant) in &jobs {
        store.archive(job, tenant).await?;
        // Requests go first.
        tokio::time::sleep(BETWEEN).await;
    }
    Ok(jobs.len())
}

/// Logs the head of the audit trail now and daily: a copy of the log shows later whether rows were cut
/// off. Rows that are old enough are removed. Never ends.
pub(super) async fn keep_audit(store: Store, config: Config) {
    loop {
        let before = store.now() - i64::from(config.audit_keep_days) * DAY_MS;
        match store.audit_prune(before).await {
            Ok(0) => {}
            Ok(rows) => tracing::info!(rows, "old rows of the audit trail were removed"),
            Err(error) => tracing::warn!(error.message = %error, "the audit trail was not pruned"),
        }
        if let Err(error) = store.forget_compute().await {
            tracing::warn!(error.message = %error, "old worked time was not forgotten");
        }
        if let Err(error) = store.forget_deliveries().await {
            tracing::warn!(error.message = %error, "old messages to webhooks were not forgotten");
        }
        match store.audit_head().await {
            Ok(head) if head.seq > 0 => {
                tracing::info!(head = format!("{}:{}", head.seq, head.hash), "audit trail");
            }
            Ok(_) => {}
            Err(error) => tracing::warn!(error.message = %error, "the audit trail is not readable"),
        }
        tokio::time::sleep(DAILY).await;
    }
}
