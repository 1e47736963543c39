//! What is the same for every request: ids, problems, limits of the service, the socket.

use std::collections::HashSet;
use std::time::Duration;

use axum::body::Body;
use axum::http::Request;
use meshway::http::{operations, serve};
use meshway::identity::Scope;
use meshway::jobs::Options;
use serde_json::json;
use sqlx::ConnectOptions;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};

use crate::http::support::{Service, json_request, sphere_xyz, upload_request};
use crate::server::PATIENCE;

#[tokio::test]
async fn what_is_not_there_is_a_problem_too() {
    let service = Service::new().await;
    service
        .get("/v2/jobs")
        .await
        .expect_problem(404, "not_found");
    service
        .get("/v1/jobs/1")
        .await
        .expect_problem(404, "not_found");
    service
        .get(&format!("/v1/jobs/job_{}", "0".repeat(32)))
        .await
        .expect_problem(404, "not_found");
    service
        .get(&format!("/v1/clouds/cld_{}", "0".repeat(32)))
        .await
        .expect_problem(404, "not_found");
    service
        .get("/v1/jobs/%FF")
        .await
        .expect_problem(404, "not_found");
    let wrong = service
        .send(Request::put("/v1/jobs").body(Body::empty()).unwrap())
        .await;
    let mut allowed: Vec<_> = wrong.header("allow").split(',').collect();
    allowed.sort_unstable();
    assert_eq!(allowed, ["DELETE", "GET", "HEAD", "POST"]);
    wrong.expect_problem(405, "method_not_allowed");
    let head = service
        .send(Request::head("/v2").body(Body::empty()).unwrap())
        .await
        .expect(404);
    assert!(head.body.is_empty());
}

#[tokio::test]
async fn a_request_keeps_its_id_or_gets_one() {
    let service = Service::new().await;
    let request = Request::get("/v2")
        .header("x-request-id", "a-1")
        .body(Body::empty())
        .unwrap();
    let problem = service.send(request).await.expect_problem(404, "not_found");
    assert_eq!(problem["request_id"], "a-1");
    for unfit in ["", "a b", &"x".repeat(129)] {
        let request = Request::get("/v1/jobs").header("x-request-id", unfit);
        let answer = service
            .send(request.body(Body::empty()).unwrap())
            .await
            .expect(200);
        assert_eq!(answer.header("x-request-id").len(), 32);
    }
}

#[test]
fn every_operation_is_listed_once() {
    let all = operations();
    let different: HashSet<_> = all.iter().collect();
    assert_eq!(different.len(), all.len());
    assert!(all.contains(&("POST".to_owned(), "/v1/jobs", Some(Scope::Write))));
}

#[tokio::test]
async fn a_full_queue_refuses_work_and_nothing_else() {
    let service = Service::with(&["--queue-limit=1"]).await;
    let id = service.submit().await;
    let cloud_id = service.upload().await;
    let answer = service
        .post_json("/v1/jobs", &json!({ "cloud_id": cloud_id }))
        .await;
    answer.expect_problem(503, "queue_full");
    service.get("/v1/jobs").await.expect(200);
    service
        .post_json(&format!("/v1/jobs/{id}/cancel"), &json!({}))
        .await
        .expect(200);
    service
        .post_json("/v1/jobs", &json!({ "cloud_id": cloud_id }))
        .await
        .expect(202);
}

#[tokio::test]
async fn a_nearly_full_disk_refuses_work_and_nothing_else() {
    // A reserve that no disk has.
    let service = Service::with(&["--disk-reserve-mib=1000000000"]).await;
    let refused = service.send(upload_request(sphere_xyz(60, 0.0))).await;
    assert!(refused.headers.contains_key("retry-after"));
    refused.expect_problem(507, "insufficient_storage");
    let job = json!({"cloud_id": format!("cld_{}", "0".repeat(32))});
    service
        .post_json("/v1/jobs", &job)
        .await
        .expect_problem(507, "insufficient_storage");
    service.get("/v1/clouds").await.expect(200);
    service
        .delete(&format!("/v1/jobs/job_{}", "0".repeat(32)))
        .await
        .expect_problem(404, "not_found");
}

