//! The edge of the service: slow clients, many connections, and what HTTP has besides GET and POST.

use std::net::SocketAddr;
use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use bytes::Bytes;
use futures_util::{StreamExt, stream};
use meshway::jobs::NewCloud;
use meshway::reconstruction::cloud::Format;
use serde_json::json;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::http::support::{Service, upload_request};
use crate::server::{Folder, PATIENCE, Server, until};
use crate::store::support::summary;
use crate::who::us;
use crate::wire::Connection;

async fn connect(address: SocketAddr) -> TcpStream {
    TcpStream::connect(address).await.unwrap()
}

async fn status(server: &Server, path: &str) -> u16 {
    let mut connection = Connection::open(server.address()).await.unwrap();
    let answer = connection.ask(&format!("GET {path}"), "", &[]).await;
    answer.unwrap().status
}

#[tokio::test]
async fn connections_that_wait_make_room() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--max-connections=4"]).await;
    let mut idle = Vec::new();
    for _ in 0..12 {
        idle.push(connect(server.address()).await);
        // Half a head is no request.
        let head = b"GET /livez HTTP/1.1\r\nHost: local";
        idle.last_mut().unwrap().write_all(head).await.unwrap();
    }
    for path in ["/livez", "/v1/jobs", "/v1/limits"] {
        assert_eq!(status(&server, path).await, 200, "{path}");
    }
    // The first of them gave up their places.
    let mut rest = Vec::new();
    drop(idle[0].read_to_end(&mut rest).await);
    assert!(rest.is_empty(), "{rest:?}");
}

#[tokio::test]
async fn probes_are_answered_when_all_connections_are_at_work() {
    let folder = Folder::new().await;
    let flags = ["--max-connections=2", "--max-streams=8"];
    let server = folder.serve(&flags).await;
    let mut streams = Vec::new();
    for _ in 0..2 {
        let mut stream = connect(server.address()).await;
        let head = b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n";
        stream.write_all(head).await.unwrap();
        let mut start = [0; 12];
        stream.read_exact(&mut start).await.unwrap();
        assert_eq!(&start, b"HTTP/1.1 200");
        streams.push(stream);
    }
    assert_eq!(status(&server, "/livez").await, 200);
    assert_eq!(status(&server, "/v1/jobs").await, 429);
    assert_eq!(status(&server, "/livez").await, 200);
}

#[tokio::test]
async fn a_client_has_its_share_of_the_streams() {
    let folder = Folder::new().await;
    let server = folder.serve(&["--max-streams=4"]).await;
    let mut streams = Vec::new();
    for expected in [200, 200, 429] {
        let mut connection = Connection::open(server.address()).await.unwrap();
        connection.send("GET /v1/events", "", &[]).await.unwrap();
        let (status, _) = connection.read_head().await.unwrap();
        assert_eq!(status, expected);
        streams.push(connection);
    }
    // A stream that ends gives its share back.
    streams.remove(0);
    let again = async || {
        let mut connection = Connection::open(server.address()).await.unwrap();
        connection.send("GET /v1/events", "", &[]).await.unwrap();
        connection.read_head().await.unwrap().0
    };
    until("a share is free", PATIENCE, async || {
        (again().await == 200).then_some(())
    })
    .await;
}

#[tokio::test]
async fn who_does_not_read_is_cut_off() {
    const BYTES: u64 = 256 << 20;
    let folder = Folder::new().await;
    let sha256 = "b".repeat(64);
    let file = std::fs::File::create(folder.path().join("clouds").join(&sha256)).unwrap();
    file.set_len(BYTES).unwrap();
    let new = NewCloud {
        sha256,
        bytes: BYTES,
        summary: summary(Format::Xyz, 1),
        keep_ms: None,
    };
    let (cloud, _) = folder.store.by(us()).insert_cloud(new).await.unwrap();
    let server = folder.serve(&["--download-timeout-seconds=1"]).await;
    let mut stream = connect(server.address()).await;
    let head = format!(
        "GET /v1/clouds/{}/content HTTP/1.1\r\nHost: localhost\r\n\r\n",
        cloud.id
    );
    stream.write_all(head.as_bytes()).await.unwrap();
    let mut start = [0; 12];
    stream.read_exact(&mut start).await.unwrap();
    assert_eq!(&start, b"HTTP/1.1 200");
    // What is sent to it then comes back as a reset, which a later write sees.
    until("the server cuts it off", PATIENCE, async || {
        stream.write_all(b"x").await.err()
    })
    .await;
    let mut rest = Vec::new();
    drop(stream.read_to_end(&mut rest).await);
    assert!((rest.len() as u64) < BYTES / 2, "{}", rest.len());
}

#[tokio::test]
async fn an_upload_that_trickles_ends() {
    let service = Service::with(&["--upload-timeout-seconds=1"]).await;
    let bytes = stream::repeat_with(|| Ok::<_, std::io::Error>(Bytes::from_static(b"1")));
    let trickle = bytes.then(async |byte| {
        tokio::time::sleep(Duration::from_millis(200)).await;
        byte
    });
    let answer = service.send(upload_request(Body::from_stream(trickle.take(1_000))));
    answer.await.expect_problem(408, "upload_timeout");
}

