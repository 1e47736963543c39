//! Content on its way to where it is kept, one after the other, while the computation goes on.

use std::collections::VecDeque;

use bytes::Bytes;
use futures_util::future::{BoxFuture, FutureExt};

use super::insist::Insist;
use crate::jobs::{NewMesh, Result};

/// Contents that may wait; with more, the computation waits.
const MOST: usize = 4;

/// What is to be kept.
pub(super) enum Content {
    /// A surface at an evaluation.
    Snapshot(u64, NewMesh),
    /// What training goes on from after an evaluation.
    Checkpoint(u64, Bytes),
}

/// Those under way. Their order is kept: an attempt that goes on from a checkpoint does not make the
/// snapshots before it again.
pub(super) struct Puts {
    insist: Insist,
    waiting: VecDeque<Content>,
    current: Option<BoxFuture<'static, Result<()>>>,
}

impl Puts {
    pub(super) fn new(insist: Insist) -> Self {
        Self {
            insist,
            waiting: VecDeque::new(),
            current: None,
        }
    }

    /// One more. Of two checkpoints that wait, only the newer one is of use.
    pub(super) fn push(&mut self, content: Content) {
        if matches!(content, Content::Checkpoint(..)) {
            let snapshot = |waiting: &Content| matches!(waiting, Content::Snapshot(..));
            self.waiting.retain(snapshot);
        }
        self.waiting.push_back(content);
    }

    /// Whether another one may come.
    pub(super) fn has_room(&self) -> bool {
        self.waiting.len() < MOST
    }

    /// Whether all have ended.
    pub(super) fn is_empty(&self) -> bool {
        self.current.is_none() && self.waiting.is_empty()
    }

    /// How the next one ends; never if there is none. May be dropped and called again.
    pub(super) async fn next(&mut self) -> Result<()> {
        if self.current.is_none()
            && let Some(content) = self.waiting.pop_front()
        {
            self.current = Some(put(self.insist.clone(), content).boxed());
        }
        let Some(current) = &mut self.current else {
            return std::future::pending().await;
        };
        let result = current.await;
        self.current = None;
        result
    }
}

async fn put(insist: Insist, content: Content) -> Result<()> {
    let (store, claim) = (&insist.store, &insist.claim);
    match content {
        Content::Snapshot(evaluation, mesh) => {
            let put = || store.put_snapshot(claim, evaluation, mesh.clone());
            insist.content(put).await
        }
        Content::Checkpoint(evaluation, data) => {
            let put = || store.put_checkpoint(claim, evaluation, data.clone());
            insist.content(put).await
        }
    }
}
