//! The source of all event streams: one task that reads each new event once and passes it on.
//!
//! If each of five hundred streams queried the database, every commit would cost five hundred reads.
//! A stream that missed something here, because it was slow or joined late, reads the rows itself.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{OwnedSemaphorePermit, Semaphore, broadcast, watch};
use tokio_util::sync::CancellationToken;

use crate::http::telemetry::gauges::Gauges;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::jobs::{Event, JobId, Store};

/// Events that a slow stream may lag behind before it has to read rows.
const BACKLOG: usize = 1_024;

/// Events read at once.
const PAGE: u32 = 500;

/// Longest time between two looks at the database: what a lost wake-up costs.
const POLL: Duration = Duration::from_secs(1);

/// Shortest time between two looks, however many commits there are.
const PAUSE: Duration = Duration::from_millis(20);

/// What streams hear of.
#[derive(Debug, Clone)]
pub(in crate::http) enum News {
    /// An event was committed.
    Event(Arc<Event>),
    /// A job was erased, and has no events any more.
    Erased(JobId),
}

/// New events, as they are committed.
pub(in crate::http) struct Feed {
    news: broadcast::Sender<News>,
    position: watch::Receiver<Option<i64>>,
    places: Arc<Semaphore>,
    max_streams: u32,
    clients: Arc<Clients>,
}

/// How many streams each client has, of those that a client may have.
struct Clients {
    most: u32,
    open: Mutex<HashMap<IpAddr, u32>>,
}

impl Clients {
    fn open(&self) -> MutexGuard<'_, HashMap<IpAddr, u32>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A stream more for the client.
    fn enter(self: &Arc<Self>, client: IpAddr) -> Result<Share> {
        let mut open = self.open();
        let streams = open.entry(client).or_default();
        if *streams >= self.most {
            let detail = format!(
                "{} event streams of this client are open already",
                self.most
            );
            return Err(ApiError::new(Code::RateLimited, detail).retry_after(5));
        }
        *streams += 1;
        Ok(Share(Arc::clone(self), client))
    }
}

/// A stream of a client.
struct Share(Arc<Clients>, IpAddr);

impl Drop for Share {
    fn drop(&mut self) {
        let mut open = self.0.open();
        if let Some(streams) = open.get_mut(&self.1) {
            *streams -= 1;
            if *streams == 0 {
                open.remove(&self.1);
            }
        }
    }
}

/// One stream's share of the feed; gives its place back when it is dropped.
pub(in crate::http) struct Listener {
    /// What is new.
    pub(in crate::http) news: broadcast::Receiver<News>,
    _place: OwnedSemaphorePermit,
    _share: Option<Share>,
}

impl Feed {
    /// Starts the task, which ends with `shutdown`, for so many streams in all and of one client.
    /// Needs a tokio runtime.
    pub(in crate::http) fn start(
        store: Store,
        gauges: Arc<Gauges>,
        [max_streams, most]: [u32; 2],
        shutdown: CancellationToken,
    ) -> Self {
        let (news, _) = broadcast::channel(BACKLOG);
        let (position, watched) = watch::channel(None);
        let task = Task {
            store,
            gauges,
            news: news.clone(),
            position,
        };
        tokio::spawn(shutdown.run_until_cancelled_owned(task.run()));
        Self {
            news,
            position: watched,
            places: Arc::new(Semaphore::new(max_streams as usize)),
            max_streams,
            clients: Arc::new(Clients {
                most,
                open: Mutex::default(),
            }),
        }
    }

    /// Listens to all events that are committed from now on.
    ///
    /// # Errors
    /// [`Code::RateLimited`] when there are as many streams as allowed, of all or of the client.
    pub(in crate::http) async fn listen(&self, client: Option<IpAddr>) -> Result<Listener> {
        let share = client
            .map(|client| self.clients.enter(client))
            .transpose()?;
        let place = Arc::clone(&self.places).try_acquire_owned().map_err(|_| {
            ApiError::new(
                Code::RateLimited,
                format!("{} event streams are open already", self.max_streams),
            )
            .retry_after(5)
        })?;
        let listener = Listener {
            news: self.news.subscribe(),
            _place: place,
            _share: share,
        };
        // Only after the task knows where it starts is nothing lost between rows and feed.
        let mut position = self.position.clone();
        position
            .wait_for(Option::is_some)
            .await
            .map_err(|_| ApiError::new(Code::Draining, "the service is about to stop"))?;
        Ok(listener)
    }

    /// Tells the streams of a job that it was erased.
    pub(in crate::http) fn erased(&self, job: JobId) {
        // Without streams nobody takes it.
        let _ = self.news.send(News::Erased(job));
    }

    /// Open streams.
    pub(in crate::http) fn streams(&self) -> u64 {
        u64::from(self.max_streams) - self.places.available_permits() as u64
    }
}

struct Task {
    store: Store,
    gauges: Arc<Gauges>,
    news: broadcast::Sender<News>,
    position: watch::Sender<Option<i64>>,
}

impl Task {
    async fn run(self) {
        let mut changed = self.store.changed();
        let mut seq = loop {
            match self.store.last_seq_of_all().await {
                Ok(seq) => break seq,
                Err(error) => tracing::warn!(error.message = %error, "no events can be read"),
            }
            tokio::time::sleep(POLL).await;
        };
        self.position.send_replace(Some(seq));
        loop {
            // The time limit makes up for a lost wake-up; a closed store answers with an error.
            let _ = tokio::time::timeout(POLL, changed.changed()).await;
            seq = self.forward(seq).await;
            tokio::time::sleep(PAUSE).await;
        }
    }

    /// Hands on what came after `seq`, and says how far it came.
    async fn forward(&self, mut seq: i64) -> i64 {
        loop {
            let events = match self.store.events_of_all(seq, PAGE).await {
                Ok(events) => events,
                Err(error) => {
                    tracing::warn!(error.message = %error, "no events can be read");
                    return seq;
                }
            };
            let full = events.len() == PAGE as usize;
            for event in events {
                seq = event.seq;
                self.gauges.event(&self.store, &event).await;
                // Without streams nobody takes it; the rows stay.
                let _ = self.news.send(News::Event(Arc::new(event)));
            }
            if !full {
                return seq;
            }
        }
    }
}
