//! How an object store is reached: its address, credentials, limits of time.

use std::env;
use std::fs;
use std::sync::Arc;
use std::time::Duration;

use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey, Checksum};
use object_store::{Certificate, ClientOptions, RetryConfig};
use tokio_rustls::rustls::crypto::ring;

use super::credentials::Credentials;
use super::skew::{Corrected, StoreClock};
use crate::config::ObjectsUrl;

/// Tries of a request after the first one.
const RETRIES: usize = 3;
/// Time after which there is no further try.
const RETRIED_FOR: Duration = Duration::from_secs(20);
/// Longest time of a request, from connecting to the end of the answer: a part of 8 MiB passes a line
/// of 2.2 Mbit/s.
const REQUEST: Duration = Duration::from_secs(30);
/// Longest time until there is a connection.
const CONNECT: Duration = Duration::from_secs(3);

/// What is taken from the environment: who we are, and the region. Where the store is comes from the
/// address alone.
const FROM_ENVIRONMENT: [&str; 14] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_SECRET_ACCESS_KEY",
    "AWS_SESSION_TOKEN",
    "AWS_DEFAULT_REGION",
    "AWS_REGION",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_ROLE_ARN",
    "AWS_ROLE_SESSION_NAME",
    "AWS_ENDPOINT_URL_STS",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_CONTAINER_AUTHORIZATION_TOKEN_FILE",
    "AWS_METADATA_ENDPOINT",
    "AWS_IMDSV1_FALLBACK",
];

/// What may be in a file that the environment names with `_FILE` behind it.
const FROM_FILES: [&str; 3] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_SECRET_ACCESS_KEY",
    "AWS_SESSION_TOKEN",
];

/// A client of the store, and the time there; nothing is sent yet.
///
/// # Errors
/// What is wrong with the address or the environment, in one sentence.
pub(super) fn connect(url: &ObjectsUrl) -> Result<(AmazonS3, StoreClock), String> {
    // The client takes the one of the process. It is there already if another bucket was opened.
    drop(ring::default_provider().install_default());
    let mut options = ClientOptions::new()
        .with_timeout(REQUEST)
        .with_connect_timeout(CONNECT);
    if let Some(ca) = &url.ca {
        let failed = |error: String| format!("ca={}: {error}", ca.display());
        let text = fs::read(ca).map_err(|error| failed(error.to_string()))?;
        let found = Certificate::from_pem_bundle(&text);
        let found = found.map_err(|error| failed(error.to_string()))?;
        if found.is_empty() {
            return Err(failed("there is no certificate in it".to_owned()));
        }
        for certificate in found {
            options = options.with_root_certificate(certificate);
        }
    }
    let mut builder = environment(AmazonS3Builder::new())?
        .with_bucket_name(&url.bucket)
        .with_virtual_hosted_style_request(!url.path_style)
        .with_checksum_algorithm(Checksum::SHA256)
        // Not every store knows it.
        .with_disable_bulk_delete(true)
        .with_retry(RetryConfig {
            max_retries: RETRIES,
            retry_timeout: RETRIED_FOR,
            ..RetryConfig::default()
        });
    if let Some(region) = &url.region {
        builder = builder.with_region(region);
    }
    if let Some(endpoint) = &url.endpoint {
        options = options.with_allow_http(endpoint.scheme() == "http");
        let mut endpoint = endpoint.clone();
        if !url.path_style {
            let host = endpoint.host_str().unwrap_or_default();
            let host = format!("{}.{host}", url.bucket);
            if endpoint.set_host(Some(&host)).is_err() {
                return Err(
                    "style=virtual needs an endpoint with a name, not an address".to_owned(),
                );
            }
        }
        builder = builder.with_endpoint(endpoint.as_str().trim_end_matches('/'));
    }
    let builder = builder.with_client_options(options);
    let clock = StoreClock::default();
    let credentials = Credentials::new(builder.clone(), clock.clone());
    let credentials = Arc::new(credentials.map_err(|error| error.to_string())?);
    let corrected = builder
        .with_credentials(Arc::clone(&credentials) as _)
        .with_http_connector(Corrected {
            clock: clock.clone(),
            credentials,
        });
    let built = corrected.build().map_err(|error| error.to_string())?;
    Ok((built, clock))
}

/// The builder with what the environment says.
#[expect(
    clippy::disallowed_methods,
    reason = "credentials are where every client of such a store looks for them: workers inherit \
              them, and no setting holds them"
)]
fn environment(mut builder: AmazonS3Builder) -> Result<AmazonS3Builder, String> {
    let mut take = |name: &str, value: String| {
        let key: Result<AmazonS3ConfigKey, _> = name.to_ascii_lowercase().parse();
        let key = key.map_err(|error| format!("{name}: {error}"))?;
        builder = std::mem::take(&mut builder).with_config(key, value);
        Ok::<_, String>(())
    };
    for name in FROM_FILES {
        let Ok(file) = env::var(format!("{name}_FILE")) else {
            continue;
        };
        let text = fs::read_to_string(&file);
        let text = text.map_err(|error| format!("{name}_FILE: {file}: {error}"))?;
        take(name, text.trim().to_owned())?;
    }
    // What is set itself wins over what is in a file.
    for name in FROM_ENVIRONMENT {
        if let Some(value) = env::var(name).ok().filter(|value| !value.is_empty()) {
            take(name, value)?;
        }
    }
    Ok(builder)
}

/// Whether the environment says who we are.
pub(super) fn has_credentials() -> bool {
    [
        "AWS_ACCESS_KEY_ID",
        "AWS_ACCESS_KEY_ID_FILE",
        "AWS_WEB_IDENTITY_TOKEN_FILE",
        "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
        "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    ]
    .iter()
    .any(|name| env::var_os(name).is_some_and(|value| !value.is_empty()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_one_that_the_client_knows() {
        for name in FROM_ENVIRONMENT {
            let key: Result<AmazonS3ConfigKey, _> = name.to_ascii_lowercase().parse();
            assert!(key.is_ok(), "{name}");
        }
    }
}
