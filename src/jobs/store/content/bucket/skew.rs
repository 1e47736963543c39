//! A machine whose clock is wrong, before an object store that refuses what is signed more than some
//! minutes before or after its own time.
//!
//! Every answer tells the time (`Date`). A request that is refused, and was signed for a time that is
//! far from it, is asked again once with the time of the answer. If that is not refused, further requests are
//! signed so from the start. A date alone changes no signature: it may be that of a proxy in between,
//! whose clock is wrong itself.

use std::sync::Arc;

use async_trait::async_trait;
use hyper::StatusCode;
use hyper::header::DATE;
use object_store::ClientOptions;
use object_store::aws::AwsCredentialProvider;
use object_store::client::{
    HttpClient, HttpConnector, HttpError, HttpErrorKind, HttpRequest, HttpResponse, HttpService,
    ReqwestConnector,
};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc2822;

use super::signature::sign;
use crate::jobs::clock::{self, RemoteClock};

/// Difference of two clocks that is none, in milliseconds: answers tell whole seconds, and take some.
const CLOSE: i64 = 60_000;

/// The time of an object store.
#[derive(Debug, Clone, Default)]
pub(super) struct StoreClock {
    /// What its answers tell.
    told: RemoteClock,
    /// What it takes signatures for.
    signed: RemoteClock,
}

impl StoreClock {
    /// Milliseconds since the epoch, as its last answer told it; that of this machine where they are
    /// close, or there was no answer.
    pub(super) fn now(&self) -> i64 {
        self.told.now()
    }

    /// Whether the clock of this machine is close to it, as far as is known.
    pub(super) fn is_ours(&self) -> bool {
        self.told.ahead() == 0
    }
}

/// Makes clients that sign for the time of the store.
#[derive(Debug)]
pub(super) struct Corrected {
    pub(super) clock: StoreClock,
    pub(super) credentials: AwsCredentialProvider,
}

impl HttpConnector for Corrected {
    fn connect(&self, options: &ClientOptions) -> object_store::Result<HttpClient> {
        let sender = ReqwestConnector::default().connect(options)?;
        Ok(HttpClient::new(Client {
            sender,
            clock: self.clock.clone(),
            credentials: Arc::clone(&self.credentials),
        }))
    }
}

#[derive(Debug)]
struct Client {
    sender: HttpClient,
    clock: StoreClock,
    credentials: AwsCredentialProvider,
}

impl Client {
    async fn sign(&self, request: &mut HttpRequest, at: i64) -> Result<(), HttpError> {
        let credential = self.credentials.get_credential().await;
        let credential =
            credential.map_err(|error| HttpError::new(HttpErrorKind::Unknown, error))?;
        // One that is not signed stays as it is.
        sign(request, &credential, at);
        Ok(())
    }
}

#[async_trait]
impl HttpService for Client {
    async fn call(&self, mut request: HttpRequest) -> Result<HttpResponse, HttpError> {
        let mut again = request.clone();
        let at = self.clock.signed.now();
        if self.clock.signed.ahead() != 0 {
            self.sign(&mut request, at).await?;
        }
        let answer = self.sender.execute(request).await?;
        let Some(told) = date(&answer) else {
            return Ok(answer);
        };
        let ahead = ahead(told);
        self.clock.told.set_ahead(ahead);
        if !is_refused(answer.status()) || (told - at).abs() < CLOSE {
            return Ok(answer);
        }
        self.sign(&mut again, told).await?;
        let answer = self.sender.execute(again).await?;
        if !is_refused(answer.status()) {
            self.clock.signed.set_ahead(ahead);
            tracing::warn!(
                store_ahead_seconds = ahead / 1_000,
                "the clock of this machine is not that of the object store; requests are signed for \
                 the time there"
            );
        }
        Ok(answer)
    }
}

/// Whether it may be for the time that the request was signed for. Some stores say so by another
/// status than S3 does, and an answer to HEAD says nothing more.
fn is_refused(status: StatusCode) -> bool {
    [
        StatusCode::BAD_REQUEST,
        StatusCode::UNAUTHORIZED,
        StatusCode::FORBIDDEN,
    ]
    .contains(&status)
}

/// When an answer was made, in milliseconds since the epoch.
fn date(answer: &HttpResponse) -> Option<i64> {
    let date = answer.headers().get(DATE)?.to_str().ok()?;
    let date = OffsetDateTime::parse(date, &Rfc2822).ok()?;
    Some(date.unix_timestamp() * 1_000)
}

/// How far a clock is ahead that tells this, in milliseconds; not at all where it is close.
fn ahead(told: i64) -> i64 {
    let ahead = told - clock::now();
    if ahead.abs() < CLOSE { 0 } else { ahead }
}

