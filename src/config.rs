//! What an operator may turn: one struct, from flags, environment and a TOML file.
//!
//! A flag wins over the environment (`MESHWAY_…`), that over the file (`--config`), that over the
//! default. There is one declaration of each setting, the field below: keys of the file are turned
//! into the flags of the same name before the command line is read, see [`file_arguments`].

use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;

use clap::builder::Resettable;
use clap::error::{ContextKind, ContextValue};
use clap::{Args, Command};
use serde::Serialize;
use thiserror::Error;
use toml::de::{DeTable, DeValue};

use crate::nearest::did_you_mean;

const MIB: u64 = 1024 * 1024;

/// Settings of `meshway serve`.
#[derive(Debug, Clone, Serialize, Args)]
pub struct Config {
    /// Address to listen on. Other than loopback needs --allow-unauthenticated.
    #[arg(long, env = "MESHWAY_LISTEN", default_value = "127.0.0.1:8080")]
    pub listen: SocketAddr,

    /// Folder for the database and the uploaded clouds; made if it is missing.
    #[arg(long, env = "MESHWAY_DATA_DIR", default_value = "meshway-data")]
    pub data_dir: PathBuf,

    /// Accept requests without keys on an address that others can reach.
    #[arg(long, env = "MESHWAY_ALLOW_UNAUTHENTICATED", num_args = 0..=1, require_equals = true,
          default_value_t = false, default_missing_value = "true", action = clap::ArgAction::Set)]
    pub allow_unauthenticated: bool,

    /// Names that the service goes by besides localhost and its addresses, with commas between
    /// them; `*`: all. A request for another host is refused: it may come from a web page.
    #[arg(long, env = "MESHWAY_ALLOWED_HOSTS", default_value = "")]
    pub allowed_hosts: String,

    /// Worker processes.
    #[arg(long, env = "MESHWAY_WORKERS", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(1..=256))]
    pub workers: u16,

    /// Threads of each worker; 0: the cores shared out among the workers.
    #[arg(long, env = "MESHWAY_THREADS_PER_WORKER", default_value_t = 0)]
    pub threads_per_worker: u16,

    /// Most memory of a worker in MiB, above which it is killed; 0: no limit.
    #[arg(long, env = "MESHWAY_WORKER_MEMORY_MIB", default_value_t = 4_096)]
    pub worker_memory_mib: u64,

    /// Largest upload in MiB, as sent and after decompression.
    #[arg(long, env = "MESHWAY_BODY_LIMIT_MIB", default_value_t = 512,
          value_parser = clap::value_parser!(u64).range(1..=65_536))]
    pub body_limit_mib: u64,

    /// Most points of a cloud.
    #[arg(long, env = "MESHWAY_MAX_POINTS", default_value_t = 5_000_000)]
    pub max_points: u64,

    /// Most jobs that wait; more get 503.
    #[arg(long, env = "MESHWAY_QUEUE_LIMIT", default_value_t = 1_000)]
    pub queue_limit: u32,

    /// Longest time that is worked on one job, in seconds, over all its attempts.
    #[arg(long, env = "MESHWAY_JOB_TIME_LIMIT_SECONDS", default_value_t = 3_600)]
    pub job_time_limit_seconds: u32,

    /// Seconds between checkpoints of a training run.
    #[arg(long, env = "MESHWAY_CHECKPOINT_SECONDS", default_value_t = 10)]
    pub checkpoint_seconds: u32,

    /// Free space in MiB below which new work is refused with 507.
    #[arg(long, env = "MESHWAY_DISK_RESERVE_MIB", default_value_t = 1_024)]
    pub disk_reserve_mib: u64,

    /// Free space in percent of the disk below which new work is refused with 507.
    #[arg(long, env = "MESHWAY_DISK_RESERVE_PERCENT", default_value_t = 5,
          value_parser = clap::value_parser!(u8).range(0..=90))]
    pub disk_reserve_percent: u8,

    /// Most events kept for a job.
    #[arg(long, env = "MESHWAY_MAX_EVENTS", default_value_t = 100_000)]
    pub max_events: u32,

    /// Most metric rows kept for a job.
    #[arg(long, env = "MESHWAY_MAX_METRICS", default_value_t = 200_000)]
    pub max_metrics: u32,

    /// Most open event streams.
    #[arg(long, env = "MESHWAY_MAX_STREAMS", default_value_t = 1_000)]
    pub max_streams: u32,

    /// Most open connections.
    #[arg(long, env = "MESHWAY_MAX_CONNECTIONS", default_value_t = 4_096)]
    pub max_connections: u32,

    /// Seconds without a byte of an upload after which it ends with 408.
    #[arg(long, env = "MESHWAY_UPLOAD_TIMEOUT_SECONDS", default_value_t = 30)]
    pub upload_timeout_seconds: u32,

    /// Seconds to wait for the next request's header on a connection.
    #[arg(long, env = "MESHWAY_HEADER_TIMEOUT_SECONDS", default_value_t = 75)]
    pub header_timeout_seconds: u32,

    /// Format of the log.
    #[arg(long, env = "MESHWAY_LOG_FORMAT", default_value = "text", value_enum)]
    pub log_format: LogFormat,

    /// What is logged, as in `info,meshway=debug`.
    #[arg(long, env = "MESHWAY_LOG", default_value = "info")]
    pub log: String,
}

