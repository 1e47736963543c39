//! A service in process, over a temporary folder; its worker is the test, through the store.

use std::future::Future;
use std::io::Write;
use std::time::Duration;

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{HeaderMap, Request, StatusCode};
use clap::Parser;
use meshway::config::Config;
use meshway::http::{App, AppState, router};
use meshway::jobs::{Claim, JobId, Options, Problem, Store, Workers};
use meshway::reconstruction::mesh::{TriangleMesh, write};
use serde_json::{Value, json};
use tempfile::TempDir;
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;
use tower::ServiceExt;

#[derive(Parser)]
struct Flags {
    #[command(flatten)]
    config: Config,
}

pub(crate) struct Service {
    pub(crate) app: AppState,
    pub(crate) router: Router,
    pub(crate) workers: watch::Sender<Workers>,
    pub(crate) dir: TempDir,
}

/// An answer with its whole body.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap()
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        let value = self.headers.get(name);
        value
            .unwrap_or_else(|| panic!("no {name}: {self:?}"))
            .to_str()
            .unwrap()
    }

    /// The status that was expected, or everything that came instead.
    #[track_caller]
    pub(crate) fn expect(self, status: u16) -> Self {
        let body = String::from_utf8_lossy(&self.body);
        assert_eq!(self.status, status, "{:?} {body:.2000}", self.headers);
        self
    }

    /// A problem of this status and code, complete in its form.
    #[track_caller]
    pub(crate) fn expect_problem(self, status: u16, code: &str) -> Value {
        let answer = self.expect(status);
        let problem = answer.json();
        assert_eq!(problem["code"], code, "{problem}");
        assert_eq!(problem["status"], status);
        assert_eq!(problem["type"], format!("urn:meshway:problem:{code}"));
        assert_eq!(answer.header("content-type"), "application/problem+json");
        assert_eq!(problem["request_id"], answer.header("x-request-id"));
        for member in ["title", "detail"] {
            assert!(
                problem[member]
                    .as_str()
                    .is_some_and(|text| !text.is_empty()),
                "{problem}"
            );
        }
        assert!(
            problem["retryable"].is_boolean() && problem["errors"].is_array(),
            "{problem}"
        );
        if matches!(status, 429 | 503) {
            assert!(answer.header("retry-after").parse::<u32>().unwrap() > 0);
        }
        problem
    }
}

impl Service {
    pub(crate) async fn new() -> Self {
        Self::with(&[]).await
    }

    /// With flags of the operator.
    pub(crate) async fn with(flags: &[&str]) -> Self {
        Self::over(flags, Options::default()).await
    }

