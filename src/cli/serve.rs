//! `meshway serve`: the API and the worker processes, until a signal ends them.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::{Args, CommandFactory, FromArgMatches};
use tokio::net::TcpListener;
use tokio_util::sync::CancellationToken;

use super::data_folder::DataFolder;
use super::files::Sink;
use super::station::{self, Station};
use super::{Cli, Command, Failure, Substitute, logging, upkeep};
use crate::config::{ClientAuth, Config, file_arguments};
use crate::http::{self, App, AppState, Tls, TlsFiles};
use crate::identity::Keyring;
use crate::jobs::{Role, Supervisor};
use crate::webhooks::{Policy, Post, Sender};

/// How long the whole end may take, whatever hangs.
const LONGEST_END: Duration = Duration::from_secs(28);

/// Arguments of `meshway serve`.
#[derive(Debug, Args)]
#[command(args_override_self = true)]
pub(super) struct Arguments {
    #[command(flatten)]
    config: Config,
    /// TOML file with settings, by the names of the flags with underscores, and with keys. SIGHUP
    /// has the keys read again.
    #[arg(long = "config", value_name = "FILE")]
    file: Option<PathBuf>,
    /// Print the settings as such a file, and end.
    #[arg(long)]
    print_config: bool,
    /// What the flag is called elsewhere: whoever types it is told of `--listen`.
    #[arg(long, hide = true)]
    port: Option<String>,
    /// How long a computation may take to stop before its worker ends itself.
    #[arg(long, hide = true, default_value_t = 10_000)]
    grace_milliseconds: u32,
}

impl Arguments {
    /// The command line again, with the settings of `--config` before the flags that override them.
    pub(super) fn with_file(&self, line: &[OsString]) -> Result<Cli, Failure> {
        let Some(path) = &self.file else {
            return parse(line);
        };
        let text = std::fs::read_to_string(path)
            .map_err(|error| Failure::Usage(format!("--config {}: {error}", path.display())))?;
        let program = Cli::command();
        let command = program.find_subcommand("serve").unwrap_or(&program);
        let settings = file_arguments(&text, command)
            .map_err(|error| Failure::Usage(format!("--config {}: {error}", path.display())))?;
        // The program and its subcommand come first.
        let (head, flags) = line.split_at(line.len().min(2));
        let mut cli = parse(&[head, &settings, flags].concat())?;
        if let Command::Serve(arguments) = &mut cli.command {
            let keys = Keyring::of_file(&text);
            arguments.config.keys = keys
                .map_err(|fault| Failure::Usage(format!("--config {}: {fault}", path.display())))?;
        }
        Ok(cli)
    }
}

fn parse(line: &[OsString]) -> Result<Cli, Failure> {
    let matches = Cli::command().get_matches_from(line);
    Cli::from_arg_matches(&matches).map_err(|error| Failure::Usage(error.to_string()))
}

pub(super) fn run(arguments: &Arguments, substitute: Option<&Substitute>) -> Result<(), Failure> {
    let config = &arguments.config;
    if let Some(port) = &arguments.port {
        let meant = format!("there is no --port; use --listen 127.0.0.1:{port}");
        return Err(Failure::Usage(meant));
    }
    if arguments.print_config {
        let text = config
            .to_toml()
            .map_err(|error| Failure::Output(error.to_string()))?;
        return Sink::new(Path::new("-"))?.write(|out| out.write_all(text.as_bytes()));
    }
    let problems = config.problems(station::cores());
    if !problems.is_empty() {
        return Err(Failure::Usage(problems.join("\n")));
    }
    logging::start(config.work.log_format, &config.work.log)?;
    let runtime = super::runtime()?;
    let result = runtime.block_on(serve(arguments, substitute));
    // Tasks that still run after the drain are not awaited.
    runtime.shutdown_background();
    result
}