#[tokio::test]
async fn a_service_that_stops_refuses_work_and_ends_waits() {
    let service = Service::new().await;
    let cloud_id = service.upload().await;
    let mut waiting = json_request("/v1/jobs", &json!({ "cloud_id": cloud_id }));
    waiting
        .headers_mut()
        .insert("prefer", "wait=60".parse().unwrap());
    let waiting = tokio::spawn(service.send(waiting));
    while service
        .store()
        .counts()
        .await
        .unwrap()
        .get(meshway::jobs::Status::Queued)
        == 0
    {
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    service.app.shutdown.cancel();
    waiting.await.unwrap().expect(202);
    service
        .post_json("/v1/jobs", &json!({ "cloud_id": cloud_id }))
        .await
        .expect_problem(503, "draining");
    service.get("/v1/jobs").await.expect(200);
}

#[tokio::test]
async fn web_pages_of_others_change_nothing_and_have_no_name_here() {
    let service = Service::with(&["--allowed-hosts=mesh.example"]).await;
    let send = async |method: &str, headers: &[(&str, &str)]| {
        let mut request = Request::builder().method(method).uri("/v1/jobs");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        service.send(request.body(Body::empty()).unwrap()).await
    };
    let rebound = send("GET", &[("host", "evil.example:8080")]).await;
    let problem = rebound.expect_problem(421, "host_not_allowed");
    assert!(
        problem["detail"]
            .as_str()
            .unwrap()
            .contains("--allowed-hosts")
    );
    for headers in [
        [
            ("host", "localhost:8080"),
            ("origin", "http://evil.example"),
        ],
        [("host", "localhost:8080"), ("origin", "null")],
        [("host", "localhost:8080"), ("sec-fetch-site", "cross-site")],
    ] {
        let refused = send("POST", &headers).await;
        refused.expect_problem(403, "cross_origin_refused");
        send("GET", &headers).await.expect(200);
    }
    send("GET", &[("host", "mesh.example")]).await.expect(200);
    let own = [("host", "mesh.example"), ("origin", "https://mesh.example")];
    // Past the guard: an empty body is no cloud.
    let taken = send("POST", &own).await;
    assert!(taken.status == 415 || taken.status == 422, "{taken:?}");
}

#[tokio::test]
async fn a_busy_database_is_told_and_passes() {
    let options = Options {
        // Also the patience with a slow disk, before and after: a busy machine must not look like the other writer.
        busy_timeout: Duration::from_secs(2),
        ..Options::default()
    };
    let service = Service::over(&[], options).await;
    let cloud_id = service.upload().await;
    let path = service.dir.path().join(meshway::jobs::store::DATABASE_FILE);
    let mut other = sqlx::sqlite::SqliteConnectOptions::new()
        .filename(path)
        .connect()
        .await
        .unwrap();
    sqlx::query("BEGIN IMMEDIATE")
        .execute(&mut other)
        .await
        .unwrap();
    let job = json!({ "cloud_id": cloud_id });
    service
        .post_json("/v1/jobs", &job)
        .await
        .expect_problem(503, "database_busy");
    service.get("/v1/jobs").await.expect(200);
    sqlx::query("ROLLBACK").execute(&mut other).await.unwrap();
    service.post_json("/v1/jobs", &job).await.expect(202);
}

/// Serves on a free port until the service is shut down; the address and the end of the serving.
async fn served(service: &Service) -> (String, tokio::task::JoinHandle<()>) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (app, close) = (service.app.clone(), service.app.shutdown.clone());
    (address, tokio::spawn(serve(listener, app, close)))
}

async fn exchange(connection: &mut TcpStream, request: &str) -> String {
    connection.write_all(request.as_bytes()).await.unwrap();
    let mut answer = String::new();
    connection.read_to_string(&mut answer).await.unwrap();
    answer
}

#[tokio::test]
async fn silent_and_halting_clients_are_let_go() {
    let service = Service::with(&["--header-timeout-seconds=1"]).await;
    let (address, _serving) = served(&service).await;
    for start in ["", "GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\n"] {
        let mut connection = TcpStream::connect(&address).await.unwrap();
        // Ends because the other side closes; the test's own patience is far longer.
        let closed = tokio::time::timeout(PATIENCE, exchange(&mut connection, start));
        closed.await.unwrap();
    }
}

