//! What an operator may turn: one struct, from flags, environment and a TOML file.
//!
//! A flag wins over the environment (`MESHWAY_…`), that over the file (`--config`), that over the
//! default. There is one declaration of each setting, the field below: keys of the file are turned
//! into the flags of the same name before the command line is read, see [`file_arguments`].

mod backend;
mod database;
mod file;
mod list;
mod problems;
mod quiet;
mod ttl;
mod work;

use std::fmt::Display;
use std::net::{SocketAddr, ToSocketAddrs};
use std::path::PathBuf;

use clap::Args;
use ipnet::IpNet;
use serde::{Deserialize, Serialize};

use crate::identity::Keyring;
use list::list;

pub use backend::{Backend, ObjectsUrl};
pub use database::DatabaseUrl;
pub use file::{FileError, file_arguments};
pub use ttl::Ttl;
pub use work::Work;

const MIB: u64 = 1024 * 1024;

const HOUR_MS: i64 = 60 * 60 * 1_000;

/// Settings of `meshway serve`.
#[derive(Debug, Clone, Serialize, Args)]
pub struct Config {
    /// Address to listen on. Other than loopback needs keys, or --allow-unauthenticated.
    #[arg(long, env = "MESHWAY_LISTEN", default_value = "127.0.0.1:8080",
          value_parser = address)]
    pub listen: SocketAddr,

    /// Folder for the database and the uploaded clouds; made if it is missing. A folder with other
    /// things in it is refused.
    #[arg(long, env = "MESHWAY_DATA_DIR", default_value = "meshway-data")]
    pub data_dir: PathBuf,

    /// What it stands on besides.
    #[command(flatten)]
    #[serde(flatten)]
    pub backend: Backend,

    /// Serve without keys on an address that others can reach.
    #[arg(long, env = "MESHWAY_ALLOW_UNAUTHENTICATED", num_args = 0..=1, require_equals = true,
          default_value_t = false, default_missing_value = "true", action = clap::ArgAction::Set)]
    pub allow_unauthenticated: bool,

    /// Certificate of the service and those that lead to its authority, as PEM: the service speaks
    /// TLS 1.2 and 1.3. Read again when it changes and at SIGHUP.
    #[arg(long, env = "MESHWAY_TLS_CERT")]
    pub tls_cert: Option<PathBuf>,

    /// Private key of the certificate, as PEM.
    #[arg(long, env = "MESHWAY_TLS_KEY")]
    pub tls_key: Option<PathBuf>,

    /// Authorities of clients, as PEM. Who shows no certificate of one of them is refused.
    #[arg(long, env = "MESHWAY_TLS_CLIENT_CA")]
    pub tls_client_ca: Option<PathBuf>,

    /// What is asked of clients with --tls-client-ca.
    #[arg(
        long,
        env = "MESHWAY_TLS_CLIENT_AUTH",
        default_value = "required",
        value_enum
    )]
    pub tls_client_auth: ClientAuth,

    /// Names that the service goes by besides localhost and its addresses, with commas between
    /// them; `*`: all. A request for another host is refused: it may come from a web page.
    #[arg(long, env = "MESHWAY_ALLOWED_HOSTS", default_value = "")]
    pub allowed_hosts: String,

    /// Origins, as in `https://dash.example`, whose pages may use the service, with commas between
    /// them.
    #[arg(long, env = "MESHWAY_ALLOWED_ORIGINS", default_value = "")]
    pub allowed_origins: String,

    /// Networks of proxies that tell where a request comes from (`X-Forwarded-For`), as in `127.0.0.1/32`, with
    /// commas between them. Others are not believed.
    #[arg(long, env = "MESHWAY_TRUSTED_PROXIES", default_value = "", value_parser = list::<IpNet>)]
    pub trusted_proxies: String,

    /// Path below which a proxy offers the service, as in `/meshway`: the addresses in its answers
    /// begin with it, and requests are taken with it and without.
    #[arg(long, env = "MESHWAY_BASE_PATH", default_value = "", value_parser = base_path)]
    pub base_path: String,

    /// Worker processes; 0: none, where those of `meshway worker` do the work.
    #[arg(long, env = "MESHWAY_WORKERS", default_value_t = 1,
          value_parser = clap::value_parser!(u16).range(0..=256))]
    pub workers: u16,

    /// How jobs are worked on.
    #[command(flatten)]
    #[serde(flatten)]
    pub work: Work,

    /// Largest upload in MiB, as sent and after decompression.
    #[arg(long, env = "MESHWAY_BODY_LIMIT_MIB", default_value_t = 512,
          value_parser = clap::value_parser!(u64).range(1..=65_536))]
    pub body_limit_mib: u64,

    /// Hours that an upload which was cut is kept without further bytes (`/v1/uploads`).
    #[arg(long, env = "MESHWAY_UPLOAD_KEEP_HOURS", default_value_t = 24,
          value_parser = clap::value_parser!(u16).range(1..=720))]
    pub upload_keep_hours: u16,

    /// How long clouds are kept after their upload, as in 30d or 12h; without it, until somebody
    /// erases them. A client may ask for another time (`ttl`).
    #[arg(long, env = "MESHWAY_CLOUD_TTL")]
    pub cloud_ttl: Option<Ttl>,

    /// How long jobs are kept after their end, with meshes, networks and curves, as in 30d or 12h;
    /// without it, until somebody erases them. A client may ask for another time (`ttl`).
    #[arg(long, env = "MESHWAY_JOB_TTL")]
    pub job_ttl: Option<Ttl>,

    /// Most points of a cloud.
    #[arg(long, env = "MESHWAY_MAX_POINTS", default_value_t = 5_000_000,
          value_parser = clap::value_parser!(u64).range(16..))]
    pub max_points: u64,

    /// Most jobs that wait; more get 503.
    #[arg(long, env = "MESHWAY_QUEUE_LIMIT", default_value_t = 1_000)]
    pub queue_limit: u32,

    /// Free space in MiB below which new work is refused with 507.
    #[arg(long, env = "MESHWAY_DISK_RESERVE_MIB", default_value_t = 1_024)]
    pub disk_reserve_mib: u64,

    /// Free space in percent of the disk below which new work is refused with 507.
    #[arg(long, env = "MESHWAY_DISK_RESERVE_PERCENT", default_value_t = 5,
          value_parser = clap::value_parser!(u8).range(0..=90))]
    pub disk_reserve_percent: u8,

    /// Most open event streams.
    #[arg(long, env = "MESHWAY_MAX_STREAMS", default_value_t = 1_000)]
    pub max_streams: u32,

    /// Most open event streams of one client; 0: half of all.
    #[arg(long, env = "MESHWAY_MAX_STREAMS_PER_CLIENT", default_value_t = 0)]
    pub max_streams_per_client: u32,

    /// Most open connections. Beyond it the one that waits longest for a request makes room.
    #[arg(long, env = "MESHWAY_MAX_CONNECTIONS", default_value_t = 4_096)]
    pub max_connections: u32,

    /// Seconds in which an upload must bring a KiB for each of them; else it ends with 408.
    #[arg(long, env = "MESHWAY_UPLOAD_TIMEOUT_SECONDS", default_value_t = 30)]
    pub upload_timeout_seconds: u32,

    /// Seconds without a byte that a client takes of its answer, after which it is cut off.
    #[arg(long, env = "MESHWAY_DOWNLOAD_TIMEOUT_SECONDS", default_value_t = 30)]
    pub download_timeout_seconds: u32,

    /// Seconds to wait for the next request's header on a connection.
    #[arg(long, env = "MESHWAY_HEADER_TIMEOUT_SECONDS", default_value_t = 75)]
    pub header_timeout_seconds: u32,

    /// Networks that receivers of webhooks may be in, as in `10.20.0.0/16`, with commas between them.
    /// Other receivers must be on the public internet and use TLS.
    #[arg(long, env = "MESHWAY_WEBHOOK_NETWORKS", default_value = "", value_parser = list::<IpNet>)]
    pub webhook_networks: String,

    /// Ports that receivers of webhooks may have besides 80, 443 and 8000 to 9999, with commas between
    /// them.
    #[arg(long, env = "MESHWAY_WEBHOOK_PORTS", default_value = "", value_parser = list::<u16>)]
    pub webhook_ports: String,

    /// Authorities of receivers of webhooks, as PEM, besides those that the system knows.
    #[arg(long, env = "MESHWAY_WEBHOOK_CA")]
    pub webhook_ca: Option<PathBuf>,

    /// Hours after the end of a job after which what it told (events, series) is packed: it takes a tenth of
    /// the space then, and is shown as before; 0: never.
    #[arg(long, env = "MESHWAY_PACK_AFTER_HOURS", default_value_t = 24)]
    pub pack_after_hours: u32,

    /// Days that rows of the audit trail are kept: six years, as HIPAA asks of such records.
    #[arg(long, env = "MESHWAY_AUDIT_KEEP_DAYS", default_value_t = 2_192,
          value_parser = clap::value_parser!(u32).range(1..=36_500))]
    pub audit_keep_days: u32,

    /// The keys of the file, `[[keys]]`; see [`Keyring`]. They are not printed with the settings.
    #[arg(skip)]
    #[serde(skip)]
    pub keys: Keyring,
}

