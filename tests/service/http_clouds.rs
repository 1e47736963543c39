//! Uploads and what becomes of them.

use std::io::Write;

use axum::body::{Body, Bytes};
use axum::http::Request;
use futures_util::{StreamExt, stream};
use serde_json::json;

use crate::http_support::{
    Service, form_request, json_request, sphere, sphere_xyz, upload_request,
};

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn encoded(encoding: &str, body: Vec<u8>) -> Request<Body> {
    let request = Request::post("/v1/clouds").header("content-encoding", encoding);
    request.body(body.into()).unwrap()
}

#[tokio::test]
async fn a_cloud_is_described_listed_fetched_and_erased() {
    let service = Service::new().await;
    let body = sphere_xyz(100, 5.0) + "nan 0 0\n";
    let answer = service.send(upload_request(body.clone())).await.expect(201);
    let cloud = answer.json();
    let url = cloud["links"]["self"].as_str().unwrap().to_owned();
    assert_eq!(answer.header("location"), url);
    assert_eq!(cloud["format"], "xyz");
    assert_eq!(cloud["bytes"], body.len());
    assert_eq!(cloud["points"], 100);
    assert_eq!(cloud["dropped_non_finite"], 1);
    assert_eq!(
        cloud["labels"],
        json!({"surface": 100, "interior": 0, "exterior": 0})
    );
    // A spiral of 100 points comes to within a fiftieth of the poles and of the equator's ends.
    assert!(
        (cloud["bounds"]["min"][0].as_f64().unwrap() - 4.0).abs() < 0.02,
        "{cloud}"
    );
    assert_eq!(cloud["normals"], false);

    let again = service.send(upload_request(body.clone())).await.expect(200);
    assert_eq!(again.json(), cloud);
    assert_eq!(service.get(&url).await.expect(200).json(), cloud);
    let list = service.get("/v1/clouds").await.expect(200).json();
    assert_eq!(list, json!({"items": [cloud], "next_cursor": null}));

    let content = format!("{url}/content");
    let whole = service.get(&content).await.expect(200);
    assert_eq!(whole.body, body.as_bytes());
    assert_eq!(
        whole.header("etag"),
        format!("\"{}\"", cloud["sha256"].as_str().unwrap())
    );
    let rest = Request::get(&content)
        .header("range", "bytes=10-")
        .header("if-range", whole.header("etag"));
    let rest = service
        .send(rest.body(Body::empty()).unwrap())
        .await
        .expect(206);
    assert_eq!(rest.body, &body.as_bytes()[10..]);
    assert_eq!(
        rest.header("content-range"),
        format!("bytes 10-{}/{}", body.len() - 1, body.len())
    );
    let beyond = Request::get(&content).header("range", "bytes=999999-");
    let beyond = service.send(beyond.body(Body::empty()).unwrap()).await;
    assert_eq!(
        beyond.header("content-range"),
        format!("bytes */{}", body.len())
    );
    beyond.expect_problem(416, "range_not_satisfiable");
    let known = Request::get(&content).header("if-none-match", whole.header("etag"));
    assert!(
        service
            .send(known.body(Body::empty()).unwrap())
            .await
            .expect(304)
            .body
            .is_empty()
    );
    let head = service
        .send(Request::head(&content).body(Body::empty()).unwrap())
        .await
        .expect(200);
    assert_eq!(head.header("content-length"), body.len().to_string());
    assert!(head.body.is_empty());

    service.delete(&url).await.expect(204);
    service.get(&url).await.expect_problem(404, "not_found");
    service.delete(&url).await.expect_problem(404, "not_found");
    assert!(service.files("clouds").is_empty() && service.files("tmp").is_empty());
}

