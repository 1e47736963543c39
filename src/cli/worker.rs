//! `meshway worker`: worker processes on a machine of their own, for services that share a database and an
//! object store with it.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use tokio::sync::watch;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::data_folder::DataFolder;
use super::station::{self, Station};
use super::{Failure, Substitute, logging};
use crate::config::{Backend, Work, address};
use crate::http;
use crate::jobs::{Role, Store, Supervisor, Workers};

/// Time between two looks whether there is something to do.
const LOOK: Duration = Duration::from_secs(1);

/// Arguments of `meshway worker`.
#[derive(Debug, Args)]
#[command(args_override_self = true)]
pub(super) struct Arguments {
    #[command(flatten)]
    backend: Backend,

    /// Jobs that are worked on at the same time, each by a process of its own.
    #[arg(long, env = "MESHWAY_SLOTS", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=256))]
    slots: u16,

    #[command(flatten)]
    work: Work,

    /// End when there was nothing to do for so many seconds; 0: never.
    #[arg(
        long,
        env = "MESHWAY_EXIT_WHEN_IDLE",
        default_value_t = 0,
        value_name = "SECONDS"
    )]
    exit_when_idle: u32,

    /// Address for /livez, /readyz and /metrics; without it, nobody is listened to.
    #[arg(long, env = "MESHWAY_LISTEN", value_parser = address)]
    listen: Option<SocketAddr>,

    /// Folder for what is fetched while it is worked on; made if it is missing. It may be lost.
    #[arg(long, env = "MESHWAY_DATA_DIR", default_value = "meshway-worker")]
    data_dir: PathBuf,

    /// How long a computation may take to stop before its worker ends itself.
    #[arg(long, hide = true, default_value_t = 10_000)]
    grace_milliseconds: u32,
}

pub(super) fn run(arguments: &Arguments, substitute: Option<&Substitute>) -> Result<(), Failure> {
    let (backend, work) = (&arguments.backend, &arguments.work);
    let mut problems = work.problems(station::cores(), ("--slots", arguments.slots));
    problems.extend(backend.exposures());
    if backend.database.is_none() || backend.objects.is_none() {
        problems.push(
            "a worker on a machine of its own needs --database and --objects, as its services have \
             them; without them `meshway serve` has workers itself (--workers)"
                .to_owned(),
        );
    }
    if !problems.is_empty() {
        return Err(Failure::Usage(problems.join("\n")));
    }
    logging::start(work.log_format, &work.log)?;
    let runtime = super::runtime()?;
    let result = runtime.block_on(work_on(arguments, substitute));
    runtime.shutdown_background();
    result
}

async fn work_on(arguments: &Arguments, substitute: Option<&Substitute>) -> Result<(), Failure> {
    let folder = DataFolder::take(&arguments.data_dir).await?;
    let station = Station {
        backend: &arguments.backend,
        work: &arguments.work,
        data_dir: &arguments.data_dir,
        slots: arguments.slots,
        role: Role::Worker,
        node: station::new_node(&arguments.backend),
    };
    // It submits nothing.
    let store = station.open(0).await?;
    folder.sweep(&store).await?;
    let program = std::env::current_exe()
        .map_err(|error| Failure::Output(format!("this program cannot be found: {error}")))?;
    let options = station.supervisor(&program, arguments.grace_milliseconds, substitute)?;
    let shutdown = CancellationToken::new();
    let supervisor = Supervisor::new(store.clone(), options, shutdown.clone());
    let workers = supervisor.workers();
    station::end_on_signals(&shutdown)?;
    let close = CancellationToken::new();
    if let Some(address) = arguments.listen {
        let told = (store.clone(), workers.clone());
        http::tell_of_workers(address, told, shutdown.clone(), close.clone())
            .await
            .map_err(|error| Failure::Output(format!("--listen {address}: {error}")))?;
    }
    let node = station.enter(&store).await?;
    tracing::info!(
        node = station.node,
        slots = arguments.slots,
        "the worker is there"
    );
    if arguments.exit_when_idle > 0 {
        let patience = Duration::from_secs(arguments.exit_when_idle.into());
        tokio::spawn(end_when_idle(store.clone(), workers, patience, shutdown));
    }
    supervisor.run().await;
    close.cancel();
    node.leave().await;
    store.close().await;
    tracing::info!("the worker has stopped");
    Ok(())
}

/// Ends the process once nothing was worked on and nothing waited for so long. A job that is claimed at the
/// last moment goes back into the queue.
async fn end_when_idle(
    store: Store,
    workers: watch::Receiver<Workers>,
    patience: Duration,
    shutdown: CancellationToken,
) {
    let mut since = Instant::now();
    while since.elapsed() < patience {
        tokio::time::sleep(LOOK).await;
        let rests = workers.borrow().busy == 0;
        // A database that does not answer may have something to do.
        if !rests || !matches!(store.oldest_queued().await, Ok(None)) {
            since = Instant::now();
        }
    }
    tracing::info!("there was nothing to do; the worker ends");
    shutdown.cancel();
}
