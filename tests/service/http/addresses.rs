//! A service below a path of a proxy.

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::{NewMesh, Record, Success};
use serde_json::{Value, json};

use crate::http::support::{Service, json_request, tetrahedron};

fn success() -> Success {
    Success {
        mesh: NewMesh::new(4, 4, tetrahedron()),
        report: json!({"closed": true}),
        model: vec![1],
        last: Record::default(),
    }
}

/// All addresses in a document: members `link` and those of `links`.
fn addresses(value: &Value) -> Vec<String> {
    match value {
        Value::Array(items) => items.iter().flat_map(addresses).collect(),
        Value::Object(members) => members
            .iter()
            .flat_map(|(name, member)| match (name.as_str(), member) {
                ("link", Value::String(link)) => vec![link.clone()],
                ("links", Value::Object(links)) => {
                    let links = links.values().filter_map(Value::as_str);
                    links.map(str::to_owned).collect()
                }
                (_, member) => addresses(member),
            })
            .collect(),
        _ => Vec::new(),
    }
}

#[tokio::test]
async fn addresses_begin_with_the_base_path_and_requests_may() {
    let service = Service::with(&["--base-path=/tools/mesh"]).await;
    let cloud = service.upload().await;
    let ask = |key: &str, path: &str| {
        let mut request = json_request(path, &json!({"cloud_id": cloud}));
        let headers = request.headers_mut();
        headers.insert("idempotency-key", key.parse().unwrap());
        service.send(request)
    };
    let first = ask("a", "/tools/mesh/v1/jobs").await.expect(202);
    let job = first.header("location").to_owned();
    let id = first.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(job, format!("/tools/mesh/v1/jobs/{id}"));
    // Without the path it is the same request.
    let again = ask("a", "/v1/jobs").await.expect(202);
    assert_eq!(again.header("idempotency-replayed"), "true");
    assert_eq!(
        (again.header("location"), &again.body),
        (job.as_str(), &first.body)
    );

    let claim = service.claim().await;
    service.store().succeed(&claim, success()).await.unwrap();
    ask("b", "/v1/jobs").await.expect(202);
    for path in [
        "/v1/clouds".to_owned(),
        "/v1/jobs".to_owned(),
        format!("/v1/jobs/{id}"),
        format!("/v1/jobs/{id}/snapshots"),
    ] {
        let below = service.get(&format!("/tools/mesh{path}")).await.expect(200);
        assert_eq!(
            below.body,
            service.get(&path).await.expect(200).body,
            "{path}"
        );
        for address in addresses(&below.json()) {
            assert!(address.starts_with("/tools/mesh/v1/"), "{path}: {address}");
        }
    }
    let page = service.get("/tools/mesh/v1/jobs?limit=1").await.expect(200);
    assert!(
        page.header("link")
            .starts_with("</tools/mesh/v1/jobs?limit=1&")
    );

    let events = service.get(&format!("{job}/events")).await.expect(200);
    let text = String::from_utf8(events.body).unwrap();
    let link = format!("\"mesh\":\"{job}/mesh\"");
    assert!(text.contains(&link) && text.ends_with("\n\n"), "{text}");
    for path in ["/", "/docs", "/openapi.yaml"] {
        let answer = service.get(path).await.expect(200);
        let text = String::from_utf8(answer.body).unwrap();
        assert!(text.contains("/tools/mesh/"), "{path}");
        assert!(!text.contains("href=\"/openapi"), "{path}");
    }
    let mesh = service.get(&format!("{job}/mesh.ply")).await.expect(200);
    assert_eq!(
        mesh.body,
        service.get(&format!("/v1/jobs/{id}/mesh.ply")).await.body
    );
    for path in [
        "/tools/meshes/v1/jobs",
        "/tools",
        "/tools/mesh/tools/mesh/v1/jobs",
    ] {
        service.get(path).await.expect_problem(404, "not_found");
    }
    service.get("/tools/mesh").await.expect(200);
}

