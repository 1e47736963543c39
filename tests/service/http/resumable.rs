//! Uploads that go on after they were cut, in both protocols.

use std::io;

use axum::body::{Body, Bytes};
use axum::http::Request;
use futures_util::stream;
use meshway::http::{App, router};
use meshway::jobs::Workers;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::Value;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use crate::erasure::holds;
use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, sphere_xyz, upload_request};

/// Headers of a part, after its offset.
pub(crate) const TUS: [(&str, &str); 2] = [
    ("tus-resumable", "1.0.0"),
    ("content-type", "application/offset+octet-stream"),
];
pub(crate) const DRAFT: [(&str, &str); 2] = [
    ("upload-complete", "?0"),
    ("content-type", "application/partial-upload"),
];
pub(crate) const LAST: [(&str, &str); 2] = [("upload-complete", "?1"), DRAFT[1]];

pub(crate) fn with(
    method: &str,
    path: &str,
    headers: &[(&str, &str)],
    body: impl Into<Body>,
) -> Request<Body> {
    let request = Request::builder().method(method).uri(path);
    let all = headers.iter();
    let request = all.fold(request, |request, (name, value)| {
        request.header(*name, *value)
    });
    request.body(body.into()).unwrap()
}

pub(crate) fn part(
    path: &str,
    at: usize,
    headers: &[(&str, &str)],
    body: impl Into<Body>,
) -> Request<Body> {
    let mut request = with("PATCH", path, headers, body);
    let at = at.to_string().parse().unwrap();
    request.headers_mut().insert("upload-offset", at);
    request
}

/// A body that breaks off.
fn broken(bytes: &[u8]) -> Body {
    let sent = Ok(Bytes::copy_from_slice(bytes));
    let cut = Err(io::Error::from(io::ErrorKind::ConnectionReset));
    Body::from_stream(stream::iter([sent, cut]))
}

impl Service {
    /// Begins an upload of an unknown length; gives its address.
    pub(crate) async fn begin(&self) -> String {
        let begin = with("POST", "/v1/uploads", &[("upload-complete", "?0")], "");
        let answer = self.send(begin).await;
        expect_contract(&answer, "post", "/v1/uploads");
        answer.expect(201).header("location").to_owned()
    }

    async fn head(&self, path: &str) -> Answer {
        self.send(with("HEAD", path, &[], "")).await
    }

    async fn offset(&self, path: &str) -> usize {
        let answer = self.head(path).await.expect(200);
        assert_eq!(answer.header("cache-control"), "no-store");
        answer.header("upload-offset").parse().unwrap()
    }

    /// The same folder under a server that knows nothing of the last one.
    pub(crate) fn restart(&mut self) {
        let (workers, seen) = watch::channel(Workers::default());
        let (store, config) = (self.store().clone(), self.app.config.clone());
        let program = env!("CARGO_BIN_EXE_meshway").into();
        self.app = App::new(store, config, seen, CancellationToken::new(), program);
        self.router = router(self.app.clone());
        self.workers = workers;
    }
}

/// What is the same in two clouds of the same bytes.
fn bare(mut cloud: Value) -> Value {
    for member in ["id", "links", "created_at"] {
        cloud.as_object_mut().unwrap().remove(member);
    }
    cloud
}

