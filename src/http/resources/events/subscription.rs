//! An open stream: what the feed tells of, and what only the rows have.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;
use serde_json::json;
use tokio::sync::broadcast::error::RecvError;
use tokio::time::Instant;

use super::of::{Heard, Of};
use super::{data, frame};
use crate::http::AppState;
use crate::http::resources::events::feed::{Listener, News};
use crate::identity::Caller;
use crate::jobs::Event;

/// Time without a frame after which a comment tells proxies that the stream lives, and time after which
/// the key of the stream is looked at again.
pub(super) const SILENCE: Duration = Duration::from_secs(15);

/// Events that a stream reads at once: what it may hold in memory.
const PAGE: u32 = 100;

/// An open stream.
pub(super) struct Subscription {
    pub(super) app: AppState,
    /// Whose events are sent, to whom.
    pub(super) caller: Caller,
    /// Whose events these are.
    pub(super) of: Of,
    pub(super) listener: Listener,
    /// Id of the last event that was sent, as [`Of::number`].
    pub(super) last: i64,
    /// What is ready to be sent.
    pub(super) frames: VecDeque<Bytes>,
    /// Whether rows must be read: the feed alone does not have all that is missing.
    pub(super) behind: bool,
    pub(super) ended: bool,
    pub(super) comment_at: Instant,
    /// When it is looked next whether the caller's key is still good.
    pub(super) check_at: Instant,
}

impl Subscription {
    /// What is sent next; none at the end.
    pub(super) async fn next(&mut self) -> Option<Bytes> {
        loop {
            self.check_key();
            if let Some(frame) = self.frames.pop_front() {
                self.comment_at = Instant::now() + SILENCE;
                return Some(frame);
            }
            if self.ended {
                return None;
            }
            // At the end of the service the rest of a long backlog is left to the next one.
            if self.behind && !self.app.shutdown.is_cancelled() {
                self.read_rows().await;
                continue;
            }
            let shutdown = self.app.shutdown.clone();
            tokio::select! {
                biased;
                () = shutdown.cancelled() => {
                    self.frames.push_back(frame(None, "shutdown", &json!({})));
                    self.ended = true;
                }
                received = self.listener.news.recv() => match received {
                    Ok(News::Event(event)) => self.hear(&event),
                    Ok(News::Erased(job)) => self.ended |= self.of.loses(&job),
                    Err(RecvError::Lagged(_)) => self.behind = true,
                    Err(RecvError::Closed) => self.ended = true,
                },
                () = tokio::time::sleep_until(self.comment_at) => self.comment().await,
            }
        }
    }

    /// Ends the stream of a key that was taken out or has expired.
    fn check_key(&mut self) {
        if Instant::now() < self.check_at {
            return;
        }
        self.check_at = Instant::now() + SILENCE;
        let keys = &self.app.config.keys;
        if !keys.is_good(&self.caller, self.app.store.now()) {
            self.frames.clear();
            self.ended = true;
        }
    }

    /// Takes an event of the feed: the next one, an old one, or one that leaves a gap behind.
    fn hear(&mut self, event: &Event) {
        if event.tenant != self.caller.tenant {
            return;
        }
        match self.of.hear(event, self.last) {
            Heard::Next => self.send(event),
            Heard::Gap => self.behind = true,
            Heard::Nothing => {}
        }
    }

    async fn read_rows(&mut self) {
        let records = self.app.store.of(&self.caller.tenant);
        match self.of.rows(records, self.last, PAGE).await {
            Ok(events) => {
                self.behind = events.len() == PAGE as usize;
                for event in &events {
                    self.send(event);
                }
            }
            Err(error) => {
                // The client comes back and continues where it was.
                tracing::warn!(error.message = %error, "an event stream ends early");
                self.ended = true;
            }
        }
    }

    fn send(&mut self, event: &Event) {
        self.last = self.of.number(event);
        self.frames
            .push_back(frame(Some(self.last), event.kind.name(), &data(event)));
        if self.of.told(event) {
            self.ended = true;
            self.behind = false;
        }
    }

    /// A sign of life; a stream that lagged behind may not have heard that its job was erased.
    async fn comment(&mut self) {
        self.frames.push_back(Bytes::from_static(b": alive\n"));
        let records = self.app.store.of(&self.caller.tenant);
        self.ended = self.of.is_gone(records).await.unwrap_or(true);
    }
}
