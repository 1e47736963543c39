//! What this node keeps in memory and in files, held against what other nodes do: keys that they made or
//! took out, and what they erased.

use std::collections::HashSet;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::MissedTickBehavior;

use crate::http::AppState;
use crate::http::resources::jobs::erase::forget;
use crate::jobs::Result;

/// Time between two looks.
const LOOK: Duration = Duration::from_secs(1);

/// How far back a look goes, in milliseconds: clocks of nodes are read off that of the database, and a
/// look may pass by a transaction that is about to be committed.
const BACK_MS: i64 = 15_000;

/// Looks again and again where several nodes share the records. Never ends.
pub async fn follow(app: AppState) {
    if !app.store.is_shared() {
        return std::future::pending().await;
    }
    let mut interval = tokio::time::interval(LOOK);
    interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut erased = Erased {
        since: app.store.now(),
        known: HashSet::new(),
    };
    loop {
        interval.tick().await;
        if let Err(error) = look(&app, &mut erased).await {
            tracing::warn!(error.message = %error, "what other nodes did is not known yet");
        }
    }
}

/// What was erased lately.
struct Erased {
    /// Time of the newest that is known.
    since: i64,
    /// Those that a look back finds again.
    known: HashSet<String>,
}

async fn look(app: &AppState, erased: &mut Erased) -> Result<()> {
    app.config.keys.take_made(app.store.keys().await?);
    let (_, slots) = app.store.nodes().await?;
    app.slots.store(slots, Ordering::Relaxed);
    let found = app.store.erased_since(erased.since - BACK_MS).await?;
    for (name, time) in &found {
        erased.since = erased.since.max(*time);
        if !erased.known.contains(name)
            && let Ok(job) = name.parse()
        {
            forget(app, job);
        }
    }
    erased.known = found.into_iter().map(|(name, _)| name).collect();
    Ok(())
}
