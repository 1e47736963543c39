//! Two tenants on every route of the contract, and keys without the scope that it needs.

use axum::body::Body;
use axum::http::{Request, StatusCode};
use futures_util::StreamExt;
use meshway::http::operations;
use meshway::identity::{Keyring, Scope, Secret};
use meshway::jobs::{Claim, NewMesh, Record, Success};
use serde_json::{Value, json};
use tower::ServiceExt;

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, json_request, sphere_xyz, tetrahedron};
use crate::http::walk::{NOWHERE, filled, request};
use crate::server::{PATIENCE, until};

/// A key of a tenant with some of the scopes.
pub(crate) struct Held {
    pub(crate) secret: Secret,
    pub(crate) block: String,
}

impl Held {
    pub(crate) fn new(tenant: &str, scopes: &[Scope]) -> Self {
        let secret = Secret::generate().unwrap();
        let scopes: Vec<_> = scopes.iter().map(|scope| scope.name()).collect();
        let block = format!(
            "[[keys]]\nname = \"{tenant}-{}\"\ntenant = \"{tenant}\"\nhash = \"{}\"\nscopes = {scopes:?}\n",
            secret.hash().id(),
            secret.hash()
        );
        Self { secret, block }
    }

    pub(crate) fn all(tenant: &str) -> Self {
        Self::new(tenant, &Scope::ALL)
    }
}

/// Gives the service these keys.
pub(crate) fn configure(service: &Service, keys: &[&Held]) {
    let blocks: Vec<_> = keys.iter().map(|key| key.block.as_str()).collect();
    let keyring = Keyring::of_file(&blocks.concat()).unwrap();
    service.app.config.keys.replace(&keyring).unwrap();
}

impl Service {
    pub(crate) async fn ask(&self, key: &Held, mut request: Request<Body>) -> Answer {
        let bearer = format!("Bearer {}", key.secret.reveal());
        let headers = request.headers_mut();
        headers.insert("authorization", bearer.parse().unwrap());
        self.send(request).await
    }

    pub(crate) async fn fetch(&self, key: &Held, path: &str) -> Answer {
        self.ask(key, Request::get(path).body(Body::empty()).unwrap())
            .await
    }

    pub(crate) async fn submit_as(&self, key: &Held, cloud: String, preset: &str) -> Value {
        let path = format!("/v1/jobs?preset={preset}");
        let request = Request::post(path).body(Body::from(cloud)).unwrap();
        self.ask(key, request).await.expect(202).json()
    }
}

/// Ends the job that waits longest with a mesh, a snapshot and a network.
pub(crate) async fn finish(service: &Service) -> Claim {
    let claim = service.claim().await;
    let mesh = || NewMesh::new(4, 4, tetrahedron());
    let store = service.store();
    store.put_snapshot(&claim, 5, mesh()).await.unwrap();
    let success = Success {
        mesh: mesh(),
        report: json!({"verdict": "good", "mesh": {"closed": true}}),
        model: b"no network".to_vec(),
        last: Record::default(),
    };
    store.succeed(&claim, success).await.unwrap();
    claim
}

/// What is the same in each problem of its kind.
fn bare(answer: &Answer) -> Value {
    let mut problem = answer.json();
    problem.as_object_mut().unwrap().remove("request_id");
    problem
}

/// A webhook and a message to it.
async fn told(service: &Service, key: &Held) -> (String, String) {
    let ask = json!({"url": "https://ris.example.org/"});
    let made = service.ask(key, json_request("/v1/webhooks", &ask)).await;
    let hook = made.expect(201).json()["id"].as_str().unwrap().to_owned();
    let test = json_request(&format!("/v1/webhooks/{hook}/test"), &json!({}));
    let message = service.ask(key, test).await.expect(202).json();
    (hook, message["id"].as_str().unwrap().to_owned())
}