fn request(line: &str, headers: &[(&str, &str)]) -> Request<Body> {
    let (method, path) = line.split_once(' ').unwrap();
    let mut request = Request::builder().method(method).uri(path);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    request.body(Body::empty()).unwrap()
}

#[tokio::test]
async fn head_options_and_preconditions_are_those_of_the_rfc() {
    let service = Service::new().await;
    let id = service.upload().await;
    let content = format!("/v1/clouds/{id}/content");
    let head = request(&format!("HEAD {content}"), &[("range", "bytes=0-3")]);
    let head = service.send(head).await.expect(200);
    assert!(head.body.is_empty());
    let etag = head.header("etag").to_owned();
    for (tag, expected) in [(etag.as_str(), 200), ("*", 200), ("\"zzz\"", 412)] {
        let get = request(&format!("GET {content}"), &[("if-match", tag)]);
        service.send(get).await.expect(expected);
    }
    let options = service.send(request("OPTIONS /v1/jobs", &[])).await;
    let options = options.expect(204);
    assert!(options.header("allow").contains("POST"), "{options:?}");
}

#[tokio::test]
async fn text_is_compressed_and_bytes_are_not() {
    let service = Service::new().await;
    let zipped = [("accept-encoding", "gzip")];
    let limits = service.send(request("GET /v1/limits", &zipped)).await;
    assert_eq!(limits.header("content-encoding"), "gzip");
    let mut plain = Vec::new();
    let mut reader = flate2::read::GzDecoder::new(&limits.body[..]);
    std::io::Read::read_to_end(&mut reader, &mut plain).unwrap();
    assert_eq!(plain, service.get("/v1/limits").await.body[..]);
    let id = service.upload().await;
    let content = request(&format!("GET /v1/clouds/{id}/content"), &zipped);
    let content = service.send(content).await.expect(200);
    assert!(!content.headers.contains_key("content-encoding"));
}

#[tokio::test]
async fn pages_of_allowed_origins_may_use_the_service() {
    let dash = "https://dash.example";
    let flag = format!("--allowed-origins={dash}");
    let service = Service::with(&[&flag]).await;
    let asks = [
        ("host", "localhost:8080"),
        ("origin", dash),
        ("access-control-request-method", "POST"),
        ("access-control-request-headers", "content-type"),
    ];
    let preflight = service.send(request("OPTIONS /v1/jobs", &asks)).await;
    assert_eq!(preflight.header("access-control-allow-origin"), dash);
    assert!(
        preflight
            .header("access-control-allow-methods")
            .contains("POST")
    );
    let list = service.send(request("GET /v1/jobs", &asks[..2])).await;
    assert_eq!(list.expect(200).header("access-control-allow-origin"), dash);
    let sent = service.send(request("POST /v1/jobs", &asks[..2])).await;
    assert_ne!(sent.status, 403, "{sent:?}");
    for (origin, service) in [
        ("https://other.example", &service),
        (dash, &Service::new().await),
    ] {
        let asks = [("host", "localhost:8080"), ("origin", origin)];
        let list = service.send(request("GET /v1/jobs", &asks)).await;
        assert!(!list.headers.contains_key("access-control-allow-origin"));
        let sent = service.send(request("POST /v1/jobs", &asks)).await;
        sent.expect_problem(403, "cross_origin_refused");
    }
}

#[tokio::test]
async fn typed_clients_may_send_null_and_repeat_lists() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let nulls = json!({"cloud_id": cloud_id, "preset": null, "settings": null, "labels": null});
    let job = service.post_json("/v1/jobs", &nulls).await.expect(202);
    let id = job.json()["id"].as_str().unwrap().to_owned();
    let path = format!("/v1/jobs/{id}/metrics");
    let repeated = format!("{path}?fields=loss&fields=gradient_norm");
    let repeated = service.get(&repeated).await.expect(200).json();
    let joined = format!("{path}?fields=loss,gradient_norm");
    assert_eq!(repeated, service.get(&joined).await.expect(200).json());
}

#[tokio::test]
async fn metrics_come_as_plain_text_too_and_count_from_zero() {
    let service = Service::new().await;
    service.get("/v1/jobs").await.expect(200);
    let plain = request("GET /metrics", &[("accept", "text/plain")]);
    let plain = service.send(plain).await.expect(200);
    assert!(
        plain
            .header("content-type")
            .starts_with("text/plain; version=0.0.4")
    );
    let text = String::from_utf8(plain.body).unwrap();
    for line in [
        "# TYPE meshway_build_info gauge",
        "# TYPE meshway_http_requests_total counter",
        "# TYPE meshway_jobs gauge",
        "meshway_jobs_finished_total{status=\"failed\",code=\"worker_crashed\"} 0",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}: {text}");
    }
    assert!(
        !text.contains("# EOF") && !text.contains(" info\n"),
        "{text}"
    );
}
