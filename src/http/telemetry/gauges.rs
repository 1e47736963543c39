//! Metrics of jobs, workers and storage. No job has a series of its own.
//!
//! Counters follow the events of the feed, so they count from the start of the process. Gauges are
//! read when Prometheus asks.

use std::collections::HashMap;
use std::path::Path;
use std::sync::atomic::AtomicU64;
use std::sync::{Mutex, PoisonError};

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;
use serde_json::Value;

use crate::folder::CLOUDS;
use crate::http::App;
use crate::http::telemetry::queue::QueueGauges;
use crate::http::telemetry::workers::WorkerGauges;
use crate::http::wire::error::Result;
use crate::jobs::store::{CONTENT_FILE, DATABASE_FILE};
use crate::jobs::worker::slot_of;
use crate::jobs::{Event, EventKind, Job, JobId, Status, Store};

/// Upper bounds in seconds of waits and phases: from an instant to the longest job.
const SECONDS: [f64; 12] = [
    0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 180.0, 600.0, 1_800.0, 3_600.0,
];

/// Upper bounds of the triangles of a mesh: from a thousand to ten million.
const TRIANGLES: [f64; 9] = [1e3, 3e3, 1e4, 3e4, 1e5, 3e5, 1e6, 3e6, 1e7];

/// Most running jobs whose loss is shown. A server has at most one for each worker.
const MAX_RUNNING: u32 = 256;

/// One label: its name is the field's.
macro_rules! labels {
    ($($name:ident { $($field:ident),* })*) => {
        $(#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
        struct $name { $($field: String),* })*
    };
}
labels! {
    ByStatus { status }
    Finished { status, code }
    ByPhase { phase }
    ByReason { reason }
    Trained { scheme, engine }
    BySlot { slot }
    ByKind { kind }
}

type Number = Gauge<f64, AtomicU64>;

/// The metrics of one server.
pub(in crate::http) struct Gauges {
    jobs: Family<ByStatus, Gauge>,
    finished: Family<Finished, Counter>,
    queue_wait: Histogram,
    phases: Family<ByPhase, Histogram>,
    attempts: Family<ByReason, Counter>,
    queue: QueueGauges,
    workers: WorkerGauges,
    evaluations: Family<Trained, Counter>,
    loss: Family<BySlot, Number>,
    triangles: Histogram,
    storage: Family<ByKind, Gauge>,
    free: Gauge,
    streams: Gauge,
    busy: Counter,
    /// The phase that each running job is in, and since when.
    running: Mutex<HashMap<JobId, (String, i64)>>,
}

impl Gauges {
    /// New metrics, added to the registry.
    pub(in crate::http) fn new(registry: &mut Registry) -> Self {
        let gauges = Self {
            queue_wait: Histogram::new(SECONDS),
            triangles: Histogram::new(TRIANGLES),
            phases: Family::new_with_constructor(|| Histogram::new(SECONDS)),
            jobs: Family::default(),
            finished: Family::default(),
            attempts: Family::default(),
            queue: QueueGauges::default(),
            workers: WorkerGauges::default(),
            evaluations: Family::default(),
            loss: Family::default(),
            storage: Family::default(),
            free: Gauge::default(),
            streams: Gauge::default(),
            busy: Counter::default(),
            running: Mutex::default(),
        };
        let g = &gauges;
        g.begin_at_zero();
        registry.register("jobs", "Jobs by status", g.jobs.clone());
        registry.register("jobs_finished", "Jobs that ended", g.finished.clone());
        registry.register(
            "job_queue_wait_seconds",
            "Wait for a worker",
            g.queue_wait.clone(),
        );
        registry.register("job_phase_seconds", "Time in each phase", g.phases.clone());
        registry.register(
            "job_attempts",
            "Attempts, by why they were made",
            g.attempts.clone(),
        );
        g.queue.register(registry);
        g.workers.register(registry);
        registry.register(
            "training_evaluations",
            "Evaluations of loss and gradient",
            g.evaluations.clone(),
        );
        registry.register(
            "training_loss",
            "Last loss of each busy worker",
            g.loss.clone(),
        );
        registry.register(
            "mesh_triangles",
            "Triangles of results",
            g.triangles.clone(),
        );
        registry.register(
            "storage_bytes",
            "Bytes in the data folder",
            g.storage.clone(),
        );
        registry.register(
            "storage_free_bytes",
            "Bytes that can still be written",
            g.free.clone(),
        );
        registry.register("sse_streams", "Open event streams", g.streams.clone());
        registry.register(
            "database_busy",
            "Requests refused by a busy database",
            g.busy.clone(),
        );
        gauges
    }

    /// Makes the series of what is to come: an increase cannot be seen of one that begins with it.
    fn begin_at_zero(&self) {
        for (status, code) in [
            ("succeeded", ""),
            ("cancelled", ""),
            ("failed", "no_surface"),
            ("failed", "training_diverged"),
            ("failed", "mesh_too_large"),
            ("failed", "cloud_missing"),
            ("failed", "out_of_memory"),
            ("failed", "time_limit"),
            ("failed", "worker_crashed"),
            ("failed", "internal"),
        ] {
            let (status, code) = (status.to_owned(), code.to_owned());
            drop(self.finished.get_or_create(&Finished { status, code }));
        }
        for reason in [
            "first",
            "released",
            "worker_crashed",
            "lease_expired",
            "unresponsive",
            "internal",
        ] {
            let reason = reason.to_owned();
            drop(self.attempts.get_or_create(&ByReason { reason }));
        }
    }

