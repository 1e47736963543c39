//! Event streams: order, resuming, ends, limits.

use axum::body::{Body, BodyDataStream};
use axum::http::Request;
use futures_util::StreamExt;
use meshway::jobs::{NewEvent, Record};
use meshway::reconstruction::Phase;
use serde_json::{Value, json};
use tower::ServiceExt;

use crate::http::contract::{expect_contract, expect_named};
use crate::http::support::Service;
use crate::server::{Folder, PATIENCE, Server};
use crate::store::support::success;
use crate::who::us;
use crate::wire::Connection;

/// One frame of a stream.
#[derive(Debug, Clone, PartialEq)]
struct Frame {
    id: Option<i64>,
    event: String,
    data: Value,
}

/// An open stream, read frame by frame.
struct Reader {
    body: BodyDataStream,
    text: String,
}

impl Reader {
    async fn open(service: &Service, path: &str, last: Option<&str>) -> Self {
        let request = Request::get(path).header("host", "localhost");
        let mut request = request.header("accept", "text/event-stream");
        if let Some(last) = last {
            request = request.header("last-event-id", last);
        }
        let request = request.body(Body::empty()).unwrap();
        let response = service.router.clone().oneshot(request).await.unwrap();
        assert_eq!(response.status(), 200);
        for (name, value) in [
            ("content-type", "text/event-stream"),
            ("cache-control", "no-store"),
            ("x-accel-buffering", "no"),
        ] {
            assert_eq!(response.headers()[name], value);
        }
        let mut reader = Self {
            body: response.into_body().into_data_stream(),
            text: String::new(),
        };
        // At once, and a part of the first frame: a block without data trips some clients.
        reader.read().await.unwrap();
        assert_eq!(reader.text, "retry: 2000\n");
        reader
    }

    /// Reads more; none at the end of the stream.
    async fn read(&mut self) -> Option<()> {
        let chunk = tokio::time::timeout(PATIENCE, self.body.next());
        let chunk = chunk.await.expect("nothing came")?.unwrap();
        self.text.push_str(std::str::from_utf8(&chunk).unwrap());
        Some(())
    }

    /// The next block of lines; none at the end of the stream.
    async fn block(&mut self) -> Option<String> {
        loop {
            if let Some((block, rest)) = self.text.split_once("\n\n") {
                let (block, rest) = (block.to_owned(), rest.to_owned());
                self.text = rest;
                return Some(block);
            }
            self.read().await?;
        }
    }

    async fn frame(&mut self) -> Option<Frame> {
        let block = self.block().await?;
        let field = |name: &str| {
            let mut lines = block.lines();
            lines.find_map(|line| line.strip_prefix(name))
        };
        Some(Frame {
            id: field("id: ").map(|id| id.parse().unwrap()),
            // Every block has one, also the one after a sign of life.
            event: field("event: ").unwrap().to_owned(),
            data: serde_json::from_str(field("data: ").unwrap()).unwrap(),
        })
    }

    async fn rest(&mut self) -> Vec<Frame> {
        let mut frames = Vec::new();
        while let Some(frame) = self.frame().await {
            frames.push(frame);
        }
        frames
    }
}

fn progress(fraction: f64) -> Record {
    Record {
        events: vec![NewEvent::Progress {
            fraction,
            eta_seconds: None,
        }],
        ..Record::default()
    }
}

