//! Bodies that are held in memory: how much all of them may take, and how slowly they may come.

use std::future::Future;
use std::ops::Deref;
use std::sync::Arc;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use futures_util::StreamExt;
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::{Instant, timeout};

use crate::http::upload::spool::too_large;
use crate::http::wire::error::{ApiError, Code, Result};

/// Most bytes of a JSON body, and of the `job` part of a form.
pub(in crate::http) const JSON_LIMIT: usize = 64 * 1024;

/// Bytes that all bodies of at most [`JSON_LIMIT`] may have together.
const SMALL_BYTES: usize = 32 << 20;

/// Bytes that all larger ones may have together. They have a total of their own: they must not
/// keep jobs from being submitted.
const LARGE_BYTES: usize = 64 << 20;

/// Bytes of an upload that are gathered before a thread is asked to write them.
pub(in crate::http) const BATCH: usize = 256 * 1024;

/// Uploads that gather at the same time; more of them write what comes as it comes.
const BATCHES: usize = 128;

/// How long a body waits for its place.
const PATIENCE: Duration = Duration::from_secs(30);

/// Bytes in each second that a body must bring.
pub(in crate::http) const LEAST_RATE: u64 = 1_024;

/// Memory for bodies.
#[derive(Debug)]
pub(in crate::http) struct Bodies {
    small: Arc<Semaphore>,
    large: Arc<Semaphore>,
    batches: Arc<Semaphore>,
}

impl Default for Bodies {
    fn default() -> Self {
        Self {
            small: Arc::new(Semaphore::new(SMALL_BYTES)),
            large: Arc::new(Semaphore::new(LARGE_BYTES)),
            batches: Arc::new(Semaphore::new(BATCHES)),
        }
    }
}

impl Bodies {
    /// A place for a body of at most `limit` bytes, of which so many are declared.
    ///
    /// # Errors
    /// [`Code::BodyTooLarge`]; [`Code::RateLimited`] when there is no place for a while.
    pub(in crate::http) async fn gather(
        &self,
        declared: Option<u64>,
        limit: usize,
    ) -> Result<Gathered> {
        let bytes = declared.map_or(limit, |bytes| bytes.try_into().unwrap_or(usize::MAX));
        if bytes > limit {
            return Err(too_large(limit as u64));
        }
        let room = if limit > JSON_LIMIT {
            &self.large
        } else {
            &self.small
        };
        let place = Arc::clone(room).acquire_many_owned(bytes as u32);
        let place = timeout(PATIENCE, place).await.map_err(|_| {
            let detail = "as many bodies as there is memory for are being received";
            ApiError::new(Code::RateLimited, detail).retry_after(5)
        })?;
        Ok(Gathered {
            bytes: BytesMut::with_capacity(declared.map_or(0, |_| bytes)),
            limit: bytes,
            place: place.map_err(ApiError::internal)?,
        })
    }

    /// A place for a batch of an upload, if one is free.
    pub(in crate::http) fn batch(&self) -> Option<OwnedSemaphorePermit> {
        Arc::clone(&self.batches).try_acquire_owned().ok()
    }
}

/// A body in memory, which gives its place back when it is dropped.
#[derive(Debug)]
pub(in crate::http) struct Gathered {
    bytes: BytesMut,
    limit: usize,
    place: OwnedSemaphorePermit,
}

impl Gathered {
    /// Takes what comes next.
    ///
    /// # Errors
    /// [`Code::BodyTooLarge`].
    pub(in crate::http) fn push(&mut self, chunk: &[u8]) -> Result<()> {
        if self.bytes.len() + chunk.len() > self.limit {
            return Err(too_large(self.limit as u64));
        }
        self.bytes.extend_from_slice(chunk);
        Ok(())
    }

    /// The place alone, for what is made of the body.
    pub(in crate::http) fn into_place(self) -> OwnedSemaphorePermit {
        self.place
    }
}

impl Deref for Gathered {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.bytes
    }
}

/// An answer that holds the place of its body until it was sent.
pub(in crate::http) fn held(answer: Bytes, place: OwnedSemaphorePermit) -> axum::body::Body {
    const PIECE: usize = 64 * 1024;
    let state = (answer, place);
    let pieces = futures_util::stream::unfold(state, async |(mut rest, place)| {
        let piece = rest.split_to(PIECE.min(rest.len()));
        let piece = (!piece.is_empty()).then_some(Ok::<_, std::convert::Infallible>(piece));
        piece.map(|piece| (piece, (rest, place)))
    });
    // Compression asks once more after the end.
    axum::body::Body::from_stream(pieces.fuse())
}

/// How a body comes: it may not stand still, nor trickle for ever. Only waiting counts.
#[derive(Debug)]
pub(in crate::http) struct Pace {
    patience: Duration,
    waited: Duration,
    bytes: u64,
}

impl Pace {
    /// For a client that may be silent so long.
    pub(in crate::http) fn new(patience: Duration) -> Self {
        Self {
            patience,
            waited: Duration::ZERO,
            bytes: 0,
        }
    }

    /// Waits for what comes next.
    ///
    /// # Errors
    /// [`Code::UploadTimeout`].
    pub(in crate::http) async fn wait<T>(&mut self, coming: impl Future<Output = T>) -> Result<T> {
        let left = self.patience.saturating_sub(self.waited);
        let since = Instant::now();
        let came = timeout(left, coming).await.map_err(|_| {
            let (seconds, least) = (self.patience.as_secs(), self.least());
            let detail = format!("less than {least} bytes came in {seconds} seconds");
            ApiError::new(Code::UploadTimeout, detail)
        })?;
        self.waited += since.elapsed();
        Ok(came)
    }

    /// Counts what came.
    pub(in crate::http) fn came(&mut self, bytes: usize) {
        self.bytes += bytes as u64;
        if self.bytes >= self.least() {
            (self.waited, self.bytes) = (Duration::ZERO, 0);
        }
    }

    fn least(&self) -> u64 {
        self.patience.as_secs() * LEAST_RATE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn a_trickle_ends_and_a_slow_stream_does_not() {
        let come = |pace: Pace, bytes: usize| async move {
            let mut pace = pace;
            for _ in 0..100 {
                let later = tokio::time::sleep(Duration::from_secs(1));
                pace.wait(later).await?;
                pace.came(bytes);
            }
            Ok::<_, ApiError>(())
        };
        let pace = || Pace::new(Duration::from_secs(30));
        assert!(come(pace(), 1_100).await.is_ok());
        let slow = come(pace(), 1).await.unwrap_err();
        assert_eq!(slow.code(), Code::UploadTimeout);
    }

    #[tokio::test(start_paused = true)]
    async fn bodies_have_a_total() {
        let bodies = Bodies::default();
        let large = 16 << 20;
        let mut held = Vec::new();
        for _ in 0..4 {
            held.push(bodies.gather(None, large).await.unwrap());
        }
        let refused = bodies.gather(Some(1), large).await.unwrap_err();
        assert_eq!(refused.code(), Code::RateLimited);
        // Small bodies have their own room.
        assert!(bodies.gather(None, JSON_LIMIT).await.is_ok());
        held.pop();
        assert!(bodies.gather(Some(1), large).await.is_ok());
    }
}