    /// Counts a request that the database was too busy for.
    pub(in crate::http) fn database_busy(&self) {
        self.busy.inc();
    }

    /// Counts what an event tells. A job that is erased meanwhile is not counted.
    pub(in crate::http) async fn event(&self, store: &Store, event: &Event) {
        match event.kind {
            EventKind::Phase => {
                let phase = event.data.get("phase").and_then(Value::as_str);
                self.enter(event, phase);
            }
            EventKind::Queued => self.enter(event, None),
            EventKind::Started => {
                self.attempt("first");
                if let Some(job) = job_of(store, event).await {
                    let wait = event.time - job.created_at;
                    self.queue_wait.observe(wait.max(0) as f64 / 1e3);
                }
            }
            EventKind::AttemptStarted => {
                let code = event.data.pointer("/reason/code").and_then(Value::as_str);
                self.attempt(code.unwrap_or("released"));
            }
            kind if kind.is_last() => {
                self.enter(event, None);
                if let Some(job) = job_of(store, event).await {
                    self.ended(&job, event);
                }
            }
            _ => {}
        }
    }

    fn attempt(&self, reason: &str) {
        let reason = reason.to_owned();
        self.attempts.get_or_create(&ByReason { reason }).inc();
    }

    /// Ends the phase that the job was in, and begins another one.
    fn enter(&self, event: &Event, phase: Option<&str>) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((phase, since)) = running.remove(&event.job_id) {
            let seconds = (event.time - since).max(0) as f64 / 1e3;
            self.phases
                .get_or_create(&ByPhase { phase })
                .observe(seconds);
        }
        if let Some(phase) = phase {
            let since = (phase.to_owned(), event.time);
            running.insert(event.job_id.clone(), since);
        }
    }

    fn ended(&self, job: &Job, event: &Event) {
        let code = job.error.as_ref().map_or("", |problem| &problem.code);
        let finished = Finished {
            status: job.status.name().to_owned(),
            code: code.to_owned(),
        };
        self.finished.get_or_create(&finished).inc();
        let trained = Trained {
            scheme: name(&job.settings.network.scheme),
            engine: name(&job.settings.training.engine),
        };
        self.evaluations
            .get_or_create(&trained)
            .inc_by(job.evaluations);
        if let Some(triangles) = event.data.get("triangles").and_then(Value::as_f64) {
            self.triangles.observe(triangles);
        }
    }

    /// Updates all gauges.
    ///
    /// # Errors
    /// Those of the store.
    pub(in crate::http) async fn refresh(&self, app: &App) -> Result<()> {
        let counts = app.store.counts().await?;
        for status in Status::ALL {
            let label = ByStatus {
                status: status.name().to_owned(),
            };
            self.jobs
                .get_or_create(&label)
                .set(counts.get(status) as i64);
        }
        self.queue.refresh(app).await?;
        self.workers.set(*app.workers.borrow());
        self.running_losses(&app.store).await?;
        self.storage(app);
        self.streams.set(app.feed.streams() as i64);
        Ok(())
    }

    async fn running_losses(&self, store: &Store) -> Result<()> {
        // Slots come and go with their workers.
        self.loss.clear();
        for job in store.running_jobs(MAX_RUNNING).await? {
            // The slot, not the process: a restarted worker continues the series.
            let slot = job.worker.as_deref().and_then(slot_of);
            if let (Some(slot), Some(loss)) = (slot, job.loss) {
                let slot = slot.to_string();
                self.loss.get_or_create(&BySlot { slot }).set(loss);
            }
        }
        Ok(())
    }

    fn storage(&self, app: &App) {
        let folder = &app.config.data_dir;
        let database = |name: &str| -> u64 {
            let bytes = ["", "-wal"].map(|end| {
                let file = folder.join(format!("{name}{end}"));
                file.metadata().map_or(0, |found| found.len())
            });
            bytes.iter().sum()
        };
        for (kind, bytes) in [
            ("database", database(DATABASE_FILE)),
            ("content", database(CONTENT_FILE)),
            ("clouds", folder_bytes(&folder.join(CLOUDS))),
            ("cache", app.meshes.bytes()),
        ] {
            let kind = kind.to_owned();
            self.storage
                .get_or_create(&ByKind { kind })
                .set(bytes as i64);
        }
        if let Ok(space) = app.disk.space() {
            self.free.set(space.free_bytes as i64);
        }
    }
}

/// Bytes of the files directly in a folder.
fn folder_bytes(folder: &Path) -> u64 {
    let Ok(entries) = folder.read_dir() else {
        return 0;
    };
    entries
        .filter_map(|entry| entry.ok()?.metadata().ok())
        .map(|found| found.len())
        .sum()
}

async fn job_of(store: &Store, event: &Event) -> Option<Job> {
    store
        .of(&event.tenant)
        .job(&event.job_id)
        .await
        .ok()?
        .found()
}

/// The name of a value as it stands in JSON.
fn name(value: &impl serde::Serialize) -> String {
    let value = serde_json::to_value(value).unwrap_or_default();
    value.as_str().unwrap_or_default().to_owned()
}