#[tokio::test]
async fn a_stream_tells_the_whole_life_in_order_and_closes() {
    let service = Service::new().await;
    let id = service.submit().await;
    let path = format!("/v1/jobs/{id}/events");
    let mut stream = Reader::open(&service, &path, None).await;
    assert_eq!(stream.frame().await.unwrap().event, "job.queued");
    let claim = service.claim().await;
    assert_eq!(stream.frame().await.unwrap().event, "job.started");
    let phase = Record {
        phase: Some(Phase::Training),
        events: vec![NewEvent::Phase {
            phase: Phase::Training,
        }],
        ..Record::default()
    };
    service.store().record(&claim, phase).await.unwrap();
    for i in 1..=300 {
        let record = progress(f64::from(i) / 300.0);
        service.store().record(&claim, record).await.unwrap();
    }
    service.store().succeed(&claim, success()).await.unwrap();
    let rest = stream.rest().await;
    let ids: Vec<i64> = rest.iter().map(|frame| frame.id.unwrap()).collect();
    assert_eq!(ids, (3..=304).collect::<Vec<_>>());
    let last = rest.last().unwrap();
    assert_eq!(last.event, "job.succeeded");
    assert_eq!(last.data["links"]["mesh"], format!("/v1/jobs/{id}/mesh"));
    for frame in rest {
        let event = json!({"id": frame.id, "event": frame.event, "data": frame.data});
        expect_named("Event", &event);
    }

    // Joining in the middle gives the rest; coming back after the last one gives nothing.
    let mut stream = Reader::open(&service, &path, Some("300")).await;
    assert_eq!(stream.rest().await.len(), 4);
    let mut stream = Reader::open(&service, &format!("{path}?after=302"), None).await;
    assert_eq!(stream.rest().await.len(), 2);
    service.get(&format!("{path}?after=304")).await.expect(204);
}

#[tokio::test]
async fn an_id_that_is_unknown_is_answered_with_a_reset() {
    let service = Service::new().await;
    let id = service.submit().await;
    for last in ["99", "x", "-1"] {
        let path = format!("/v1/jobs/{id}/events");
        let mut stream = Reader::open(&service, &path, Some(last)).await;
        let reset = stream.frame().await.unwrap();
        assert_eq!((reset.id, reset.event.as_str()), (Some(1), "reset"));
        assert_eq!(reset.data["newest"], 1);
        assert_eq!(reset.data["job"]["status"], "queued");
        expect_named("Job", &reset.data["job"]);
    }
    let mut stream = Reader::open(&service, "/v1/events", Some("99")).await;
    let reset = stream.frame().await.unwrap();
    assert_eq!(reset.data["jobs"]["queued"], 1);

    // A job that has ended has no more to tell: the stream ends, rather than stay open for ever.
    let job = id.parse().unwrap();
    service.store().by(us()).request_cancel(&job).await.unwrap();
    let path = format!("/v1/jobs/{id}/events");
    let mut stream = Reader::open(&service, &path, Some("99")).await;
    let reset = stream.frame().await.unwrap();
    assert_eq!(reset.data["job"]["status"], "cancelled");
    assert!(stream.rest().await.is_empty());
}

#[tokio::test]
async fn one_stream_follows_all_jobs() {
    let service = Service::new().await;
    let first = service.submit().await;
    let mut live = Reader::open(&service, "/v1/events", None).await;
    let mut all = Reader::open(&service, "/v1/events?after=0", None).await;
    let second = service.submit().await;
    assert_eq!(all.frame().await.unwrap().data["job_id"], first);
    let seen = all.frame().await.unwrap();
    assert_eq!(seen.data["job_id"], second);
    assert_eq!(live.frame().await.unwrap(), seen);
    service.app.shutdown.cancel();
    let end = live.rest().await;
    assert_eq!(end.last().unwrap().event, "shutdown");
}

#[tokio::test]
async fn events_come_as_json_pages_too() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    for _ in 0..5 {
        service.store().record(&claim, progress(0.5)).await.unwrap();
    }
    service.fail(&claim, "no_surface").await;
    let mut path = format!("/v1/jobs/{id}/events?limit=3");
    let mut ids = Vec::new();
    loop {
        let request = Request::get(&path).header("accept", "application/json");
        let answer = service.send(request.body(Body::empty()).unwrap()).await;
        expect_contract(&answer, "get", "/v1/jobs/{id}/events");
        let page = answer.json();
        let items = page["items"].as_array().unwrap();
        ids.extend(items.iter().map(|item| item["id"].as_i64().unwrap()));
        let Some(next) = page["next_after"].as_i64() else {
            assert_eq!(items.last().unwrap()["data"]["error"]["code"], "no_surface");
            break;
        };
        assert!(answer.header("link").contains("rel=\"next\""));
        path = format!("/v1/jobs/{id}/events?limit=3&after={next}");
    }
    assert_eq!(ids, (1..=8).collect::<Vec<_>>());
}

