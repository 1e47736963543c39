//! Uploads that are refused, and that they leave nothing.

use std::os::unix::fs::PermissionsExt;

use axum::body::{Body, Bytes};
use axum::http::Request;
use futures_util::{StreamExt, stream};
use meshway::http::{App, router};
use serde_json::json;
use tokio_util::sync::CancellationToken;

use crate::http::support::{
    Service, encoded, form_request, gzip, json_request, sphere_xyz, upload_request,
};
use crate::server::PROGRAM;

#[tokio::test]
async fn what_is_no_cloud_is_refused_and_leaves_nothing() {
    let service = Service::with(&["--max-points=1000"]).await;
    let rows = |row: &str| row.repeat(20).into_bytes();
    let row = |i: u32| format!("{} {} 0\n", i % 7, i / 7);
    let plane = (0..40).map(row).collect::<Vec<_>>().concat();
    let ply = "ply\nformat ascii 1.0\nelement vertex 99\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n";
    let cases: Vec<(Vec<u8>, u16, &str)> = vec![
        (vec![], 422, "cloud_empty"),
        (b"0 0 0\n1 0 0\n".to_vec(), 422, "cloud_too_few_points"),
        (rows("1 2 3\n"), 422, "cloud_degenerate"),
        (plane.into_bytes(), 422, "cloud_degenerate"),
        (rows("nan 0 0\n"), 422, "cloud_not_finite"),
        (
            [sphere_xyz(40, 0.0), "1 x 3\n".to_owned()]
                .concat()
                .into_bytes(),
            422,
            "cloud_row",
        ),
        (rows("1e30 2 3\n"), 422, "cloud_too_large"),
        (ply.as_bytes().to_vec(), 422, "cloud_truncated"),
        (
            ply.replace("ascii", "klingon").into_bytes(),
            422,
            "cloud_header",
        ),
        (
            ply.replace(" x\n", " a\n").into_bytes(),
            422,
            "cloud_no_coordinates",
        ),
        (b"PK\x03\x04 a zip file".to_vec(), 415, "unsupported_format"),
        (gzip(b"0 0 0")[..12].to_vec(), 415, "unsupported_encoding"),
        (sphere_xyz(1_001, 0.0).into_bytes(), 413, "too_many_points"),
    ];
    for (body, status, code) in cases {
        service
            .send(upload_request(body))
            .await
            .expect_problem(status, code);
    }
    let row = service
        .send(upload_request(sphere_xyz(40, 0.0) + "1 x 3\n"))
        .await;
    assert!(row.json()["detail"].as_str().unwrap().contains("line 41"));

    service
        .send(encoded("br", vec![1]))
        .await
        .expect_problem(415, "unsupported_encoding");
    service
        .send(encoded("gzip", b"no gzip".to_vec()))
        .await
        .expect_problem(415, "unsupported_encoding");
    let zstd = zstd::encode_all(&sphere_xyz(40, 0.0).into_bytes()[..], 3).unwrap();
    let cut = zstd[..zstd.len() / 2].to_vec();
    service
        .send(encoded("zstd", cut))
        .await
        .expect_problem(415, "unsupported_encoding");
    let json = service.send(json_request("/v1/clouds", &json!({}))).await;
    json.expect_problem(415, "unsupported_format");
    service
        .send(form_request("/v1/clouds", &[]))
        .await
        .expect_problem(400, "malformed_multipart");
    let other = form_request("/v1/clouds", &[("cloud", "", b"1")]);
    service
        .send(other)
        .await
        .expect_problem(400, "malformed_multipart");
    let broken =
        Request::post("/v1/clouds").header("content-type", "multipart/form-data; boundary=XX");
    let broken =
        broken.body("--XX\r\nContent-Disposition: form-data; name=\"file\"\r\n\r\nabc".into());
    service
        .send(broken.unwrap())
        .await
        .expect_problem(400, "malformed_multipart");
    let unknown = Request::post("/v1/clouds?name=x")
        .body(Body::from("1"))
        .unwrap();
    let problem = service
        .send(unknown)
        .await
        .expect_problem(422, "request_invalid");
    assert_eq!(problem["errors"][0]["pointer"], "/name");

    assert!(
        service.files("clouds").is_empty(),
        "{:?}",
        service.files("clouds")
    );
    service
        .until("tmp is empty", |service| service.files("tmp").is_empty())
        .await;
}

#[tokio::test]
async fn a_body_that_breaks_off_is_no_malformed_form() {
    let service = Service::new().await;
    for media_type in ["text/plain", "multipart/form-data; boundary=XX"] {
        let start =
            Bytes::from_static(b"--XX\r\nContent-Disposition: form-data; name=\"file\"\r\n\r\nabc");
        let broken = stream::iter([Ok(start), Err(std::io::Error::other("reset"))]);
        let request = Request::post("/v1/clouds").header("content-type", media_type);
        let request = request.body(Body::from_stream(broken)).unwrap();
        let problem = service
            .send(request)
            .await
            .expect_problem(400, "body_broken_off");
        assert_eq!(problem["retryable"], true);
    }
    service
        .until("tmp is empty", |service| service.files("tmp").is_empty())
        .await;
}