/// Format of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum LogFormat {
    /// Lines for people.
    Text,
    /// One JSON object a line.
    Json,
}

impl Config {
    /// Largest upload in bytes.
    pub fn body_limit_bytes(&self) -> u64 {
        self.body_limit_mib * MIB
    }

    /// Most memory of a worker in bytes; `None`: no limit.
    pub fn worker_memory_bytes(&self) -> Option<u64> {
        (self.worker_memory_mib > 0).then_some(self.worker_memory_mib * MIB)
    }

    /// Threads of each worker on a machine with `cores`: together never more than the cores.
    pub fn worker_threads(&self, cores: usize) -> usize {
        let share = (cores / usize::from(self.workers)).max(1);
        match usize::from(self.threads_per_worker) {
            0 => share,
            asked => asked.min(share),
        }
    }

    /// What contradicts itself or the machine, each in one sentence.
    pub fn problems(&self, cores: usize) -> Vec<String> {
        let mut problems = Vec::new();
        if !self.listen.ip().is_loopback() && !self.allow_unauthenticated {
            problems.push(format!(
                "--listen {}: others can reach this address and there are no keys yet; listen on \
                 127.0.0.1 behind a proxy that authenticates, or give --allow-unauthenticated",
                self.listen
            ));
        }
        let asked = usize::from(self.workers) * usize::from(self.threads_per_worker.max(1));
        if asked > cores {
            problems.push(format!(
                "--workers {} with --threads-per-worker {} take {asked} threads, but there are \
                 {cores} cores",
                self.workers, self.threads_per_worker
            ));
        }
        problems
    }

