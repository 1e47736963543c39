//! Holding a job: renewals, and hearing that a client wants it to end.

use std::sync::Arc;

use tokio::sync::watch;
use tokio::time::MissedTickBehavior;

use super::control::{Control, Stop};
use crate::jobs::{Claim, Lease, Lookup, Status, Store};

/// Renews until the job is lost or the task is dropped.
pub(super) async fn hold(
    store: Store,
    claim: Claim,
    control: Arc<Control>,
    mut wake: watch::Receiver<u64>,
) {
    let terms = store.terms();
    let mut renewal = tokio::time::interval(terms.renewal);
    renewal.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut awake = true;
    loop {
        let due = tokio::select! {
            _ = renewal.tick() => true,
            woken = wake.changed(), if awake => {
                awake = woken.is_ok();
                false
            }
        };
        let lease = if due {
            store
                .renew(&claim, terms.lease_ms, claim.worked + control.worked())
                .await
        } else {
            // Only a read, because wake-ups come for other jobs too.
            store
                .of(&claim.job.tenant)
                .job(claim.job_id())
                .await
                .map(|found| lease(found, &claim))
        };
        match lease {
            Ok(Lease::Held {
                cancel_requested: false,
            }) => {}
            Ok(Lease::Held {
                cancel_requested: true,
            }) => control.stop(Stop::Cancel),
            Ok(Lease::Lost) => {
                control.stop(Stop::Lost);
                return;
            }
            Err(error) => {
                tracing::warn!(job = %claim.job_id(), error.message = %error, "a lease was not renewed");
            }
        }
    }
}

fn lease(found: Lookup, claim: &Claim) -> Lease {
    match found.found() {
        Some(job) if job.status == Status::Running && job.attempt == claim.attempt => Lease::Held {
            cancel_requested: job.cancel_requested,
        },
        _ => Lease::Lost,
    }
}