    pub(crate) async fn over(flags: &[&str], options: Options) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let data_dir = format!("--data-dir={}", dir.path().display());
        // The reserve of the defaults would make the tests depend on the machine's disk.
        let mut all = vec![
            "t",
            &data_dir,
            "--disk-reserve-mib=0",
            "--disk-reserve-percent=0",
        ];
        let replaced: Vec<&str> = flags
            .iter()
            .filter_map(|flag| flag.split('=').next())
            .collect();
        all.retain(|flag| !replaced.contains(&flag.split('=').next().unwrap()));
        all.extend(flags);
        let config = Flags::parse_from(all).config;
        App::make_folders(&config).unwrap();
        let options = Options {
            queue_limit: u64::from(config.queue_limit),
            ..options
        };
        let store = Store::open(dir.path(), options).await.unwrap();
        let (workers, seen) = watch::channel(Workers::default());
        let program = env!("CARGO_BIN_EXE_meshway").into();
        let app = App::new(store, config, seen, CancellationToken::new(), program);
        Self {
            router: router(app.clone()),
            app,
            workers,
            dir,
        }
    }

    pub(crate) fn store(&self) -> &Store {
        &self.app.store
    }

    pub(crate) fn send(&self, request: Request<Body>) -> impl Future<Output = Answer> + use<> {
        let router = self.router.clone();
        async move {
            let response = router.oneshot(request).await.unwrap();
            let (parts, body) = response.into_parts();
            Answer {
                status: parts.status,
                headers: parts.headers,
                body: to_bytes(body, usize::MAX).await.unwrap().to_vec(),
            }
        }
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.send(Request::get(path).body(Body::empty()).unwrap())
            .await
    }

    pub(crate) async fn delete(&self, path: &str) -> Answer {
        self.send(Request::delete(path).body(Body::empty()).unwrap())
            .await
    }

    pub(crate) async fn post_json(&self, path: &str, body: &Value) -> Answer {
        self.send(json_request(path, body)).await
    }

    /// Uploads a small sphere; gives the cloud's id.
    pub(crate) async fn upload(&self) -> String {
        let answer = self.send(upload_request(sphere_xyz(100, 0.0))).await;
        assert!(answer.status.is_success(), "{answer:?}");
        answer.json()["id"].as_str().unwrap().to_owned()
    }

    /// Submits a job for the small sphere; gives its id.
    pub(crate) async fn submit(&self) -> String {
        let cloud_id = self.upload().await;
        let answer = self
            .post_json("/v1/jobs", &json!({ "cloud_id": cloud_id }))
            .await;
        answer.expect(202).json()["id"].as_str().unwrap().to_owned()
    }

    pub(crate) async fn claim(&self) -> Claim {
        self.store()
            .claim("worker-0-1", 60_000)
            .await
            .unwrap()
            .unwrap()
    }

    pub(crate) async fn fail(&self, claim: &Claim, code: &str) {
        self.store()
            .fail(claim, Problem::new(code, "as the test wants it"))
            .await
            .unwrap();
    }

    /// Names of the files in a folder of the data folder.
    pub(crate) fn files(&self, folder: &str) -> Vec<String> {
        let entries = std::fs::read_dir(self.dir.path().join(folder)).unwrap();
        entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect()
    }

    /// Waits until the condition holds; what is dropped is tidied up in the background.
    pub(crate) async fn until(&self, what: &str, holds: impl Fn(&Self) -> bool) {
        for _ in 0..500 {
            if holds(self) {
                return;
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("never came true: {what}");
    }
}

pub(crate) fn json_request(path: &str, body: &Value) -> Request<Body> {
    let request = Request::post(path).header("content-type", "application/json");
    request.body(body.to_string().into()).unwrap()
}

pub(crate) fn upload_request(body: impl Into<Body>) -> Request<Body> {
    Request::post("/v1/clouds").body(body.into()).unwrap()
}

/// Points of a sphere around (shift, 0, 0), by a spiral.
pub(crate) fn sphere(points: usize, shift: f64) -> Vec<[f64; 3]> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..points)
        .map(|i| {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / points as f64;
            let (sin, cos) = (golden * i as f64).sin_cos();
            let r = (1.0 - z * z).sqrt();
            [shift + r * cos, r * sin, z]
        })
        .collect()
}

pub(crate) fn sphere_xyz(points: usize, shift: f64) -> String {
    let line = |[x, y, z]: [f64; 3]| format!("{x} {y} {z}\n");
    sphere(points, shift)
        .into_iter()
        .map(line)
        .collect::<Vec<_>>()
        .concat()
}

/// A form of the given parts: name, further header lines, content.
pub(crate) fn form_request(path: &str, parts: &[(&str, &str, &[u8])]) -> Request<Body> {
    let mut body = Vec::new();
    for (name, headers, content) in parts {
        let head =
            format!("--XX\r\nContent-Disposition: form-data; name=\"{name}\"{headers}\r\n\r\n");
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(content);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(b"--XX--\r\n");
    let request = Request::post(path).header("content-type", "multipart/form-data; boundary=XX");
    request.body(body.into()).unwrap()
}

/// A tetrahedron in the encoding of the store.
pub(crate) fn tetrahedron() -> Vec<u8> {
    let mesh = TriangleMesh {
        vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]],
        distance_to_points: vec![0.5, 0.0, 0.25, 2.0],
        ..TriangleMesh::default()
    };
    let mut bytes = Vec::new();
    write::write(&mesh, write::Format::PlyBinary, &mut bytes).unwrap();
    bytes
}

pub(crate) fn job_id(text: &str) -> JobId {
    text.parse().unwrap()
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub(crate) fn encoded(encoding: &str, body: Vec<u8>) -> Request<Body> {
    let request = Request::post("/v1/clouds").header("content-encoding", encoding);
    request.body(body.into()).unwrap()
}