#[tokio::test]
async fn an_unknown_parameter_is_refused_everywhere() {
    let service = Service::new().await;
    let id = service.submit().await;
    let cloud = service.get("/v1/clouds").await.json()["items"][0]["links"]["self"].clone();
    let cloud = cloud.as_str().unwrap();
    for path in [
        cloud,
        &format!("{cloud}/content"),
        &format!("/v1/jobs/{id}"),
    ] {
        let answer = service.get(&format!("{path}?x=1")).await;
        let problem = answer.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], "/x");
    }
    for path in [cloud, &format!("/v1/jobs/{id}")] {
        let answer = service.delete(&format!("{path}?x=1")).await;
        answer.expect_problem(422, "request_invalid");
        service.get(path).await.expect(200);
    }
    let cancel = format!("/v1/jobs/{id}/cancel?x=1");
    let answer = service.post_json(&cancel, &json!({})).await;
    answer.expect_problem(422, "request_invalid");
}

#[tokio::test]
async fn a_head_without_end_is_refused() {
    let service = Service::new().await;
    let (address, _serving) = served(&service).await;
    let connection = TcpStream::connect(&address).await.unwrap();
    let (mut reader, mut writer) = connection.into_split();
    let head = format!(
        "GET /livez HTTP/1.1\r\nHost: localhost\r\nA: {}",
        "a".repeat(66_000)
    );
    writer.write_all(head.as_bytes()).await.unwrap();
    let mut answer = vec![0; 12];
    reader.read_exact(&mut answer).await.unwrap();
    assert_eq!(answer, b"HTTP/1.1 431");
}

#[tokio::test]
async fn a_client_that_still_writes_gets_its_refusal() {
    let service = Service::with(&["--body-limit-mib=1"]).await;
    let (address, _serving) = served(&service).await;
    let connection = TcpStream::connect(&address).await.unwrap();
    let (mut reader, mut writer) = connection.into_split();
    let head = "POST /v1/clouds HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n";
    writer.write_all(head.as_bytes()).await.unwrap();
    let chunk = format!("10000\r\n{}\r\n", "1".repeat(0x10000));
    // Four times the limit, all of it written before the answer is looked at.
    for _ in 0..64 {
        writer.write_all(chunk.as_bytes()).await.unwrap();
    }
    writer.write_all(b"0\r\n\r\n").await.unwrap();
    let mut answer = vec![0; 12];
    reader.read_exact(&mut answer).await.unwrap();
    assert_eq!(answer, b"HTTP/1.1 413");
}

#[tokio::test]
async fn a_stop_lets_requests_end_and_closes_the_port() {
    let service = Service::new().await;
    let (address, serving) = served(&service).await;
    let mut connection = TcpStream::connect(&address).await.unwrap();
    let body = sphere_xyz(60, 0.0);
    let (first, rest) = body.split_at(body.len() / 2);
    let head = format!(
        "POST /v1/clouds HTTP/1.1\r\nHost: localhost\r\nContent-Length: {}\r\n\r\n",
        body.len()
    );
    connection
        .write_all((head + first).as_bytes())
        .await
        .unwrap();
    service
        .until("the upload has begun", |service| {
            !service.files("tmp").is_empty()
        })
        .await;
    service.app.shutdown.cancel();
    let answer = exchange(&mut connection, rest).await;
    assert!(answer.starts_with("HTTP/1.1 201"), "{answer}");
    serving.await.unwrap();
    TcpStream::connect(&address).await.unwrap_err();
}

#[tokio::test]
async fn a_connection_beyond_the_limit_takes_the_place_of_one_that_waits() {
    let service = Service::with(&["--max-connections=1"]).await;
    let (address, _serving) = served(&service).await;
    let first = TcpStream::connect(&address).await.unwrap();
    let mut second = TcpStream::connect(&address).await.unwrap();
    let request = "GET /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    let answer = exchange(&mut second, request).await;
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    drop(first);
}
