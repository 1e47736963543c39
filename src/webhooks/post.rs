//! One message on its way: name, address, connection, request, answer.

use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, to_bytes};
use futures_util::future::BoxFuture;
use hyper::client::conn::http1;
use hyper::header::{CONNECTION, CONTENT_TYPE, HOST, RETRY_AFTER, USER_AGENT};
use hyper::{Request, Response};
use hyper_util::rt::TokioIo;
use thiserror::Error;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::TcpStream;
use tokio_rustls::TlsConnector;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::version::{TLS12, TLS13};
use tokio_rustls::rustls::{self, ClientConfig, RootCertStore};
use url::{Host, Url};

use super::policy::Policy;
use super::signature::signatures;
use crate::jobs::Due;

/// Time for a whole try.
const PATIENCE: Duration = Duration::from_secs(20);

/// Time to connect to one of several addresses.
const CONNECT: Duration = Duration::from_secs(5);

/// Most bytes of an answer that are read. Nothing is kept of them.
const LONGEST_ANSWER: usize = 64 << 10;

/// Finds the addresses of a name.
pub type Resolve =
    Arc<dyn Fn(String, u16) -> BoxFuture<'static, io::Result<Vec<SocketAddr>>> + Send + Sync>;

/// Why receivers could not be told from impostors.
#[derive(Debug, Error)]
pub enum TrustError {
    /// The file with authorities is of no use.
    #[error("{}: {error}; expected certificates of authorities as PEM", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: pem::Error,
    },
    /// TLS cannot be set up.
    #[error("{0}")]
    Tls(#[from] rustls::Error),
}

/// What the receiver said.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Answer {
    pub(super) status: u16,
    /// Seconds that it asks to wait.
    pub(super) retry_after: Option<u32>,
}

/// Sends messages.
#[derive(Clone)]
pub struct Post {
    policy: Policy,
    resolve: Resolve,
    tls: Arc<ClientConfig>,
}

impl Post {
    /// With the resolver of the system. Authorities of receivers are those of the system and of the file,
    /// if there is one.
    ///
    /// # Errors
    /// [`TrustError`].
    pub fn new(policy: Policy, authorities: Option<&Path>) -> Result<Self, TrustError> {
        let resolve: Resolve = Arc::new(|name, port| {
            Box::pin(async move { Ok(tokio::net::lookup_host((name, port)).await?.collect()) })
        });
        Ok(Self {
            policy,
            resolve,
            tls: trusting(authorities)?,
        })
    }

    /// With another resolver.
    #[must_use]
    pub fn resolving(self, resolve: Resolve) -> Self {
        Self { resolve, ..self }
    }

    /// Sends a message once. `now` is in milliseconds since the epoch.
    pub(super) async fn send(&self, due: &Due, now: i64) -> Result<Answer, String> {
        let late = |_| format!("no answer within {} s", PATIENCE.as_secs());
        tokio::time::timeout(PATIENCE, self.deliver(due, now))
            .await
            .map_err(late)?
    }

    async fn deliver(&self, due: &Due, now: i64) -> Result<Answer, String> {
        // The policy may have changed since the webhook was made.
        let url = self.policy.url(&due.url)?;
        let stream = self.connect(&url).await?;
        let request = request(due, &url, now)?;
        if url.scheme() == "http" {
            return exchange(stream, request).await;
        }
        let name = match url.host() {
            Some(Host::Domain(name)) => ServerName::try_from(name.to_owned()),
            Some(Host::Ipv4(address)) => Ok(ServerName::IpAddress(address.into())),
            Some(Host::Ipv6(address)) => Ok(ServerName::IpAddress(address.into())),
            None => return Err("the address has no host".to_owned()),
        };
        let name = name.map_err(|error| error.to_string())?;
        let stream = TlsConnector::from(Arc::clone(&self.tls))
            .connect(name, stream)
            .await
            .map_err(|error| format!("TLS: {error}"))?;
        exchange(stream, request).await
    }