    /// The settings as a file that `--config` takes.
    ///
    /// # Errors
    /// When a value has no form in TOML.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

/// Why a configuration file is refused.
#[derive(Debug, Error)]
pub enum FileError {
    /// Not TOML.
    #[error("{0}")]
    Syntax(#[from] toml::de::Error),
    /// A key that no setting has, or a value that its setting does not take.
    #[error("line {line}: {key} {detail}")]
    Setting {
        /// Line of the file, from 1.
        line: usize,
        /// The key.
        key: String,
        /// What is wrong with it, and what is allowed.
        detail: String,
    },
}

/// Turns the keys of a configuration file into flags of `command`, leaving out those that the
/// environment sets: flags given later on the command line override them.
///
/// # Errors
/// [`FileError`] for text that is no flat TOML, and for unknown keys.
pub fn file_arguments(text: &str, command: &Command) -> Result<Vec<OsString>, FileError> {
    let table = DeTable::parse(text)?;
    // What the environment says is not the file's fault.
    let alone = command
        .clone()
        .no_binary_name(true)
        .mut_args(|argument| argument.env(Resettable::Reset));
    let mut arguments = Vec::new();
    for (key, value) in table.get_ref() {
        let line = 1 + text[..key.span().start].matches('\n').count();
        let key = key.get_ref().as_ref();
        let wrong = |detail: String| FileError::Setting {
            line,
            key: key.to_owned(),
            detail,
        };
        let known = || command.get_arguments().filter(|a| a.get_env().is_some());
        let Some(argument) = known().find(|a| a.get_id().as_str() == key) else {
            let known: Vec<_> = known().map(|a| a.get_id().as_str()).collect();
            let meant = did_you_mean(key, known.iter().copied());
            let known = known.join(", ");
            return Err(wrong(format!("is unknown; known are: {known}{meant}")));
        };
        let value = match value.get_ref() {
            DeValue::String(text) => text.clone().into_owned(),
            DeValue::Integer(number) => number.to_string(),
            DeValue::Float(number) => number.to_string(),
            DeValue::Boolean(switch) => switch.to_string(),
            _ => return Err(wrong("must be a string, a number or a boolean".to_owned())),
        };
        let flag = format!("--{}={value}", key.replace('_', "-"));
        if let Err(error) = alone.clone().try_get_matches_from([&flag]) {
            return Err(wrong(format!("is {value:?}: {}", reason(&error))));
        }
        let in_environment = argument
            .get_env()
            .is_some_and(|name| std::env::var_os(name).is_some());
        if !in_environment {
            arguments.push(flag.into());
        }
    }
    Ok(arguments)
}

/// Why a value is refused, without what is said about flags.
fn reason(error: &clap::Error) -> String {
    let allowed = match error.get(ContextKind::ValidValue) {
        Some(ContextValue::Strings(names)) => Some(format!("must be one of {}", names.join(", "))),
        _ => None,
    };
    let source = || std::error::Error::source(error).map(ToString::to_string);
    let reason = allowed.or_else(source);
    reason.unwrap_or_else(|| error.kind().to_string())
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    #[command(args_override_self = true)]
    struct Program {
        #[command(flatten)]
        config: Config,
    }

    fn parse(file: &str, flags: &[&str]) -> Config {
        let command = <Program as clap::CommandFactory>::command();
        let mut arguments = vec![OsString::from("meshway")];
        arguments.extend(file_arguments(file, &command).unwrap());
        arguments.extend(flags.iter().map(OsString::from));
        Program::try_parse_from(arguments).unwrap().config
    }

    #[test]
    fn flags_win_over_the_file_and_the_file_over_defaults() {
        let config = parse(
            "workers = 3\nqueue_limit = 7\nallow_unauthenticated = true",
            &["--workers=2"],
        );
        assert_eq!(
            (config.workers, config.queue_limit, config.max_events),
            (2, 7, 100_000)
        );
        assert!(config.allow_unauthenticated);
    }

    #[test]
    fn the_printed_configuration_reads_back() {
        let config = parse("", &["--workers", "2", "--log-format", "json"]);
        let text = config.to_toml().unwrap();
        assert_eq!(parse(&text, &[]).to_toml().unwrap(), text);
    }

    #[test]
    fn what_is_wrong_in_the_file_is_told_with_its_line() {
        let command = <Program as clap::CommandFactory>::command();
        for (wrong, said) in [
            ("worker = 3", "worker is unknown; known are: listen, "),
            ("worker = 3", "; did you mean workers?"),
            (
                "workers = \"many\"",
                "workers is \"many\": invalid digit found in string",
            ),
            ("workers = 300", "workers is \"300\": 300 is not in 1..=256"),
            ("workers = 1.5", "workers is \"1.5\": "),
            (
                "workers = [1]",
                "workers must be a string, a number or a boolean",
            ),
            (
                "log_format = \"xml\"",
                "log_format is \"xml\": must be one of text, json",
            ),
            (
                "listen = \"here\"",
                "listen is \"here\": invalid socket address syntax",
            ),
            (
                "allow_unauthenticated = 7",
                "allow_unauthenticated is \"7\": ",
            ),
        ] {
            let file = format!("# servers\nqueue_limit = 7\n{wrong}\n");
            let error = file_arguments(&file, &command).unwrap_err().to_string();
            assert!(error.starts_with("line 3: "), "{wrong}: {error}");
            assert!(error.contains(said), "{wrong}: {error}");
        }
        let error = file_arguments("workers = \n", &command).unwrap_err();
        assert!(error.to_string().contains("line 1"), "{error}");
    }

    #[test]
    fn an_open_address_and_too_many_threads_are_problems() {
        let config = parse(
            "",
            &[
                "--listen=0.0.0.0:80",
                "--workers=2",
                "--threads-per-worker=4",
            ],
        );
        assert_eq!(config.problems(2).len(), 2);
        assert_eq!(parse("", &["--workers=2"]).worker_threads(8), 4);
    }
}
