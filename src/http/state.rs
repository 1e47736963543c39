//! The state that all handlers share.

use std::net::IpAddr;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError};

use tokio::sync::{RwLock, Semaphore, watch};
use tokio_util::sync::CancellationToken;

use crate::config::Config;
use crate::folder::{CACHE, Disk};
use crate::http::api;
use crate::http::door::keys::Minutely;
use crate::http::door::limits::Windows;
use crate::http::door::passwords::Passwords;
use crate::http::resources::events::feed::Feed;
use crate::http::resources::meshes::cache::MeshCache;
use crate::http::telemetry::gauges::Gauges;
use crate::http::telemetry::{Telemetry, own};
use crate::http::upload::bodies::Bodies;
use crate::http::upload::parts::Turns;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::intake::Reader;
use crate::jobs::{Place, Store, Workers};

/// Shared by all requests.
pub type AppState = Arc<App>;

/// The state that all handlers share.
pub struct App {
    /// Rows of clouds and jobs. Its commits wake event streams and the supervisor.
    pub store: Store,
    /// Flags of the operator.
    pub config: Config,
    /// Guards the space that is kept free.
    pub disk: Disk,
    /// Counters for Prometheus.
    pub telemetry: Telemetry,
    /// What the supervisor says of its workers.
    pub workers: watch::Receiver<Workers>,
    /// Cancelled when the service shall stop. New work is refused, streams and waits end; reads are
    /// answered until the workers have given their jobs back.
    pub shutdown: CancellationToken,
    /// Jobs that all processes with these records work on at the same time.
    pub(in crate::http) slots: AtomicU64,
    /// When the service started, in milliseconds since the epoch.
    pub started_at: i64,
    /// Addresses of strangers that the audit trail told of a short while ago.
    pub(in crate::http) strangers: Minutely<Option<IpAddr>>,
    /// Ids of keys whose use was noted a short while ago.
    pub(in crate::http) uses: Minutely<Arc<str>>,
    /// Requests of tenants and keys in the present minute.
    pub(in crate::http) windows: Windows,
    /// Passwords that were tried.
    pub(in crate::http) passwords: Passwords,
    /// Reads uploads.
    pub(in crate::http) reader: Reader,
    /// Memory for bodies that are held in memory.
    pub(in crate::http) bodies: Bodies,
    /// Whose turn it is at uploads that may go on.
    pub(in crate::http) turns: Turns,
    /// Uploads take it shared, erasing takes it exclusively: see `resources/clouds/files.rs`.
    pub(in crate::http) cloud_files: RwLock<()>,
    /// New events, for streams.
    pub(in crate::http) feed: Feed,
    /// Jobs, workers and storage, for Prometheus.
    pub(in crate::http) gauges: Arc<Gauges>,
    /// Meshes as files, for downloads.
    pub(in crate::http) meshes: Arc<MeshCache>,
    /// Training series that may be written out at the same time.
    pub(in crate::http) series: Semaphore,
    /// Requests for values of a field that may be computed at the same time.
    pub(in crate::http) evaluations: Semaphore,
}

impl App {
    /// The state of a service over an open store. `program` is the `meshway` that child processes
    /// run.
    pub fn new(
        store: Store,
        config: Config,
        workers: watch::Receiver<Workers>,
        shutdown: CancellationToken,
        program: PathBuf,
    ) -> AppState {
        let telemetry = Telemetry::default();
        let gauges = {
            let registry = telemetry.registry.lock();
            let mut registry = registry.unwrap_or_else(PoisonError::into_inner);
            Arc::new(Gauges::new(own(&mut registry)))
        };
        let feed = Feed::start(
            store.clone(),
            Arc::clone(&gauges),
            [config.max_streams, config.streams_per_client()],
            shutdown.clone(),
        );
        Arc::new(Self {
            feed,
            gauges,
            meshes: Arc::new(MeshCache::new(config.data_dir.join(CACHE))),
            series: Semaphore::new(4),
            evaluations: Semaphore::new(1),
            disk: Disk::new(
                config.data_dir.clone(),
                config.disk_reserve_mib,
                config.disk_reserve_percent.into(),
            ),
            telemetry,
            strangers: Minutely::default(),
            uses: Minutely::default(),
            windows: Windows::default(),
            passwords: Passwords::default(),
            slots: AtomicU64::new(config.workers.into()),
            started_at: store.now(),
            turns: Turns::default(),
            cloud_files: RwLock::new(()),
            reader: Reader::new(config.max_points, config.body_limit_bytes(), program),
            bodies: Bodies::default(),
            store,
            config,
            workers,
            shutdown,
        })
    }

    /// A place in the queue as clients see it.
    pub(in crate::http) fn shown(&self, place: &Place) -> api::Place {
        api::Place {
            queue_position: place.position,
            eta_seconds: place.eta_seconds(self.slots.load(Ordering::Relaxed)),
        }
    }

    /// Whether new work is taken.
    ///
    /// # Errors
    /// [`Code::Draining`] while the service stops, [`Code::InsufficientStorage`] below the reserve.
    pub(in crate::http) fn check_accepting(&self) -> Result<()> {
        if self.shutdown.is_cancelled() {
            let detail = "the service is about to stop; another one may take over";
            return Err(ApiError::new(Code::Draining, detail).retry_after(10));
        }
        Ok(self.disk.check(0)?)
    }
}