#[tokio::test]
async fn a_cloud_comes_of_the_draft_as_of_a_plain_upload() {
    let service = Service::new().await;
    let bytes = sphere_xyz(100, 0.0);
    let (first, rest) = bytes.split_at(1_001);
    let upload = service.begin().await;
    let answer = service
        .send(part(&upload, 0, &DRAFT, first.to_owned()))
        .await;
    let answer = answer.expect(204);
    assert_eq!(answer.header("upload-offset"), "1001");
    assert_eq!(answer.header("upload-complete"), "?0");
    let wrong = service
        .send(part(&upload, 7, &DRAFT, rest.to_owned()))
        .await;
    assert_eq!(wrong.header("upload-offset"), "1001");
    let problem = wrong.expect_problem(409, "upload_offset");
    assert_eq!(problem["expected-offset"], 1_001);
    let last = service
        .send(part(&upload, 1_001, &LAST, rest.to_owned()))
        .await;
    expect_contract(&last, "patch", "/v1/uploads/{id}");
    let last = last.expect(201);
    assert_eq!(last.header("upload-complete"), "?1");
    let cloud = last.json();
    let plain = service
        .send(upload_request(bytes.clone()))
        .await
        .expect(200);
    assert_eq!(plain.json(), cloud);
    assert_eq!(last.header("location"), plain.header("location"));
    let other = Service::new().await;
    let plain = other.send(upload_request(bytes.clone())).await.expect(201);
    assert_eq!(bare(plain.json()), bare(cloud.clone()));
    // A last answer that was lost is given again; more bytes are not taken.
    let end = bytes.len();
    let again = service.send(part(
        &upload,
        end,
        &[("content-length", "0"), LAST[0], LAST[1]],
        "",
    ));
    assert_eq!(again.await.expect(200).json(), cloud);
    let more = service.send(part(&upload, end, &LAST, "more"));
    more.await.expect_problem(400, "upload_length");
    let shown = service.get(&upload).await.expect(200);
    expect_contract(&shown, "get", "/v1/uploads/{id}");
    assert_eq!(shown.json()["cloud_id"], cloud["id"]);
    assert!(service.files("uploads").is_empty() && service.files("tmp").is_empty());
    // In one request.
    let whole = with(
        "POST",
        "/v1/uploads",
        &[("upload-complete", "?1")],
        sphere_xyz(100, 3.0),
    );
    let whole = service.send(whole).await.expect(201);
    assert_eq!(whole.json()["points"], 100);
    assert!(whole.header("location").starts_with("/v1/clouds/"));
}

#[tokio::test]
async fn a_cloud_comes_of_tus() {
    let service = Service::new().await;
    let offered = service
        .send(with("OPTIONS", "/v1/uploads", &[], ""))
        .await
        .expect(204);
    assert_eq!(offered.header("tus-version"), "1.0.0");
    assert!(
        offered
            .header("tus-extension")
            .contains("creation-with-upload")
    );
    assert_eq!(offered.header("tus-max-size"), (512_u64 << 20).to_string());
    let bytes = sphere_xyz(100, 0.0);
    let length = bytes.len().to_string();
    let begin = [
        TUS[0],
        TUS[1],
        ("upload-length", &length),
        ("upload-metadata", "filename cGF0aWVudC54eXo="),
    ];
    let answer = service
        .send(with("POST", "/v1/uploads", &begin, bytes[..10].to_owned()))
        .await;
    let answer = answer.expect(201);
    assert_eq!(answer.header("upload-offset"), "10");
    assert!(answer.header("upload-expires").ends_with(" GMT"));
    let upload = answer.header("location").to_owned();
    // Nothing of the name is kept.
    assert!(!holds(service.dir.path(), b"patient"));
    let head = service.head(&upload).await.expect(200);
    assert_eq!(head.header("upload-length"), length);
    let last = service
        .send(part(&upload, 10, &TUS, bytes[10..].to_owned()))
        .await
        .expect(204);
    let link = last.header("link");
    let cloud = link.trim_start_matches('<').split('>').next().unwrap();
    service.get(cloud).await.expect(200);
    // Of another version; without a length; longer than it said.
    let old = [("tus-resumable", "0.2.0")];
    let answer = service.send(with("POST", "/v1/uploads", &old, "")).await;
    assert_eq!(answer.header("tus-version"), "1.0.0");
    answer.expect_problem(412, "precondition_failed");
    let bare = service
        .send(with("POST", "/v1/uploads", &[TUS[0]], ""))
        .await;
    bare.expect_problem(400, "bad_header");
    let short = [TUS[0], ("upload-length", "3")];
    let answer = service
        .send(with("POST", "/v1/uploads", &short, ""))
        .await
        .expect(201);
    let short = answer.header("location").to_owned();
    let more = service.send(part(&short, 0, &TUS, "four"));
    more.await.expect_problem(400, "upload_length");
    service.get(&short).await.expect_problem(410, "gone");
}