#[cfg(test)]
mod tests {
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicI64, Ordering};

    use object_store::StaticCredentialProvider;
    use object_store::aws::{AwsAuthorizer, AwsCredential};

    use super::*;
    use crate::jobs::store::content::bucket::signature::tests::signed_at;

    const HOUR: i64 = 3_600_000;

    /// The bytes that a request brought, and how it was answered.
    type Asked = (Option<Vec<u8>>, StatusCode);

    /// Refuses what is signed a quarter of an hour before or after its own time.
    #[derive(Debug, Clone)]
    struct Store {
        /// How far its clock is ahead, and the one whose time its answers tell.
        ahead: Arc<AtomicI64>,
        tells: i64,
        asked: Arc<Mutex<Vec<Asked>>>,
    }

    impl StoreClock {
        /// One that is ahead by so many milliseconds.
        pub(in crate::jobs::store::content::bucket) fn telling(ahead: i64) -> Self {
            let clock = Self::default();
            clock.told.set_ahead(ahead);
            clock
        }
    }

    impl Store {
        fn new(ahead: i64, tells: i64) -> Self {
            let (ahead, asked) = (Arc::new(ahead.into()), Arc::default());
            Self {
                ahead,
                tells,
                asked,
            }
        }

        /// A client of it, and the time that this one goes by.
        fn client(&self) -> (Client, StoreClock) {
            let clock = StoreClock::default();
            let client = Client {
                sender: HttpClient::new(self.clone()),
                clock: clock.clone(),
                credentials: Arc::new(StaticCredentialProvider::new(credential())),
            };
            (client, clock)
        }

        /// What was asked since the last time.
        fn asked(&self) -> Vec<Asked> {
            std::mem::take(&mut *self.asked.lock().unwrap())
        }
    }

    #[async_trait]
    impl HttpService for Store {
        async fn call(&self, request: HttpRequest) -> Result<HttpResponse, HttpError> {
            let now = clock::now();
            let skew = now + self.ahead.load(Ordering::Relaxed) - signed_at(&request);
            let status = if skew.abs() > HOUR / 4 {
                StatusCode::FORBIDDEN
            } else {
                StatusCode::OK
            };
            let body = request.body().as_bytes().map(|body| body.to_vec());
            self.asked.lock().unwrap().push((body, status));
            let date = OffsetDateTime::from_unix_timestamp((now + self.tells) / 1_000).unwrap();
            let date = date.format(&Rfc2822).unwrap().replace("+0000", "GMT");
            let answer = hyper::Response::builder().status(status).header(DATE, date);
            Ok(answer.body(String::new().into()).unwrap())
        }
    }

    fn credential() -> AwsCredential {
        AwsCredential {
            key_id: "key".to_owned(),
            secret_key: "secret".to_owned(),
            token: None,
        }
    }

    /// Sends a request that is signed with the clock of this machine.
    async fn send(client: &Client) -> StatusCode {
        let request = hyper::Request::builder()
            .method("PUT")
            .uri("http://store/b/key");
        let mut request = request.body(vec![1, 2, 3].into()).unwrap();
        let credential = credential();
        let signer = AwsAuthorizer::new(&credential, "s3", "here");
        signer.try_authorize(&mut request, None).unwrap();
        client.call(request).await.unwrap().status()
    }

    /// What was asked: the same bytes each time.
    fn answered(statuses: &[StatusCode]) -> Vec<Asked> {
        let bytes = || Some(vec![1, 2, 3]);
        statuses.iter().map(|status| (bytes(), *status)).collect()
    }

    #[tokio::test]
    async fn with_the_right_clock_each_request_is_sent_once() {
        let store = Store::new(20_000, 20_000);
        let (client, clock) = store.client();
        for _ in 0..2 {
            assert_eq!(send(&client).await, StatusCode::OK);
            assert_eq!(store.asked(), answered(&[StatusCode::OK]));
        }
        assert!((clock.now() - clock::now()).abs() < 1_000);
    }

    #[tokio::test]
    async fn with_a_wrong_clock_only_the_first_request_is_sent_twice() {
        for ahead in [-365 * 24 * HOUR, -HOUR, HOUR, 365 * 24 * HOUR] {
            let store = Store::new(ahead, ahead);
            let (client, clock) = store.client();
            let twice = [StatusCode::FORBIDDEN, StatusCode::OK];
            for statuses in [&twice[..], &twice[1..]] {
                assert_eq!(send(&client).await, StatusCode::OK);
                assert_eq!(store.asked(), answered(statuses));
            }
            assert!((clock.now() - clock::now() - ahead).abs() < 5_000);
        }
    }

    #[tokio::test]
    async fn a_clock_that_is_set_later_is_noticed() {
        let mut store = Store::new(HOUR, HOUR);
        let (mut client, _) = store.client();
        assert_eq!(send(&client).await, StatusCode::OK);
        store.tells = 0;
        store.ahead.store(0, Ordering::Relaxed);
        client.sender = HttpClient::new(store.clone());
        store.asked();
        let twice = [StatusCode::FORBIDDEN, StatusCode::OK];
        for statuses in [&twice[..], &twice[1..]] {
            assert_eq!(send(&client).await, StatusCode::OK);
            assert_eq!(store.asked(), answered(statuses));
        }
        assert_eq!(client.clock.signed.ahead(), 0);
    }

    /// A proxy whose clock is wrong stands before a store that has the right one, or another one.
    #[tokio::test]
    async fn a_date_that_the_store_does_not_sign_for_changes_nothing() {
        let store = Store::new(0, HOUR);
        let (client, _) = store.client();
        assert_eq!(send(&client).await, StatusCode::OK);
        assert_eq!(store.asked(), answered(&[StatusCode::OK]));
        store.ahead.store(-HOUR, Ordering::Relaxed);
        for _ in 0..2 {
            assert_eq!(send(&client).await, StatusCode::FORBIDDEN);
            assert_eq!(store.asked(), answered(&[StatusCode::FORBIDDEN; 2]));
        }
        assert_eq!(client.clock.signed.ahead(), 0);
    }
}
