//! The task that sends what is due.

use std::collections::HashSet;
use std::time::Duration;

use tokio::task::JoinSet;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::post::Post;
use super::schedule::after;
use crate::jobs::{Due, Next, Store, WebhookId};

/// How long one of several processes has the duty to send, in milliseconds, and after what time it takes it
/// for longer: a try that takes as long as it may still ends within.
const DUTY_MS: i64 = 90_000;
const DUTY_RENEWED: Duration = Duration::from_secs(20);

/// Messages that are on their way at the same time, each to another webhook.
const AT_ONCE: usize = 32;

/// Time between two looks at the outbox while much is written.
const LOOK: Duration = Duration::from_millis(100);

/// Longest time between two looks: another process may have written without a word.
const LONGEST_LOOK: Duration = Duration::from_secs(30);

/// Sends messages to webhooks when they are due: of each webhook one at a time, the oldest first.
pub struct Sender {
    store: Store,
    post: Post,
}

impl Sender {
    /// Of the messages in a store.
    pub fn new(store: Store, post: Post) -> Self {
        Self { store, post }
    }

    /// Until the service stops. What is on its way then is sent again by the next start.
    pub async fn run(self, shutdown: CancellationToken) {
        let mut changed = self.store.changed();
        let mut duty = Duty::default();
        let mut busy = HashSet::new();
        let mut tries = JoinSet::new();
        loop {
            changed.mark_unchanged();
            if duty.is_ours(&self.store).await {
                self.begin(&mut tries, &mut busy).await;
            }
            let wait = self.until_the_next().await;
            tokio::select! {
                () = shutdown.cancelled() => return,
                Some(ended) = tries.join_next() => match ended {
                    Ok(webhook) => drop(busy.remove(&webhook)),
                    // A defect of ours must not keep the webhook busy for ever.
                    Err(error) => {
                        tracing::error!(error.message = %error, "a webhook failed");
                        tries.shutdown().await;
                        busy.clear();
                    }
                },
                _ = changed.changed() => tokio::time::sleep(LOOK).await,
                () = tokio::time::sleep(wait) => {}
            }
        }
    }

    /// Begins to send what is due.
    async fn begin(&self, tries: &mut JoinSet<WebhookId>, busy: &mut HashSet<WebhookId>) {
        let due = match self.store.due_deliveries().await {
            Ok(due) => due,
            Err(error) => {
                tracing::warn!(error.message = %error, "the messages to webhooks cannot be read");
                return;
            }
        };
        for due in due {
            let webhook = due.delivery.webhook_id.clone();
            if tries.len() >= AT_ONCE || !busy.insert(webhook.clone()) {
                continue;
            }
            let (store, post) = (self.store.clone(), self.post.clone());
            tries.spawn(async move {
                send(&store, &post, &due).await;
                webhook
            });
        }
    }

    /// Time until the next message is due.
    async fn until_the_next(&self) -> Duration {
        let next = self.store.next_delivery().await.ok().flatten();
        let wait = next.map(|next| Duration::from_millis((next - self.store.now()).max(0) as u64));
        wait.map_or(LONGEST_LOOK, |wait| wait.clamp(LOOK, LONGEST_LOOK))
    }
}

/// Whether this process sends the messages, where several share them.
#[derive(Default)]
struct Duty {
    /// What was heard last, and when it was asked.
    heard: Option<(bool, Instant)>,
}

impl Duty {
    async fn is_ours(&mut self, store: &Store) -> bool {
        if let Some((ours, at)) = self.heard
            && at.elapsed() < DUTY_RENEWED
        {
            return ours;
        }
        let asked = Instant::now();
        let ours = store.take_duty("webhooks", DUTY_MS).await;
        let ours = ours.unwrap_or_else(|error| {
            tracing::warn!(error.message = %error, "nobody may be sending to webhooks");
            false
        });
        self.heard = Some((ours, asked));
        ours
    }
}

/// Sends a message once, and notes how it went.
async fn send(store: &Store, post: &Post, due: &Due) {
    let answer = post.send(due, store.now()).await;
    let share = getrandom::u32().map_or(0.0, |random| f64::from(random) / f64::from(u32::MAX));
    let tried = after(answer, due.delivery.tries, store.now(), share);
    let (delivery, webhook) = (&due.delivery.id, &due.delivery.webhook_id);
    match (&tried.error, tried.next) {
        (None, _) => tracing::debug!(%delivery, %webhook, "a message was taken"),
        (Some(error), Next::Again { .. }) => {
            tracing::info!(%delivery, %webhook, error.message = error, "a message is sent again later");
        }
        (Some(error), _) => {
            tracing::warn!(%delivery, %webhook, error.message = error, "a message was given up");
        }
    }
    if let Err(error) = store.delivery_tried(due, tried).await {
        // It stays due, so that it is sent again: after a while, lest a full disk floods the receiver.
        tracing::warn!(%delivery, error.message = %error, "what came of a message was not noted");
        tokio::time::sleep(LONGEST_LOOK).await;
    }
}
