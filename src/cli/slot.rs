//! `meshway slot`: one worker process; started by `meshway serve` and `meshway worker`, not by hand.

use std::io::{BufRead, Read, Write, stdin, stdout};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use rustix::process::{Signal, getpid, kill_process, nice};
use serde::{Deserialize, Serialize};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;

use super::{Failure, Substitute, logging};
use crate::config::{LogFormat, ObjectsUrl};
use crate::jobs::worker::{End, Options, SIGN_OF_LIFE, Signals, Work, reconstruction, worker_name};
use crate::jobs::{JobId, Store, Worker, store};
use crate::reconstruction::set_threads;

/// Below the server, which is to answer while all cores compute.
pub(super) const NICENESS: i32 = 5;

/// Time between two signs of life.
const BEAT: Duration = Duration::from_secs(1);

/// Arguments of `meshway slot`: what tells an operator whose process it is. The rest are
/// [`Orders`].
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// The folder of the service.
    #[arg(long)]
    data_dir: PathBuf,
    /// Number of the worker among those of its service.
    #[arg(long)]
    slot: u16,
}

/// What the server says first, in one line of JSON on standard input.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Orders {
    /// How to work.
    #[serde(flatten)]
    pub(super) options: Options,
    /// The object store of the service.
    pub(super) objects: Option<ObjectsUrl>,
    /// Format of the log.
    pub(super) log_format: LogFormat,
    /// What is logged.
    pub(super) log: String,
    /// The database of the rows, with its password; none: that of the folder.
    pub(super) database: Option<String>,
    /// Whether a pooler stands before it.
    #[serde(default)]
    pub(super) database_pooled: bool,
    /// Name of the start of the service; empty where no other one shares its database.
    #[serde(default)]
    pub(super) node: String,
}

impl Orders {
    fn read() -> Result<Self, Failure> {
        let mut line = String::new();
        let read = stdin().lock().read_line(&mut line);
        read.map_err(|error| Failure::Output(format!("no orders: {error}")))?;
        serde_json::from_str(&line).map_err(|error| {
            let detail = format!("orders are one line of JSON on standard input: {error}");
            Failure::Usage(detail)
        })
    }
}

pub(super) fn run(arguments: &Arguments, substitute: Option<&Substitute>) -> Result<(), Failure> {
    let orders = Orders::read()?;
    logging::start(orders.log_format, &orders.log)?;
    if let Err(error) = nice(NICENESS) {
        tracing::warn!(error.message = %error, "the worker runs at the server's priority");
    }
    let work: Arc<Work> = if let Some(substitute) = substitute {
        Arc::clone(&substitute.work)
    } else {
        set_threads(orders.options.threads).map_err(|error| Failure::Usage(error.to_string()))?;
        Arc::new(reconstruction)
    };
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(|error| Failure::Output(format!("no runtime: {error}")))?;
    if runtime.block_on(work_on(arguments, orders, work))? == End::Hung {
        // Exit handlers would wait for the thread that does not stop.
        kill_process(getpid(), Signal::KILL)
            .map_err(|error| Failure::Output(format!("the worker cannot end: {error}")))?;
    }
    Ok(())
}

async fn work_on(arguments: &Arguments, orders: Orders, work: Arc<Work>) -> Result<End, Failure> {
    let options = orders.options;
    let stopping = CancellationToken::new();
    let wake = listen(&stopping)?;
    let name = worker_name(arguments.slot, std::process::id(), &orders.node);
    let limits = store::Options {
        events_limit: options.events_limit,
        metrics_limit: options.metrics_limit,
        process: name.clone(),
        database: orders.database,
        database_pooled: orders.database_pooled,
        objects: orders.objects,
        ..store::Options::default()
    };
    let failed = |error: crate::jobs::Error| Failure::Output(error.to_string());
    let store = Store::open(&arguments.data_dir, limits)
        .await
        .map_err(failed)?;
    let worker = Worker {
        name,
        store: store.clone(),
        work,
        options,
        signals: Signals {
            wake,
            stopping,
            committed: Box::new(tell),
        },
    };
    let _pulse = AbortOnDropHandle::new(tokio::spawn(pulse()));
    let end = worker.run().await.map_err(failed)?;
    store.close().await;
    Ok(end)
}

/// Gives signs of life on standard output, from the thread that renews the lease.
async fn pulse() {
    let mut beat = tokio::time::interval(BEAT);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        beat.tick().await;
        drop(writeln!(stdout(), "{SIGN_OF_LIFE}"));
    }
}

/// Says on standard output that rows of a job were written. A server that is gone does not listen.
fn tell(job: &JobId) {
    drop(writeln!(stdout(), "J {job}"));
}

/// Hears wake-ups on standard input. Its end, SIGTERM and SIGINT mean to stop.
fn listen(stopping: &CancellationToken) -> Result<watch::Receiver<u64>, Failure> {
    let failed = |error: std::io::Error| Failure::Output(format!("no signals: {error}"));
    let (sender, wake) = watch::channel(0);
    let gone = stopping.clone();
    // A thread, because a task that reads standard input keeps the runtime from ending.
    std::thread::Builder::new()
        .name("wake".to_owned())
        .spawn(move || {
            let mut bytes = [0; 64];
            let mut input = stdin().lock();
            while matches!(input.read(&mut bytes), Ok(1..)) {
                sender.send_modify(|wakes| *wakes += 1);
            }
            gone.cancel();
        })
        .map_err(failed)?;
    for kind in [SignalKind::terminate(), SignalKind::interrupt()] {
        let mut signals = signal(kind).map_err(failed)?;
        let stopping = stopping.clone();
        tokio::spawn(async move {
            signals.recv().await;
            stopping.cancel();
        });
    }
    Ok(wake)
}