    /// A connection to an address that was checked.
    async fn connect(&self, url: &Url) -> Result<TcpStream, String> {
        let port = url.port_or_known_default().unwrap_or_default();
        let addresses = match url.host() {
            Some(Host::Ipv4(address)) => vec![SocketAddr::from((address, port))],
            Some(Host::Ipv6(address)) => vec![SocketAddr::from((address, port))],
            Some(Host::Domain(name)) => (self.resolve)(name.to_owned(), port)
                .await
                .map_err(|error| format!("{name}: {error}"))?,
            None => Vec::new(),
        };
        self.policy.check(url, &addresses)?;
        let mut failed = String::new();
        for address in addresses {
            match tokio::time::timeout(CONNECT, TcpStream::connect(address)).await {
                Ok(Ok(stream)) => return Ok(stream),
                Ok(Err(error)) => failed = format!("{address}: {error}"),
                Err(_) => {
                    failed = format!("{address}: no connection within {} s", CONNECT.as_secs());
                }
            }
        }
        Err(failed)
    }
}

/// What is sent. The body is the same in every try: `data` and the time of what it tells of.
fn request(due: &Due, url: &Url, now: i64) -> Result<Request<Body>, String> {
    let told = |error: &dyn std::fmt::Display| error.to_string();
    let delivery = &due.delivery;
    let happened =
        OffsetDateTime::from_unix_timestamp_nanos(i128::from(delivery.created_at) * 1_000_000)
            .map_err(|error| told(&error))?
            .format(&Rfc3339)
            .map_err(|error| told(&error))?;
    let body = serde_json::json!({
        "type": delivery.news.name(),
        "timestamp": happened,
        "data": delivery.data,
    });
    let body = body.to_string();
    let seconds = now.div_euclid(1_000);
    let message = (delivery.id.as_str(), seconds);
    let signed =
        signatures(&due.secrets, message, body.as_bytes()).map_err(|error| told(&error))?;
    let host = match url.port() {
        Some(port) => format!("{}:{port}", url.host_str().unwrap_or_default()),
        None => url.host_str().unwrap_or_default().to_owned(),
    };
    let target = match url.query() {
        Some(query) => format!("{}?{query}", url.path()),
        None => url.path().to_owned(),
    };
    Request::post(target)
        .header(HOST, host)
        .header(CONTENT_TYPE, "application/json")
        .header(USER_AGENT, concat!("meshway/", env!("CARGO_PKG_VERSION")))
        .header(CONNECTION, "close")
        .header("webhook-id", delivery.id.as_str())
        .header("webhook-timestamp", seconds)
        .header("webhook-signature", signed)
        .body(Body::from(body))
        .map_err(|error| told(&error))
}

async fn exchange(
    stream: impl AsyncRead + AsyncWrite + Send + Unpin + 'static,
    request: Request<Body>,
) -> Result<Answer, String> {
    let told = |error: hyper::Error| format!("HTTP: {error}");
    let (mut client, connection) = http1::handshake(TokioIo::new(stream)).await.map_err(told)?;
    // Dropped with the task of this try, and closed by it.
    let talk = async {
        let answer: Response<_> = client.send_request(request).await.map_err(told)?;
        let seconds = answer.headers().get(RETRY_AFTER);
        let said = Answer {
            status: answer.status().as_u16(),
            retry_after: seconds.and_then(|value| value.to_str().ok()?.trim().parse().ok()),
        };
        // Some receivers count a message as taken only when its answer was read.
        drop(to_bytes(Body::new(answer.into_body()), LONGEST_ANSWER).await);
        Ok(said)
    };
    let mut talk = std::pin::pin!(talk);
    let mut connection = std::pin::pin!(connection);
    tokio::select! {
        said = &mut talk => said,
        ended = &mut connection => match ended {
            Ok(()) => talk.await,
            Err(error) => Err(told(error)),
        },
    }
}

/// A client that trusts the authorities of the system, and those of a file.
fn trusting(authorities: Option<&Path>) -> Result<Arc<ClientConfig>, TrustError> {
    let mut roots = RootCertStore::empty();
    let system = rustls_native_certs::load_native_certs();
    for error in &system.errors {
        tracing::warn!(error.message = %error, "authorities of the system are not known to webhooks");
    }
    roots.add_parsable_certificates(system.certs);
    if let Some(path) = authorities {
        let of_file = |error| TrustError::File {
            path: path.to_owned(),
            error,
        };
        let certificates: Result<Vec<_>, _> = CertificateDer::pem_file_iter(path)
            .map_err(of_file)?
            .collect();
        let certificates = certificates.map_err(of_file)?;
        if certificates.is_empty() {
            return Err(of_file(pem::Error::NoItemsFound));
        }
        for certificate in certificates {
            roots.add(certificate)?;
        }
    }
    let config = ClientConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_protocol_versions(&[&TLS12, &TLS13])?
        .with_root_certificates(roots)
        .with_no_client_auth();
    Ok(Arc::new(config))
}
