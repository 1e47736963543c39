//! Places for connections, and who gives one up when there are no more.
//!
//! A connection that waits for a request costs its client nothing, so thousands of them must not
//! shut others out: the one that waits longest makes room. Where all are at work, a few places are
//! kept for probes, or an orchestrator would take a busy service for a dead one.

use std::collections::BTreeMap;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};

use axum::body::{Body, Bytes, HttpBody};
use hyper::body::{Frame, SizeHint};
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

/// Extra places, kept for probes.
const KEPT: usize = 32;

/// All places.
#[derive(Debug)]
pub(in crate::http) struct Places {
    limit: usize,
    state: Mutex<State>,
    freed: Notify,
}

#[derive(Debug, Default)]
struct State {
    open: usize,
    /// Free places among those kept for probes.
    kept: usize,
    turns: u64,
    /// Connections that wait for a request, the one that waits longest first, and whether their
    /// place is one that is kept.
    idle: BTreeMap<u64, (CancellationToken, bool)>,
}

/// The place of one connection. Dropping it frees the place.
#[derive(Debug)]
pub(in crate::http) struct Place {
    all: Arc<Places>,
    /// Position among the waiting connections; none while a request is in progress.
    turn: Mutex<Option<u64>>,
    /// Cancelled when the connection has to make room for another.
    pub(in crate::http) cut: CancellationToken,
    /// Whether only probes are answered.
    pub(in crate::http) kept: bool,
}

impl Places {
    /// The given number of places, plus those kept for probes.
    pub(in crate::http) fn new(limit: u32) -> Arc<Self> {
        Arc::new(Self {
            limit: limit as usize,
            state: Mutex::default(),
            freed: Notify::new(),
        })
    }

    /// Waits for a place. Returns at once when one is free or can be taken from a waiting
    /// connection.
    pub(in crate::http) async fn take(self: &Arc<Self>) -> Place {
        loop {
            let freed = self.freed.notified();
            if let Some(place) = self.try_take() {
                return place;
            }
            freed.await;
        }
    }

    fn try_take(self: &Arc<Self>) -> Option<Place> {
        let mut state = self.state();
        let kept = state.open >= self.limit && !state.make_room(false);
        if kept && state.kept >= KEPT && !state.make_room(true) {
            return None;
        }
        *state.count(kept) += 1;
        let cut = CancellationToken::new();
        let turn = state.wait(&cut, kept);
        Some(Place {
            all: Arc::clone(self),
            turn: Mutex::new(Some(turn)),
            cut,
            kept,
        })
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn wait(&mut self, cut: &CancellationToken, kept: bool) -> u64 {
        self.turns += 1;
        self.idle.insert(self.turns, (cut.clone(), kept));
        self.turns
    }

    /// Closes the connection that has waited longest on a place of this kind, if there is one.
    fn make_room(&mut self, kept: bool) -> bool {
        let mut idle = self.idle.iter();
        let longest = idle.find(|(_, (_, on_kept))| *on_kept == kept);
        let Some(turn) = longest.map(|(turn, _)| *turn) else {
            return false;
        };
        if let Some((cut, _)) = self.idle.remove(&turn) {
            cut.cancel();
        }
        true
    }

    fn count(&mut self, kept: bool) -> &mut usize {
        if kept { &mut self.kept } else { &mut self.open }
    }
}

impl Place {
    /// Marks a request as in progress until the returned guard is dropped.
    pub(in crate::http) fn work(self: &Arc<Self>) -> Work {
        if let Some(turn) = self.turn().take() {
            self.all.state().idle.remove(&turn);
        }
        Work(Arc::clone(self))
    }

    /// Whether it waits for a request.
    pub(super) fn is_idle(&self) -> bool {
        self.turn().is_some()
    }

    fn turn(&self) -> MutexGuard<'_, Option<u64>> {
        self.turn.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let turn = self.turn().take();
        let mut state = self.all.state();
        *state.count(self.kept) -= 1;
        if let Some(turn) = turn {
            state.idle.remove(&turn);
        }
        drop(state);
        self.all.freed.notify_waiters();
    }
}

/// Guard of a request in progress.
#[derive(Debug)]
pub(in crate::http) struct Work(Arc<Place>);

impl Drop for Work {
    fn drop(&mut self) {
        let place = &self.0;
        *place.turn() = Some(place.all.state().wait(&place.cut, place.kept));
        place.all.freed.notify_waiters();
    }
}

/// A response body that keeps its request in progress until it has been sent.
#[derive(Debug)]
pub(in crate::http) struct Watched {
    body: Body,
    _work: Work,
}

impl Watched {
    /// The body of an answer.
    pub(in crate::http) fn new(body: Body, work: Work) -> Self {
        Self { body, _work: work }
    }
}

impl HttpBody for Watched {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        Pin::new(&mut self.body).poll_frame(context)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn who_waits_longest_makes_room_and_who_works_does_not() {
        let places = Places::new(2);
        let first = Arc::new(places.take().await);
        let second = Arc::new(places.take().await);
        let work = first.work();
        let third = Arc::new(places.take().await);
        assert!(second.cut.is_cancelled() && !first.cut.is_cancelled());
        assert!(!third.kept);
        drop(second);
        let more = third.work();
        // All work: what comes now is for probes only, and there is an end to it.
        let mut kept = Vec::new();
        for _ in 0..KEPT {
            let place = Arc::new(places.take().await);
            assert!(place.kept);
            kept.push(place.work());
        }
        assert!(places.try_take().is_none());
        // One that has been answered waits again, and can make room.
        drop(work);
        assert!(places.try_take().is_some());
        assert!(first.cut.is_cancelled());
        drop(more);
    }
}
