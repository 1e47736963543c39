//! `meshway health`: asks a service whether it lives. For images that have no other HTTP client.

use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use clap::Args;
use tokio_rustls::rustls::client::danger::{
    HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier,
};
use tokio_rustls::rustls::crypto::{
    CryptoProvider, ring, verify_tls12_signature, verify_tls13_signature,
};
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use tokio_rustls::rustls::version::{TLS12, TLS13};
use tokio_rustls::rustls::{
    ClientConfig, ClientConnection, DigitallySignedStruct, Error, SignatureScheme, StreamOwned,
};

use super::Failure;
use crate::config::address;

/// Time for each step: a probe is repeated anyway.
const PATIENCE: Duration = Duration::from_secs(3);

/// Arguments of `meshway health`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Address of the service; one that stands for all addresses is asked on this machine.
    #[arg(long, env = "MESHWAY_LISTEN", default_value = "127.0.0.1:8080", value_parser = address)]
    listen: SocketAddr,

    /// The certificate (PEM) of a service with TLS, as it was given to `serve`: the service has to show this one.
    #[arg(long, env = "MESHWAY_TLS_CERT", value_name = "FILE")]
    tls_cert: Option<PathBuf>,
}

/// Succeeds if the service answers /livez with 200.
pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let mut address = arguments.listen;
    match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => address.set_ip(Ipv4Addr::LOCALHOST.into()),
        IpAddr::V6(ip) if ip.is_unspecified() => address.set_ip(Ipv6Addr::LOCALHOST.into()),
        _ => {}
    }
    match status_line(address, arguments.tls_cert.as_deref()) {
        Ok(line) if line.starts_with("HTTP/1.1 200") => Ok(()),
        Ok(line) => Err(Failure::Output(format!("{address} answered {line}"))),
        Err(error) => Err(Failure::Output(format!("{address}: {error}"))),
    }
}

fn status_line(address: SocketAddr, cert: Option<&Path>) -> io::Result<String> {
    let stream = TcpStream::connect_timeout(&address, PATIENCE)?;
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    match cert {
        Some(cert) => {
            let shown = ServerName::IpAddress(address.ip().into());
            let connection = ClientConnection::new(Arc::new(trusting(cert)?), shown);
            ask(StreamOwned::new(
                connection.map_err(io::Error::other)?,
                stream,
            ))
        }
        None => ask(stream),
    }
}

fn ask(mut stream: impl Read + Write) -> io::Result<String> {
    stream.write_all(b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")?;
    let mut line = String::new();
    BufReader::new(stream.take(1_024)).read_line(&mut line)?;
    Ok(line.trim_end().to_owned())
}

/// A client that trusts the first certificate of a file, and no other.
fn trusting(cert: &Path) -> io::Result<ClientConfig> {
    let of_file = |error| io::Error::other(format!("{}: {error}", cert.display()));
    let only = CertificateDer::from_pem_file(cert).map_err(of_file)?;
    let provider = Arc::new(ring::default_provider());
    let verifier = Only {
        certificate: only,
        provider: Arc::clone(&provider),
    };
    let builder = ClientConfig::builder_with_provider(provider)
        .with_protocol_versions(&[&TLS12, &TLS13])
        .map_err(io::Error::other)?;
    Ok(builder
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(verifier))
        .with_no_client_auth())
}

/// Takes a server for the right one if it shows this certificate and has its key. Names, authorities and dates do not
/// count: a probe asks an address, and whether the service is alive.
#[derive(Debug)]
struct Only {
    certificate: CertificateDer<'static>,
    provider: Arc<CryptoProvider>,
}

impl ServerCertVerifier for Only {
    fn verify_server_cert(
        &self,
        shown: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        if *shown == self.certificate {
            Ok(ServerCertVerified::assertion())
        } else {
            Err(Error::General(
                "the service shows another certificate than that of --tls-cert".to_owned(),
            ))
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        let algorithms = &self.provider.signature_verification_algorithms;
        verify_tls12_signature(message, certificate, signed, algorithms)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        let algorithms = &self.provider.signature_verification_algorithms;
        verify_tls13_signature(message, certificate, signed, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        let algorithms = &self.provider.signature_verification_algorithms;
        algorithms.supported_schemes()
    }
}