#[tokio::test]
async fn a_job_that_is_erased_or_unknown_has_no_stream() {
    let service = Service::new().await;
    let id = service.submit().await;
    let path = format!("/v1/jobs/{id}/events");
    service.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    service.get(&path).await.expect_problem(410, "gone");
    let unknown = format!("/v1/jobs/job_{}/events", "0".repeat(32));
    service.get(&unknown).await.expect_problem(404, "not_found");
    let bad = service.get("/v1/events?after=x").await;
    assert_eq!(
        bad.expect_problem(422, "request_invalid")["errors"][0]["pointer"],
        "/after"
    );
}

#[tokio::test]
async fn the_stream_of_a_job_ends_when_it_is_erased() {
    let service = Service::new().await;
    let id = service.submit().await;
    let other = service.submit().await;
    let events = |id: &str| format!("/v1/jobs/{id}/events");
    let mut stream = Reader::open(&service, &events(&id), None).await;
    let mut stays = Reader::open(&service, &events(&other), None).await;
    for stream in [&mut stream, &mut stays] {
        assert_eq!(stream.frame().await.unwrap().event, "job.queued");
    }
    service.delete(&format!("/v1/jobs/{id}")).await.expect(204);
    // Not even a comment: the silence before one would be 15 seconds.
    assert_eq!(stream.block().await, None);
    service.claim().await;
    assert_eq!(stays.frame().await.unwrap().event, "job.started");
}

#[tokio::test]
async fn a_long_backlog_does_not_hold_the_end_up() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    let record = Record {
        events: vec![progress(0.5).events.remove(0); 500],
        ..Record::default()
    };
    service.store().record(&claim, record).await.unwrap();
    let path = format!("/v1/jobs/{id}/events");
    let mut stream = Reader::open(&service, &path, None).await;
    stream.frame().await.unwrap();
    service.app.shutdown.cancel();
    let rest = stream.rest().await;
    assert!(rest.len() < 300, "{}", rest.len());
    assert_eq!(rest.last().unwrap().event, "shutdown");
}

#[tokio::test]
async fn streams_are_limited_and_give_their_place_back() {
    let service = Service::with(&["--max-streams=2"]).await;
    let first = Reader::open(&service, "/v1/events", None).await;
    let _second = Reader::open(&service, "/v1/events", None).await;
    let refused = service.get("/v1/events").await;
    refused.expect_problem(429, "rate_limited");
    drop(first);
    Reader::open(&service, "/v1/events", None).await;
}

/// Resident memory of a server in bytes.
fn resident_bytes(server: &Server) -> u64 {
    let pid = server.pid().as_raw_nonzero();
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmRSS:"));
    let kib = line.unwrap().split_whitespace().nth(1).unwrap();
    kib.parse::<u64>().unwrap() * 1024
}

#[tokio::test]
async fn five_hundred_streams_all_hear_everything() {
    let service = Service::with(&["--max-streams=500"]).await;
    let id = service.submit().await;
    let path = format!("/v1/jobs/{id}/events");
    let mut streams = Vec::new();
    for _ in 0..500 {
        let mut stream = Reader::open(&service, &path, None).await;
        assert_eq!(stream.frame().await.unwrap().event, "job.queued");
        streams.push(stream);
    }
    let claim = service.claim().await;
    for i in 0..20 {
        let record = progress(f64::from(i) / 20.0);
        service.store().record(&claim, record).await.unwrap();
    }
    service.store().succeed(&claim, success()).await.unwrap();
    for stream in &mut streams {
        assert_eq!(stream.rest().await.len(), 22);
    }
}

#[tokio::test]
async fn five_hundred_streams_take_little_memory() {
    // A server that does nothing else; in this process other tests run meanwhile.
    let folder = Folder::new().await;
    let flags = ["--max-streams=500", "--max-streams-per-client=500"];
    let server = folder.serve(&flags).await;
    let address = server.address();
    let before = resident_bytes(&server);
    let mut streams = Vec::new();
    for _ in 0..500 {
        let mut stream = Connection::open(address).await.unwrap();
        stream.send("GET /v1/events", "", &[]).await.unwrap();
        assert_eq!(stream.read_head().await.unwrap().0, 200);
        streams.push(stream);
    }
    let grown = resident_bytes(&server).saturating_sub(before);
    assert!(grown < 100 << 20, "{} MiB", grown >> 20);
}