#[tokio::test]
async fn what_belongs_to_another_tenant_is_not_there_on_any_route() {
    let service = Service::new().await;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(&service, &[&ours, &theirs]);
    let job = service.submit_as(&ours, sphere_xyz(100, 0.0), "fast").await;
    finish(&service).await;
    let begin = Request::post("/v1/uploads").header("upload-complete", "?0");
    let begun = service.ask(&ours, begin.body(Body::empty()).unwrap()).await;
    let upload = begun.expect(201).header("location").to_owned();
    let upload = upload.rsplit('/').next().unwrap();
    let manifest = json!({"clouds": [job["cloud_id"]], "preset": "fast"});
    let batch = service
        .ask(&ours, json_request("/v1/batches", &manifest))
        .await;
    let batch = batch.expect(202).json()["id"].as_str().unwrap().to_owned();
    let (hook, message) = told(&service, &ours).await;
    let (cloud, job) = (
        job["cloud_id"].as_str().unwrap(),
        job["id"].as_str().unwrap(),
    );
    let ids = [
        ("clouds", cloud),
        ("jobs", job),
        ("uploads", upload),
        ("batches", &batch),
        ("webhooks", &hook),
        ("deliveries", &message),
    ];
    let mut walked = 0;
    for (method, path, _) in operations()
        .iter()
        .filter(|(_, path, _)| path.contains("{id}"))
    {
        let foreign = request(method, &filled(path, &ids));
        let foreign = service.ask(&theirs, foreign).await;
        assert_eq!(
            foreign.status,
            StatusCode::NOT_FOUND,
            "{method} {path}: {foreign:?}"
        );
        let missing = request(method, &filled(path, &NOWHERE));
        let missing = service.ask(&theirs, missing).await;
        assert_eq!(bare(&foreign), bare(&missing), "{method} {path}");
        walked += 1;
    }
    assert!(walked >= 25, "{walked} routes: were they renamed?");
    // It is all still there, for whom it belongs to.
    for path in [
        "/v1/jobs/{id}",
        "/v1/jobs/{id}/mesh.{format}",
        "/v1/clouds/{id}/content",
        "/v1/uploads/{id}",
        "/v1/batches/{id}",
        "/v1/webhooks/{id}",
        "/v1/deliveries/{id}",
    ] {
        let path = filled(path, &ids);
        service.fetch(&ours, &path).await.expect(200);
    }
    // Nor can it be named.
    let named = json!({"cloud_id": cloud}).to_string();
    let named = Request::post("/v1/jobs")
        .header("content-type", "application/json")
        .body(named.into());
    let named = service.ask(&theirs, named.unwrap()).await;
    named.expect_problem(422, "cloud_missing");
    let named = service.ask(&theirs, json_request("/v1/batches", &manifest));
    named.await.expect_problem(422, "cloud_missing");
    for list in [
        "/v1/clouds",
        "/v1/jobs",
        "/v1/batches",
        "/v1/webhooks",
        "/v1/events",
        &format!("/v1/jobs?cloud_id={cloud}"),
        &format!("/v1/jobs?batch_id={batch}"),
    ] {
        let list = Request::get(list).header("accept", "application/json");
        let answer = service
            .ask(&theirs, list.body(Body::empty()).unwrap())
            .await;
        assert_eq!(answer.expect(200).json()["items"], json!([]));
    }
    // An erased one was never here, for the others.
    for (path, status) in [
        (format!("/v1/batches/{batch}"), 200),
        (format!("/v1/jobs/{job}"), 204),
        (format!("/v1/clouds/{cloud}"), 204),
        (format!("/v1/uploads/{upload}"), 204),
    ] {
        let erase = Request::delete(&path).body(Body::empty()).unwrap();
        service.ask(&ours, erase).await.expect(status);
        service
            .fetch(&ours, &path)
            .await
            .expect_problem(410, "gone");
        service
            .fetch(&theirs, &path)
            .await
            .expect_problem(404, "not_found");
    }
}

#[tokio::test]
async fn each_route_asks_for_its_scope_and_for_nothing_else() {
    let service = Service::new().await;
    let with = Scope::ALL.map(|scope| Held::new("radiology", &[scope]));
    let without = Scope::ALL.map(|scope| {
        let rest: Vec<_> = Scope::ALL
            .into_iter()
            .filter(|other| *other != scope)
            .collect();
        Held::new("radiology", &rest)
    });
    configure(&service, &with.iter().chain(&without).collect::<Vec<_>>());
    for (method, path, scope) in operations() {
        let filled = filled(path, &NOWHERE);
        let nobody = service.send(request(&method, &filled)).await;
        let Some(scope) = scope else {
            assert_ne!(nobody.status, StatusCode::UNAUTHORIZED, "{method} {path}");
            continue;
        };
        let challenge = nobody.header("www-authenticate").to_owned();
        assert_eq!(challenge, "Bearer realm=\"meshway\"", "{method} {path}");
        expect_contract(&nobody, &method.to_lowercase(), path);
        nobody.expect_problem(401, "unauthenticated");
        let lacking = service
            .ask(&without[scope as usize], request(&method, &filled))
            .await;
        let said = format!("error=\"insufficient_scope\", scope=\"{scope}\"");
        let challenge = lacking.header("www-authenticate");
        assert!(challenge.ends_with(&said), "{method} {path}: {challenge}");
        lacking.expect_problem(403, "forbidden");
        let allowed = service
            .ask(&with[scope as usize], request(&method, &filled))
            .await;
        let status = allowed.status.as_u16();
        assert!(
            status != 401 && status != 403,
            "{method} {path}: {allowed:?}"
        );
    }
}

#[tokio::test]
async fn identical_bytes_are_a_cloud_for_each_tenant_and_outlive_the_other_one() {
    let service = Service::new().await;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(&service, &[&ours, &theirs]);
    let upload = || Request::post("/v1/clouds").body(Body::from(sphere_xyz(100, 0.0)));
    let first = service
        .ask(&ours, upload().unwrap())
        .await
        .expect(201)
        .json();
    let second = service
        .ask(&theirs, upload().unwrap())
        .await
        .expect(201)
        .json();
    assert_ne!(first["id"], second["id"]);
    let erase = |cloud: &Value| {
        let path = format!("/v1/clouds/{}", cloud["id"].as_str().unwrap());
        Request::delete(path).body(Body::empty()).unwrap()
    };
    service.ask(&ours, erase(&first)).await.expect(204);
    let content = second["links"]["content"].as_str().unwrap();
    let kept = service.fetch(&theirs, content).await.expect(200);
    assert_eq!(kept.body, sphere_xyz(100, 0.0).into_bytes());
    service.ask(&theirs, erase(&second)).await.expect(204);
    assert!(service.files("clouds").is_empty());
}