/// The address that `HOST:PORT` stands for, where the host may be a name.
///
/// # Errors
/// What is wrong with it, in one sentence.
pub fn address(text: &str) -> Result<SocketAddr, String> {
    let (host, port) = text.rsplit_once(':').unwrap_or_default();
    if host.is_empty() || port.parse::<u16>().is_err() {
        return Err("must be HOST:PORT, as in 127.0.0.1:8080 or localhost:8080".to_owned());
    }
    let found = text
        .to_socket_addrs()
        .map_err(|error| format!("{host}: {error}"))?;
    // Of the addresses of a name IPv4 is what other tools try too.
    let mut found: Vec<_> = found.collect();
    found.sort_by_key(SocketAddr::is_ipv6);
    let first = found.first().copied();
    first.ok_or_else(|| format!("{host} has no address"))
}

/// A path without the slash at its end; that of the root is empty.
fn base_path(text: &str) -> Result<String, String> {
    let path = text.trim_end_matches('/');
    let plain = |c: char| c.is_ascii_alphanumeric() || "-._~".contains(c);
    let mut parts = path.split('/').skip(1);
    let named = parts.all(|part| part.chars().all(plain) && !["", ".", ".."].contains(&part));
    if path.is_empty() || (path.starts_with('/') && named) {
        Ok(path.to_owned())
    } else {
        Err("must be a path of letters, digits, - . _ ~, as in /meshway".to_owned())
    }
}

