//! The one bag of what handlers need.

use std::path::PathBuf;
use std::sync::{Arc, PoisonError};

use tokio::sync::{RwLock, Semaphore, watch};
use tokio_util::sync::CancellationToken;

use super::bodies::Bodies;
use super::disk::Disk;
use super::error::{ApiError, Code, Result};
use super::feed::Feed;
use super::gauges::Gauges;
use super::mesh_cache::MeshCache;
use super::telemetry::Telemetry;
use crate::config::Config;
use crate::jobs::{Store, Workers};

/// Shared by all requests.
pub type AppState = Arc<App>;

/// What handlers need.
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
    /// Cancelled when the service is to stop: new work is refused, streams and waits end, reads
    /// go on until the workers have given their jobs back.
    pub shutdown: CancellationToken,
    /// When the service started, in milliseconds since the epoch.
    pub started_at: i64,
    /// Memory, in KiB, for the uploads that this process parses at the same time.
    pub(super) parsing: Arc<Semaphore>,
    /// Bytes, in KiB, of the uploads that children parse at the same time.
    pub(super) children: Arc<Semaphore>,
    /// Memory for bodies that are gathered.
    pub(super) bodies: Bodies,
    /// Shared by uploads, taken alone by erasing: see `cloud_files`.
    pub(super) cloud_files: RwLock<()>,
    /// This program, of which a child reads large files.
    pub(super) program: PathBuf,
    /// New events, for streams.
    pub(super) feed: Feed,
    /// Jobs, workers and storage, for Prometheus.
    pub(super) gauges: Arc<Gauges>,
    /// Meshes as files, for downloads.
    pub(super) meshes: Arc<MeshCache>,
    /// Training series that may be written out at the same time.
    pub(super) series: Semaphore,
    /// Requests for values of a field that may be computed at the same time.
    pub(super) evaluations: Semaphore,
}

/// Memory for the uploads that this process parses at the same time, in KiB.
pub(super) const PARSED_KIB: u32 = 96 * 1024;

/// Most bytes of uploads, unpacked, that children parse at the same time, in KiB: a parsed cloud
/// takes up to about 20 times its file.
pub(super) const CHILDREN_KIB: u32 = 64 * 1024;

impl App {
    /// The state of a service over an open store; `program` is the `meshway` to start children of.
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
            Arc::new(Gauges::new(&mut registry))
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
            meshes: Arc::new(MeshCache::new(config.data_dir.join("cache"))),
            series: Semaphore::new(4),
            evaluations: Semaphore::new(1),
            disk: Disk::new(&config),
            telemetry,
            started_at: store.now(),
            cloud_files: RwLock::new(()),
            program,
            parsing: Arc::new(Semaphore::new(PARSED_KIB as usize)),
            children: Arc::new(Semaphore::new(CHILDREN_KIB as usize)),
            bodies: Bodies::default(),
            store,
            config,
            workers,
            shutdown,
        })
    }

    /// Whether new work is taken.
    ///
    /// # Errors
    /// [`Code::Draining`] while the service stops, [`Code::InsufficientStorage`] below the reserve.
    pub(super) fn check_accepting(&self) -> Result<()> {
        if self.shutdown.is_cancelled() {
            let detail = "the service is about to stop; another one may take over";
            return Err(ApiError::new(Code::Draining, detail).retry_after(10));
        }
        self.disk.check(0)
    }

    /// Makes the folders of the data folder; to be called before the first upload.
    ///
    /// # Errors
    /// When a folder cannot be made.
    pub fn make_folders(config: &Config) -> std::io::Result<()> {
        for folder in ["clouds", "tmp", "cache"] {
            std::fs::create_dir_all(config.data_dir.join(folder))?;
        }
        Ok(())
    }
}
