//! Credentials that end, on a machine whose clock is wrong.
//!
//! The client keeps them until their end, by the clock of this machine. One that is behind would go on
//! with what has ended, and one that is ahead ask for new ones with every request.

use std::sync::Arc;
use std::time::{Duration, Instant};

use async_trait::async_trait;
use object_store::CredentialProvider;
use object_store::aws::{AmazonS3Builder, AwsCredential, AwsCredentialProvider};
use tokio::sync::Mutex;

use super::skew::StoreClock;

/// How long they are kept where the clock is wrong: whoever gives them gives new ones five minutes before
/// their end.
const KEPT: Duration = Duration::from_mins(4);

/// The usual ones where the clock is right.
#[derive(Debug)]
pub(super) struct Credentials {
    usual: AwsCredentialProvider,
    clock: StoreClock,
    /// Each client that it builds asks for them anew.
    builder: AmazonS3Builder,
    kept_for: Duration,
    kept: Mutex<Option<(Instant, Arc<AwsCredential>)>>,
}

impl Credentials {
    /// Those of the client that this one builds.
    ///
    /// # Errors
    /// Those of the builder.
    pub(super) fn new(builder: AmazonS3Builder, clock: StoreClock) -> object_store::Result<Self> {
        Ok(Self {
            usual: Arc::clone(builder.clone().build()?.credentials()),
            clock,
            builder,
            kept_for: KEPT,
            kept: Mutex::default(),
        })
    }
}

#[async_trait]
impl CredentialProvider for Credentials {
    type Credential = AwsCredential;

    async fn get_credential(&self) -> object_store::Result<Arc<AwsCredential>> {
        if self.clock.is_ours() {
            return self.usual.get_credential().await;
        }
        let mut kept = self.kept.lock().await;
        if let Some((at, credential)) = &*kept
            && at.elapsed() < self.kept_for
        {
            return Ok(Arc::clone(credential));
        }
        let new = self.builder.clone().build()?;
        let credential = new.credentials().get_credential().await?;
        *kept = Some((Instant::now(), Arc::clone(&credential)));
        Ok(credential)
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader, Write};
    use std::net::TcpListener;
    use std::thread;

    use object_store::aws::AmazonS3ConfigKey;
    use time::OffsetDateTime;
    use time::format_description::well_known::Rfc3339;
    use tokio_rustls::rustls::crypto::ring;

    use super::*;

    const HOUR: i64 = 3_600_000;

    /// Gives credentials that end so many hours from now by our clock; each time others.
    fn giver(hours: i64) -> String {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}/", listener.local_addr().unwrap());
        let end = OffsetDateTime::now_utc() + time::Duration::hours(hours);
        let end = end.format(&Rfc3339).unwrap();
        let serve = move || {
            for (number, client) in listener.incoming().enumerate() {
                let mut client = client.unwrap();
                let lines = BufReader::new(client.try_clone().unwrap()).lines();
                for line in lines {
                    if line.unwrap().is_empty() {
                        break;
                    }
                }
                let body = format!(
                    r#"{{"AccessKeyId":"{number}","SecretAccessKey":"s","Token":"t","Expiration":"{end}"}}"#
                );
                let length = body.len();
                let head = "HTTP/1.1 200 OK\r\nConnection: close\r\nContent-Length:";
                write!(client, "{head} {length}\r\n\r\n{body}").unwrap();
            }
        };
        thread::Builder::new().spawn(serve).unwrap();
        address
    }

    /// Names of the credentials of three requests one after the other.
    async fn used(hours: i64, ahead: i64, kept_for: Duration) -> Vec<String> {
        drop(ring::default_provider().install_default());
        let token = tempfile::NamedTempFile::new().unwrap();
        let file = token.path().to_str().unwrap();
        let builder = AmazonS3Builder::new()
            .with_bucket_name("bucket")
            .with_config(AmazonS3ConfigKey::ContainerCredentialsFullUri, giver(hours))
            .with_config(AmazonS3ConfigKey::ContainerAuthorizationTokenFile, file);
        let clock = StoreClock::telling(ahead);
        let mut credentials = Credentials::new(builder, clock).unwrap();
        credentials.kept_for = kept_for;
        let mut used = Vec::new();
        for _ in 0..3 {
            used.push(credentials.get_credential().await.unwrap().key_id.clone());
        }
        used
    }

    #[tokio::test]
    async fn with_the_right_clock_they_are_used_until_their_end() {
        assert_eq!(used(1, 0, Duration::ZERO).await, ["0", "0", "0"]);
    }

    #[tokio::test]
    async fn a_machine_that_is_ahead_does_not_take_each_for_ended() {
        assert_eq!(used(-1, -2 * HOUR, KEPT).await, ["0", "0", "0"]);
    }

    #[tokio::test]
    async fn a_machine_that_is_behind_does_not_go_on_with_what_has_ended() {
        assert_eq!(used(8, 7 * HOUR, Duration::ZERO).await, ["0", "1", "2"]);
    }
}