/// What is asked of clients in the handshake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum ClientAuth {
    /// A certificate of a known authority.
    Required,
    /// Such a certificate or none.
    Optional,
}

/// Format of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
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

    /// How long an upload that was cut is kept without further bytes, in milliseconds.
    pub fn upload_keep_ms(&self) -> i64 {
        i64::from(self.upload_keep_hours) * HOUR_MS
    }

    /// The address of a path of ours, as clients see it.
    pub fn address(&self, path: impl Display) -> String {
        format!("{}{path}", self.base_path)
    }

    /// The path of ours that a client means, which may have the base path before it.
    pub fn below_base<'p>(&self, path: &'p str) -> &'p str {
        match path.strip_prefix(&self.base_path) {
            Some("") => "/",
            Some(below) if below.starts_with('/') => below,
            _ => path,
        }
    }

    /// Most open event streams of one client.
    pub fn streams_per_client(&self) -> u32 {
        match self.max_streams_per_client {
            0 => self.max_streams.div_ceil(2),
            most => most,
        }
    }

    /// The settings as a file that `--config` takes.
    ///
    /// # Errors
    /// When a value has no form in TOML.
    pub fn to_toml(&self) -> Result<String, toml::ser::Error> {
        toml::to_string(self)
    }
}

#[cfg(test)]
mod tests;