#[tokio::test]
async fn a_thousand_cuts_lose_no_byte() {
    let mut service = Service::new().await;
    let bytes = sphere_xyz(2_000, 0.0).into_bytes();
    let mut random = ChaCha8Rng::seed_from_u64(15);
    let mut cuts: Vec<usize> = (0..1_000)
        .map(|_| random.random_range(0..bytes.len()))
        .collect();
    cuts.sort_unstable();
    let upload = service.begin().await;
    let mut at = 0;
    for (k, &cut) in cuts.iter().enumerate() {
        let body = broken(&bytes[at..cut]);
        let answer = service
            .send(part(
                &upload,
                at,
                if k % 2 == 0 { &DRAFT } else { &TUS },
                body,
            ))
            .await;
        answer.expect_problem(400, "body_broken_off");
        if k % 50 == 0 {
            service.restart();
        }
        at = service.offset(&upload).await;
        assert_eq!(at, cut);
    }
    let last = service
        .send(part(&upload, at, &LAST, bytes[at..].to_vec()))
        .await;
    let cloud = last.expect(201).json();
    let content = service
        .get(cloud["links"]["content"].as_str().unwrap())
        .await;
    assert_eq!(content.expect(200).body, bytes);
}

#[tokio::test]
async fn what_the_disk_has_and_nobody_was_told_of_does_not_count() {
    let service = Service::new().await;
    let upload = service.begin().await;
    let bytes = sphere_xyz(100, 0.0);
    let first = service
        .send(part(&upload, 0, &DRAFT, bytes[..100].to_owned()))
        .await;
    first.expect(204);
    // As after a loss of power in the midst of writing.
    let id = upload.rsplit('/').next().unwrap();
    let file = service.dir.path().join("uploads").join(id);
    let mut content = std::fs::read(&file).unwrap();
    content.extend_from_slice(b"\0\0\0 not these");
    std::fs::write(&file, content).unwrap();
    assert_eq!(service.offset(&upload).await, 100);
    let last = service
        .send(part(&upload, 100, &LAST, bytes[100..].to_owned()))
        .await;
    let cloud = last.expect(201).json();
    assert_eq!(cloud["bytes"], bytes.len());
    // And where bytes are missing that were told of, it cannot go on.
    let upload = service.begin().await;
    service
        .send(part(&upload, 0, &DRAFT, "some bytes"))
        .await
        .expect(204);
    let id = upload.rsplit('/').next().unwrap();
    std::fs::remove_file(service.dir.path().join("uploads").join(id)).unwrap();
    let answer = service.send(part(&upload, 10, &DRAFT, "more")).await;
    answer.expect_problem(410, "gone");
    service.get(&upload).await.expect_problem(410, "gone");
}

#[tokio::test]
async fn the_newest_request_wins_and_keeps_what_the_older_one_brought() {
    let service = Service::new().await;
    let upload = service.begin().await;
    let (sender, body) = futures_channel();
    let older = tokio::spawn(service.send(part(&upload, 0, &DRAFT, body)));
    sender.send("0 0 1\n").await.unwrap();
    // The older one waits for more, which never comes.
    let at = loop {
        match service.offset(&upload).await {
            0 => tokio::task::yield_now().await,
            at => break at,
        }
        if older.is_finished() {
            break service.offset(&upload).await;
        }
    };
    older.await.unwrap().expect_problem(409, "upload_taken");
    assert!(at == 0 || at == 6, "{at}");
    let goes_on = service.send(part(&upload, at, &DRAFT, "0 1 0\n")).await;
    assert_eq!(
        goes_on.expect(204).header("upload-offset"),
        (at + 6).to_string()
    );
    drop(sender);
}

/// A body that comes as it is sent.
fn futures_channel() -> (tokio::sync::mpsc::Sender<&'static str>, Body) {
    let (sender, receiver) = tokio::sync::mpsc::channel(1);
    let body = stream::unfold(receiver, async |mut receiver| {
        let piece: &'static str = receiver.recv().await?;
        Some((Ok::<_, io::Error>(piece), receiver))
    });
    (sender, Body::from_stream(body))
}