#[tokio::test]
async fn a_header_that_is_too_long_says_how_long_it_may_be() {
    let service = Service::new().await;
    let lines = "comment x\n".repeat(10_000);
    for (header, said) in [
        (lines, "the header has more than 65536 bytes"),
        (
            "x".repeat(2_000),
            "a line of the header has more than 1024 bytes",
        ),
        (
            "comment x\n".to_owned(),
            "the header ends without \"end_header\"",
        ),
    ] {
        let problem = service
            .send(upload_request(format!("ply\n{header}")))
            .await
            .expect_problem(422, "cloud_header");
        let detail = problem["detail"].as_str().unwrap();
        assert!(detail.contains(said), "{detail}");
    }
}

#[tokio::test]
async fn a_body_beyond_the_limit_ends_early() {
    let service = Service::with(&["--body-limit-mib=1"]).await;
    let large = vec![b'1'; (1 << 20) + 1];
    let declared = Request::post("/v1/clouds").header("content-length", large.len());
    let declared = declared.body(Body::from_stream(stream::pending::<
        Result<Bytes, std::io::Error>,
    >()));
    // Its body never comes: the length alone is refused.
    service
        .send(declared.unwrap())
        .await
        .expect_problem(413, "body_too_large");
    let chunks = stream::iter(
        large
            .chunks(1000)
            .map(|chunk| Ok::<_, std::io::Error>(Bytes::copy_from_slice(chunk)))
            .collect::<Vec<_>>(),
    );
    let undeclared = upload_request(Body::from_stream(chunks));
    service
        .send(undeclared)
        .await
        .expect_problem(413, "body_too_large");
    let form = form_request("/v1/clouds", &[("file", "", &large)]);
    service
        .send(form)
        .await
        .expect_problem(413, "body_too_large");
    // A body that packs well but not absurdly: only its decoded size is too much.
    let decoded: Vec<u8> = (0..300_000)
        .flat_map(|i: u32| format!("{}\n", i.wrapping_mul(2_654_435_761)).into_bytes())
        .collect();
    service
        .send(encoded("gzip", gzip(&decoded)))
        .await
        .expect_problem(413, "body_too_large");
    service
        .until("tmp is empty", |service| service.files("tmp").is_empty())
        .await;
}

#[tokio::test]
async fn a_bomb_is_cut_by_its_ratio() {
    let service = Service::new().await;
    let bomb = vec![b'0'; 64 << 20];
    let bombs = [
        ("gzip", gzip(&bomb)),
        ("zstd", zstd::encode_all(&bomb[..], 3).unwrap()),
    ];
    for (encoding, body) in bombs {
        let problem = service
            .send(encoded(encoding, body))
            .await
            .expect_problem(413, "body_too_large");
        assert!(
            problem["detail"].as_str().unwrap().contains("100 times"),
            "{problem}"
        );
    }
}

#[tokio::test]
async fn an_upload_that_stands_still_ends_with_408() {
    let service = Service::with(&["--upload-timeout-seconds=1"]).await;
    let start = stream::iter([Ok::<_, std::io::Error>(Bytes::from_static(b"0 0 0\n"))]);
    let stalls = Body::from_stream(start.chain(stream::pending()));
    service
        .send(upload_request(stalls))
        .await
        .expect_problem(408, "upload_timeout");
    service
        .until("tmp is empty", |service| service.files("tmp").is_empty())
        .await;
}

#[tokio::test]
async fn a_file_that_needs_too_much_memory_is_refused() {
    let service = Service::new().await;
    let file = service.dir.path().join("sphere.xyz");
    let points = sphere_xyz(40_000, 0.0);
    std::fs::write(&file, &points).unwrap();
    let read = |limit: &str| {
        let program = std::process::Command::new(PROGRAM)
            .args(["inspect", "--memory-bytes", limit])
            .arg(&file)
            .output();
        program.unwrap().status
    };
    assert!(read("1000000000").success());
    assert!(!read("4000000").success());

    // What the service makes of a child that dies of it.
    let script = service.dir.path().join("child");
    std::fs::write(&script, "#!/bin/sh\nkill -9 $$\n").unwrap();
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
    let (store, config) = (service.store().clone(), service.app.config.clone());
    let workers = service.workers.subscribe();
    let app = App::new(store, config, workers, CancellationToken::new(), script);
    let service = Service {
        router: router(app.clone()),
        app,
        ..service
    };
    let refused = service.send(upload_request(points)).await;
    let problem = refused.expect_problem(413, "cloud_needs_memory");
    assert!(problem["detail"].as_str().unwrap().contains("memory"));
}
