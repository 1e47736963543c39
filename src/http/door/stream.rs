//! The stream of a connection, which ends what hyper ends by itself as a client can understand it.
//!
//! What is no HTTP hyper refuses with a status and nothing else: it gets the problem of every other
//! refusal here. And where a request is answered before its body has come, closing at once would
//! break the pipe under a client that still writes, before it has read why.

use std::io::{self, IoSlice};
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;

use axum::body::{Body, Bytes, HttpBody};
use bytes::Buf;
use hyper::body::{Frame, Incoming, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Sleep, sleep};

use super::places::Place;
use crate::http::wire::error::{ApiError, Code};

/// How long a client may go on sending what nobody reads.
const LINGER: Duration = Duration::from_secs(5);

/// What the stream has to know of the requests on it.
#[derive(Debug, Default)]
pub(super) struct Requests {
    /// Whether bytes of an answer of ours may still be on their way through hyper.
    answering: AtomicBool,
    /// Whether the client may be sending what nobody reads.
    unread: AtomicBool,
}

impl Requests {
    /// Notes that a request is worked on; gives its body.
    pub(super) fn begin(self: &Arc<Self>, body: Incoming) -> Body {
        self.answering.store(true, Ordering::Relaxed);
        self.unread.store(!body.is_end_stream(), Ordering::Relaxed);
        Body::new(Received {
            body,
            requests: Arc::clone(self),
        })
    }
}

/// The body of a request, which notes its end.
struct Received {
    body: Incoming,
    requests: Arc<Requests>,
}

impl HttpBody for Received {
    type Data = Bytes;
    type Error = hyper::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, hyper::Error>>> {
        let frame = ready!(Pin::new(&mut self.body).poll_frame(context));
        if frame.is_none() || self.body.is_end_stream() {
            self.requests.unread.store(false, Ordering::Relaxed);
        }
        Poll::Ready(frame)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// The stream.
pub(super) struct Stream<S> {
    inner: S,
    place: Arc<Place>,
    requests: Arc<Requests>,
    /// What is left to send in the place of a bare refusal, once there was one.
    refusal: Option<Bytes>,
    linger: Option<Pin<Box<Sleep>>>,
}

impl<S: AsyncRead + AsyncWrite + Unpin> Stream<S> {
    /// Of the connection on this place.
    pub(super) fn new(inner: S, place: Arc<Place>, requests: Arc<Requests>) -> Self {
        Self {
            inner,
            place,
            requests,
            refusal: None,
            linger: None,
        }
    }

    /// Whether `bytes` are a bare refusal; the problem in its place is sent then.
    fn poll_refusal(&mut self, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<bool>> {
        if self.refusal.is_none() {
            // Between two requests only hyper itself has something to say.
            let answering = self.requests.answering.load(Ordering::Relaxed);
            if answering || !self.place.is_idle() || !bytes.starts_with(b"HTTP/1.1 4") {
                return Poll::Ready(Ok(false));
            }
            self.refusal = Some(refusal(bytes));
            self.requests.unread.store(true, Ordering::Relaxed);
        }
        let Some(left) = &mut self.refusal else {
            return Poll::Ready(Ok(false));
        };
        while left.has_remaining() {
            let written = ready!(Pin::new(&mut self.inner).poll_write(context, left))?;
            if written == 0 {
                return Poll::Ready(Err(io::ErrorKind::WriteZero.into()));
            }
            left.advance(written);
        }
        Poll::Ready(Ok(true))
    }
}

/// The problem for what hyper refuses with the status in `bytes`.
fn refusal(bytes: &[u8]) -> Bytes {
    let error = if bytes.starts_with(b"HTTP/1.1 400") {
        ApiError::new(Code::MalformedRequest, "this is no request of HTTP/1.1")
    } else {
        super::head::too_large()
    };
    let entry = error.code().entry();
    let body = serde_json::to_string(&error.body(None)).unwrap_or_default();
    let head = format!(
        "HTTP/1.1 {} {}\r\ncontent-type: application/problem+json\r\ncontent-length: {}\r\n\
         connection: close\r\n\r\n",
        entry.status,
        axum::http::StatusCode::from_u16(entry.status)
            .ok()
            .and_then(|status| status.canonical_reason())
            .unwrap_or_default(),
        body.len()
    );
    (head + &body).into()
}

impl<S: AsyncRead + Unpin> AsyncRead for Stream<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.inner).poll_read(context, buffer)
    }
}

impl<S: AsyncRead + AsyncWrite + Unpin> AsyncWrite for Stream<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        if ready!(self.poll_refusal(context, bytes))? {
            return Poll::Ready(Ok(bytes.len()));
        }
        Pin::new(&mut self.inner).poll_write(context, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        parts: &[IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        if let Some(first) = parts.first()
            && ready!(self.poll_refusal(context, first))?
        {
            return Poll::Ready(Ok(parts.iter().map(|part| part.len()).sum()));
        }
        Pin::new(&mut self.inner).poll_write_vectored(context, parts)
    }

    fn is_write_vectored(&self) -> bool {
        self.inner.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        ready!(Pin::new(&mut self.inner).poll_flush(context))?;
        if self.place.is_idle() {
            self.requests.answering.store(false, Ordering::Relaxed);
        }
        Poll::Ready(Ok(()))
    }

    /// Tells the client that nothing more comes; then takes what it still sends, for a while.
    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        if self.linger.is_none() {
            ready!(Pin::new(&mut self.inner).poll_shutdown(context))?;
            if !self.requests.unread.load(Ordering::Relaxed) {
                return Poll::Ready(Ok(()));
            }
        }
        let this = &mut *self;
        let linger = this.linger.get_or_insert_with(|| Box::pin(sleep(LINGER)));
        let mut dropped = [0; 16 * 1024];
        while linger.as_mut().poll(context).is_pending() {
            let mut buffer = ReadBuf::new(&mut dropped);
            let read = Pin::new(&mut this.inner).poll_read(context, &mut buffer);
            // An end, or an error: the client is gone.
            if ready!(read).is_err() || buffer.filled().is_empty() {
                break;
            }
        }
        Poll::Ready(Ok(()))
    }
}