#[tokio::test]
async fn encodings_and_forms_give_the_same_cloud() {
    let service = Service::new().await;
    let body = sphere_xyz(200, 0.0).into_bytes();
    let plain = service
        .send(upload_request(body.clone()))
        .await
        .expect(201)
        .json();
    let file: (&str, &str, &[u8]) = ("file", "; filename=\"Jane Doe.xyz\"", &body);
    for request in [
        encoded("gzip", gzip(&body)),
        encoded("zstd", zstd::encode_all(&body[..], 3).unwrap()),
        encoded("identity", body.clone()),
        form_request("/v1/clouds", &[file]),
    ] {
        assert_eq!(service.send(request).await.expect(200).json(), plain);
    }
    // A gzipped file is content, not encoding: it is kept as it is.
    let packed = gzip(&body);
    let cloud = service
        .send(upload_request(packed.clone()))
        .await
        .expect(201)
        .json();
    assert_eq!(
        (&cloud["gzipped"], &cloud["points"]),
        (&json!(true), &plain["points"])
    );
    let content = service
        .get(cloud["links"]["content"].as_str().unwrap())
        .await
        .expect(200);
    assert_eq!(content.body, packed);
    assert!(!content.header("content-disposition").contains("Jane"));
}

#[tokio::test]
async fn names_and_media_types_settle_what_the_content_leaves_open() {
    let service = Service::new().await;
    // Headless OFF: three counts, which a table would take for a point.
    let points = sphere_xyz(40, 0.0);
    let off = format!("40 0 0\n{points}");
    let form = form_request(
        "/v1/clouds",
        &[("file", "; filename=\"a.off\"", off.as_bytes())],
    );
    let by_name = service.send(form).await.expect(201).json();
    assert_eq!(
        (&by_name["format"], &by_name["points"]),
        (&json!("off"), &json!(40))
    );
}

#[tokio::test]
async fn what_is_no_cloud_is_refused_and_leaves_nothing() {
    let service = Service::with(&["--max-points=1000"]).await;
    let rows = |row: &str| row.repeat(20).into_bytes();
    let plane: String = (0..40)
        .map(|i| format!("{} {} 0\n", i % 7, i / 7))
        .collect();
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

#[tokio::test(flavor = "multi_thread")]
async fn a_hundred_uploads_at_once() {
    let service = Service::new().await;
    let uploads: Vec<_> = (0..100)
        .map(|i| tokio::spawn(service.send(upload_request(sphere_xyz(50, f64::from(i % 50))))))
        .collect();
    let mut created = 0;
    for upload in uploads {
        let answer = upload.await.unwrap();
        assert!(answer.status.is_success(), "{answer:?}");
        created += usize::from(answer.status == 201);
    }
    // Fifty different ones, each sent twice.
    assert_eq!(created, 50);
    assert_eq!(service.files("clouds").len(), 50);
    assert_eq!(
        service.get("/v1/clouds?limit=200").await.json()["items"]
            .as_array()
            .unwrap()
            .len(),
        50
    );
}

#[tokio::test]
async fn a_file_that_may_unpack_to_much_is_read_by_a_child() {
    let service = Service::new().await;
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 70000\nproperty double x\nproperty double y\nproperty double z\nend_header\n".to_vec();
    for coordinate in sphere(70_000, 0.0).into_iter().flatten() {
        ply.extend_from_slice(&coordinate.to_le_bytes());
    }
    let packed = gzip(&ply);
    assert!(
        packed.len() > 1 << 20,
        "too small for a child: {}",
        packed.len()
    );
    let cloud = service
        .send(upload_request(packed.clone()))
        .await
        .expect(201)
        .json();
    assert_eq!(
        (&cloud["points"], &cloud["format"]),
        (&json!(70_000), &json!("ply"))
    );
    let damaged = packed[..packed.len() - 1000].to_vec();
    service
        .send(upload_request(damaged))
        .await
        .expect_problem(415, "unsupported_encoding");
}

#[tokio::test]
async fn a_cloud_that_a_job_needs_stays() {
    let service = Service::new().await;
    let id = service.submit().await;
    let job = service.get(&format!("/v1/jobs/{id}")).await.json();
    let cloud = job["links"]["cloud"].as_str().unwrap();
    service
        .delete(cloud)
        .await
        .expect_problem(409, "cloud_in_use");
    service
        .post_json(&format!("/v1/jobs/{id}/cancel"), &json!({}))
        .await
        .expect(200);
    service.delete(cloud).await.expect(204);
}