#[tokio::test]
async fn json_is_not_sent_again_while_it_is_the_same() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    service.store().succeed(&claim, success()).await.unwrap();
    for path in [
        format!("/v1/jobs/{id}/report"),
        format!("/v1/jobs/{id}/snapshots"),
        format!("/v1/jobs/{id}/gradients"),
        "/v1/jobs".to_owned(),
        "/v1/clouds".to_owned(),
        "/v1/presets".to_owned(),
        "/v1/limits".to_owned(),
        "/v1/version".to_owned(),
    ] {
        let answer = service.get(&path).await.expect(200);
        let tag = answer.header("etag").to_owned();
        assert!(tag.starts_with('"') && tag.len() == 66, "{path}: {tag}");
        assert_eq!(
            answer.header("cache-control"),
            "private, no-cache",
            "{path}"
        );
        let ask = |request: axum::http::request::Builder| {
            service.send(request.body(Body::empty()).unwrap())
        };
        let held = ask(Request::get(&path).header("if-none-match", &tag)).await;
        let held = held.expect(304);
        assert_eq!((held.header("etag"), held.body.len()), (tag.as_str(), 0));
        let head = ask(Request::head(&path)).await.expect(200);
        assert_eq!((head.header("etag"), head.body.len()), (tag.as_str(), 0));
        let other = ask(Request::get(&path).header("if-none-match", "\"a\"")).await;
        assert_eq!(other.expect(200).body, answer.body);
        // In other bytes it is not strongly the same.
        let packed = ask(Request::get(&path).header("accept-encoding", "gzip")).await;
        if packed.headers.contains_key("content-encoding") {
            assert_eq!(packed.header("etag"), format!("W/{tag}"), "{path}");
        }
    }
    // What changes while one looks has no version.
    for path in ["/readyz", "/livez"] {
        let answer = service.get(path).await;
        assert!(!answer.headers.contains_key("etag"), "{path}");
        assert_eq!(answer.header("cache-control"), "no-store");
    }
}

#[tokio::test]
async fn folders_that_somebody_removed_are_made_again() {
    let service = Service::new().await;
    let id = service.submit().await;
    let claim = service.claim().await;
    service.store().succeed(&claim, success()).await.unwrap();
    let mesh = format!("/v1/jobs/{id}/mesh.obj");
    let before = service.get(&mesh).await.expect(200);
    for folder in ["cache", "tmp", "clouds"] {
        std::fs::remove_dir_all(service.dir.path().join(folder)).unwrap();
    }
    assert_eq!(service.get(&mesh).await.expect(200).body, before.body);
    let list = service.get("/v1/clouds").await.json();
    let cloud = list["items"][0]["id"].as_str().unwrap().to_owned();
    let content = format!("/v1/clouds/{cloud}/content");
    let lost = service.get(&content).await.expect_problem(404, "not_found");
    assert!(
        lost["detail"]
            .as_str()
            .unwrap()
            .contains("not where they were put")
    );
    // Sent again, the same cloud has its bytes again.
    assert_eq!(service.upload().await, cloud);
    service.get(&content).await.expect(200);
}

#[tokio::test]
async fn bodies_that_are_no_cloud_are_told_what_was_meant() {
    let service = Service::new().await;
    let send = async |path: &str, kind: &str, body: &str| {
        let request = Request::post(path).header("content-type", kind);
        let answer = service.send(request.body(body.to_owned().into()).unwrap());
        answer.await
    };
    let fields = "application/x-www-form-urlencoded";
    let bytes = "application/octet-stream";
    for (path, kind, body, status, code, told) in [
        (
            "/v1/jobs",
            fields,
            " {\"a\": 1}",
            415,
            "unsupported_format",
            "Content-Type: application/json",
        ),
        (
            "/v1/clouds",
            bytes,
            "{}",
            415,
            "unsupported_format",
            "Content-Type: application/json",
        ),
        (
            "/v1/clouds",
            fields,
            "1 2 3 4 5 6",
            422,
            "cloud_too_few_points",
            "--data-binary",
        ),
        (
            "/v1/clouds",
            bytes,
            "",
            422,
            "cloud_empty",
            "the body is empty",
        ),
        (
            "/v1/jobs",
            bytes,
            "",
            422,
            "cloud_empty",
            "the body is empty",
        ),
        (
            "/v1/jobs",
            "application/json",
            " ",
            400,
            "malformed_json",
            "is empty",
        ),
    ] {
        let problem = send(path, kind, body).await.expect_problem(status, code);
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(told), "{path} {kind} {body}: {detail}");
    }
}