#[tokio::test]
async fn an_idempotency_key_is_its_tenants_own() {
    let service = Service::new().await;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(&service, &[&ours, &theirs]);
    let submit = || {
        let request = Request::post("/v1/jobs").header("idempotency-key", "k");
        request.body(Body::from(sphere_xyz(100, 0.0))).unwrap()
    };
    let first = service.ask(&ours, submit()).await.expect(202);
    let other = service.ask(&theirs, submit()).await.expect(202);
    assert!(other.headers.get("idempotency-replayed").is_none());
    assert_ne!(first.json()["id"], other.json()["id"]);
    let again = service.ask(&ours, submit()).await.expect(202);
    assert_eq!(again.header("idempotency-replayed"), "true");
    assert_eq!(again.json()["id"], first.json()["id"]);
}

#[tokio::test]
async fn keys_are_refused_for_their_form_their_end_and_their_place() {
    let service = Service::new().await;
    let good = Held::new("radiology", &[Scope::Read]);
    let mut old = Held::new("radiology", &[Scope::Read]);
    old.block += "expires = 2020-01-01\n";
    let mut far = Held::new("radiology", &[Scope::Read]);
    far.block += "networks = [\"10.0.0.0/8\"]\n";
    configure(&service, &[&good, &old, &far]);
    service.fetch(&good, "/v1/jobs").await.expect(200);
    let unknown = Held::all("radiology");
    for (key, said) in [
        (&old, "expired"),
        (&far, "not known"),
        (&unknown, "not known"),
    ] {
        let answer = service.fetch(key, "/v1/jobs").await;
        let challenge = answer.header("www-authenticate").to_owned();
        assert!(
            challenge.ends_with("error=\"invalid_token\""),
            "{challenge}"
        );
        let problem = answer.expect_problem(401, "unauthenticated");
        assert!(
            problem["detail"].as_str().unwrap().contains(said),
            "{problem}"
        );
    }
    let in_address = format!("/v1/jobs?key={}", good.secret.reveal());
    let problem = service
        .get(&in_address)
        .await
        .expect_problem(400, "key_in_address");
    assert!(!problem.to_string().contains(good.secret.reveal()));
}

#[tokio::test]
async fn a_stream_of_all_events_is_that_of_the_tenant() {
    let service = Service::new().await;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(&service, &[&ours, &theirs]);
    let bearer = format!("Bearer {}", ours.secret.reveal());
    let request = Request::get("/v1/events")
        .header("host", "localhost")
        .header("authorization", bearer);
    let request = request.body(Body::empty()).unwrap();
    let response = service.router.clone().oneshot(request).await.unwrap();
    let mut heard = response.into_body().into_data_stream();
    let other = service
        .submit_as(&theirs, sphere_xyz(100, 1.0), "fast")
        .await;
    let own = service.submit_as(&ours, sphere_xyz(100, 0.0), "fast").await;
    let mut text = String::new();
    while !text.contains("event: job.queued") {
        let chunk = tokio::time::timeout(PATIENCE, heard.next());
        let chunk = chunk.await.unwrap().unwrap().unwrap();
        text += std::str::from_utf8(&chunk).unwrap();
    }
    // The other tenant's came first.
    assert!(text.contains(own["id"].as_str().unwrap()), "{text}");
    assert!(!text.contains(other["id"].as_str().unwrap()), "{text}");
}

#[tokio::test]
async fn lists_of_keys_show_no_hash_and_when_each_was_used() {
    let service = Service::new().await;
    let (ours, theirs) = (Held::all("radiology"), Held::all("surgery"));
    configure(&service, &[&ours, &theirs]);
    service.fetch(&ours, "/v1/jobs").await.expect(200);
    let id = ours.secret.hash().id();
    until("the use is noted", PATIENCE, async || {
        let uses = service.store().key_uses().await.unwrap();
        uses.contains_key(&id).then_some(())
    })
    .await;
    let answer = service.fetch(&ours, "/v1/keys").await.expect(200);
    expect_contract(&answer, "get", "/v1/keys");
    let items = answer.json()["items"].as_array().unwrap().clone();
    assert_eq!(items.len(), 1);
    assert_eq!(items[0]["id"], id);
    assert!(items[0]["last_used_at"].is_string());
    let hash = ours.secret.hash().to_string();
    assert!(!String::from_utf8(answer.body).unwrap().contains(&hash));
}

#[tokio::test]
async fn a_service_without_keys_asks_for_none_and_names_nobody() {
    let service = Service::new().await;
    let job = service.submit().await;
    service.get(&format!("/v1/jobs/{job}")).await.expect(200);
    service.get("/metrics").await.expect(200);
    assert!(service.store().audit_after(0, 10).await.unwrap().is_empty());
}
