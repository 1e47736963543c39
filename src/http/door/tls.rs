//! TLS of the listener: the certificate, and how a new one comes in without a restart.

use std::convert::Infallible;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use sha2::{Digest, Sha256};
use thiserror::Error;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::signal::unix::{SignalKind, signal};
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::pem::{self, PemObject};
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};
use tokio_rustls::rustls::server::{VerifierBuilderError, WebPkiClientVerifier};
use tokio_rustls::rustls::version::{TLS12, TLS13};
use tokio_rustls::rustls::{self, RootCertStore, ServerConfig};
use tokio_rustls::{TlsAcceptor, server::TlsStream};

/// Time that a client has for its handshake: several round trips on a bad line.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// Time between two looks at the files: certificates are renewed days before they end.
const LOOK: Duration = Duration::from_secs(5);

/// The files that a listener with TLS needs, all PEM.
#[derive(Debug, Clone)]
pub struct TlsFiles {
    /// The certificate, then those that lead to the authority.
    pub cert: PathBuf,
    /// Its private key.
    pub key: PathBuf,
    /// Authorities of clients; where it is given, a certificate of another one is refused.
    pub client_ca: Option<PathBuf>,
    /// Whether a client without any certificate is let in all the same.
    pub client_optional: bool,
}

/// Why the files are of no use.
#[derive(Debug, Error)]
pub enum TlsError {
    /// A file cannot be read, or is no PEM with what is wanted.
    #[error("{}: {error}; expected {wanted} as PEM", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What should be in it.
        wanted: &'static str,
        /// What is wrong.
        error: pem::Error,
    },
    /// Certificate and key do not go together, or are of a kind that is not known.
    #[error("{} with {}: {error}", cert.display(), key.display())]
    Pair {
        /// The file of the certificate.
        cert: PathBuf,
        /// The file of the key.
        key: PathBuf,
        /// What is wrong.
        error: rustls::Error,
    },
    /// The authorities of clients cannot be used.
    #[error("{}: {error}", path.display())]
    Authorities {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: VerifierBuilderError,
    },
}

/// What handshakes are made with; a new certificate holds for connections that come after it.
#[derive(Debug)]
pub struct Tls {
    files: TlsFiles,
    current: RwLock<Arc<ServerConfig>>,
}

impl Tls {
    /// From its files.
    ///
    /// # Errors
    /// [`TlsError`] for files that cannot be read or do not go together.
    pub fn load(files: TlsFiles) -> Result<Self, TlsError> {
        let current = RwLock::new(Arc::new(files.read()?));
        Ok(Self { files, current })
    }

    /// Reads the files again when one of them changes and at each SIGHUP, as long as it is polled. Files
    /// that are of no use are told of, and the certificate before them stays.
    ///
    /// # Errors
    /// Where signals cannot be heard.
    pub async fn follow(&self) -> io::Result<Infallible> {
        let mut hangups = signal(SignalKind::hangup())?;
        let mut seen = self.files.contents();
        loop {
            let asked = tokio::select! {
                Some(()) = hangups.recv() => true,
                () = tokio::time::sleep(LOOK) => false,
            };
            let now = self.files.contents();
            if !asked && now == seen {
                continue;
            }
            seen = now;
            match self.files.read() {
                Ok(config) => {
                    *self.current.write().unwrap_or_else(PoisonError::into_inner) =
                        Arc::new(config);
                    tracing::info!("the certificate was read again");
                }
                Err(error) => tracing::error!(
                    error.message = %error,
                    "the new certificate is of no use; the one before it stays"
                ),
            }
        }
    }

    /// The handshake of a connection; none if it fails or takes too long.
    pub(super) async fn accept<S>(&self, stream: S) -> Option<TlsStream<S>>
    where
        S: AsyncRead + AsyncWrite + Unpin,
    {
        let current = Arc::clone(&self.current.read().unwrap_or_else(PoisonError::into_inner));
        let handshake = TlsAcceptor::from(current).accept(stream);
        match tokio::time::timeout(HANDSHAKE, handshake).await {
            Ok(Ok(stream)) => Some(stream),
            Ok(Err(error)) => {
                tracing::debug!(error.message = %error, "a handshake failed");
                None
            }
            Err(_) => {
                tracing::debug!("a handshake took too long");
                None
            }
        }
    }
}

impl TlsFiles {
    fn read(&self) -> Result<ServerConfig, TlsError> {
        let chain = certificates(&self.cert)?;
        let key = PrivateKeyDer::from_pem_file(&self.key)
            .map_err(|error| unreadable(&self.key, "a private key", error))?;
        let pair = |error| TlsError::Pair {
            cert: self.cert.clone(),
            key: self.key.clone(),
            error,
        };
        let provider = Arc::new(ring::default_provider());
        let builder = ServerConfig::builder_with_provider(Arc::clone(&provider))
            .with_protocol_versions(&[&TLS13, &TLS12])
            .map_err(pair)?;
        let builder = match &self.client_ca {
            None => builder.with_no_client_auth(),
            Some(path) => {
                let mut roots = RootCertStore::empty();
                roots.add_parsable_certificates(certificates(path)?);
                let verifier =
                    WebPkiClientVerifier::builder_with_provider(Arc::new(roots), provider);
                let verifier = if self.client_optional {
                    verifier.allow_unauthenticated()
                } else {
                    verifier
                };
                builder.with_client_cert_verifier(verifier.build().map_err(|error| {
                    TlsError::Authorities {
                        path: path.clone(),
                        error,
                    }
                })?)
            }
        };
        let mut config = builder.with_single_cert(chain, key).map_err(pair)?;
        config.alpn_protocols = vec![b"http/1.1".to_vec()];
        Ok(config)
    }

    /// What is in each file, as a hash: clocks and copied times cannot deceive it.
    fn contents(&self) -> Vec<Option<[u8; 32]>> {
        let files = [Some(&self.cert), Some(&self.key), self.client_ca.as_ref()];
        let hash = |path: &PathBuf| Some(Sha256::digest(std::fs::read(path).ok()?).into());
        files.into_iter().flatten().map(hash).collect()
    }
}

/// All certificates of a file, of which there is at least one.
fn certificates(path: &Path) -> Result<Vec<CertificateDer<'static>>, TlsError> {
    let read = CertificateDer::pem_file_iter(path).and_then(Iterator::collect);
    let found: Result<Vec<_>, _> = read;
    match found {
        Ok(found) if found.is_empty() => Err(pem::Error::NoItemsFound),
        found => found,
    }
    .map_err(|error| unreadable(path, "a certificate", error))
}

fn unreadable(path: &Path, wanted: &'static str, error: pem::Error) -> TlsError {
    TlsError::File {
        path: path.to_owned(),
        wanted,
        error,
    }
}