async fn serve(arguments: &Arguments, substitute: Option<&Substitute>) -> Result<(), Failure> {
    let config = &arguments.config;
    let folder = DataFolder::take(&config.data_dir).await?;
    let failed = |error: crate::jobs::Error| Failure::Output(error.to_string());
    let station = Station {
        backend: &config.backend,
        work: &config.work,
        data_dir: &config.data_dir,
        slots: config.workers,
        role: Role::Serve,
        node: station::new_node(&config.backend),
    };
    let store = station.open(config.queue_limit).await?;
    folder.sweep(&store).await?;
    if store.keeps_files() {
        store.collect_garbage(None).await.map_err(failed)?;
    } else {
        tokio::spawn(upkeep::collect_garbage(store.clone()));
    }
    let node = station.enter(&store).await?;
    // The last server may have died after erasing something and before this.
    store.shred();

    for key in store.keys().await.map_err(failed)? {
        config.keys.add(key);
    }
    upkeep::tell_doubts(&config.keys, &store);
    let tls = tls(config)?;
    let post = Post::new(Policy::of(config), config.webhook_ca.as_deref())
        .map_err(|error| Failure::Usage(format!("--webhook-ca {error}")))?;
    let sender = Sender::new(store.clone(), post);
    let listen = |error| Failure::Output(format!("--listen {}: {error}", config.listen));
    let listener = TcpListener::bind(config.listen).await.map_err(listen)?;
    let address = listener.local_addr().map_err(listen)?;
    let program = std::env::current_exe()
        .map_err(|error| Failure::Output(format!("this program cannot be found: {error}")))?;
    let shutdown = CancellationToken::new();
    let options = station.supervisor(&program, arguments.grace_milliseconds, substitute)?;
    let supervisor = Supervisor::new(store.clone(), options, shutdown.clone());
    let workers = supervisor.workers();
    let app = App::new(
        store.clone(),
        config.clone(),
        workers,
        shutdown.clone(),
        program,
    );
    station::end_on_signals(&shutdown)?;
    if let Some(file) = &arguments.file {
        upkeep::reload_keys(file.clone(), config.keys.clone(), store.clone())?;
    }
    tokio::spawn(upkeep::keep_histories(
        store.clone(),
        config.pack_after_hours,
    ));
    tokio::spawn(upkeep::keep_audit(store.clone(), config.clone()));
    tokio::spawn(http::keep_sweeping(AppState::clone(&app)));
    tokio::spawn(http::follow(AppState::clone(&app)));
    tokio::spawn(sender.run(shutdown.clone()));
    let scheme = if tls.is_some() { "https" } else { "http" };
    tracing::info!("listening on {scheme}://{address}");
    if tls.is_none() && !config.keys.is_empty() && !config.listen.ip().is_loopback() {
        tracing::warn!("keys and surfaces travel unencrypted: give --tls-cert and --tls-key");
    }

    let close = CancellationToken::new();
    let work = async {
        supervisor.run().await;
        close.cancel();
    };
    let service = async {
        tokio::join!(
            http::serve_tls(listener, tls.clone(), app, close.clone()),
            work
        );
    };
    let certificate = async {
        match &tls {
            Some(tls) => tls.follow().await.map(|never| match never {}),
            None => std::future::pending().await,
        }
    };
    let overdue = async {
        shutdown.cancelled().await;
        tracing::info!("the service stops");
        tokio::time::sleep(LONGEST_END).await;
    };
    tokio::select! {
        () = service => {}
        failed = certificate => failed.map_err(|error| Failure::Output(format!("no signals: {error}")))?,
        () = overdue => tracing::error!("not all ended in time"),
    }
    node.leave().await;
    store.close().await;
    tracing::info!("the service has stopped");
    Ok(())
}

/// TLS, where it is asked for.
fn tls(config: &Config) -> Result<Option<Arc<Tls>>, Failure> {
    let (Some(cert), Some(key)) = (config.tls_cert.clone(), config.tls_key.clone()) else {
        return Ok(None);
    };
    let client_ca = config.tls_client_ca.clone();
    let files = TlsFiles {
        cert,
        key,
        client_ca,
        client_optional: config.tls_client_auth == ClientAuth::Optional,
    };
    let tls = Tls::load(files).map_err(|error| Failure::Usage(format!("TLS: {error}")))?;
    Ok(Some(Arc::new(tls)))
}
