//! Uploads and what becomes of them.

use axum::body::Body;
use axum::http::Request;
use serde_json::json;

use crate::http::contract::expect_contract;
use crate::http::support::{
    Service, encoded, form_request, gzip, sphere, sphere_xyz, upload_request,
};

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
    for gone in [
        service.get(&url).await,
        service.get(&content).await,
        service.delete(&url).await,
    ] {
        expect_contract(&gone, "get", "/v1/clouds/{id}");
        let problem = gone.expect_problem(410, "gone");
        assert_eq!(problem["reason"], "deleted");
    }
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
    let job = service.get(&format!("/v1/jobs/{id}")).await.json();
    assert!(job["links"].get("cloud").is_none(), "{job}");
    service
        .post_json(&format!("/v1/jobs/{id}/retry"), &json!({}))
        .await
        .expect_problem(422, "cloud_missing");
}

#[tokio::test]
async fn normals_that_cannot_be_used_as_they_are_are_counted() {
    let service = Service::new().await;
    let warnings = async |normal: fn(usize) -> &'static str| {
        let rows = sphere(100, 0.0).into_iter().enumerate();
        let row = |(i, [x, y, z]): (usize, [f64; 3])| format!("{x} {y} {z} {}\n", normal(i));
        let table = "x y z nx ny nz\n".to_owned() + &rows.map(row).collect::<String>();
        let answer = service.send(upload_request(table)).await.expect(201);
        expect_contract(&answer, "post", "/v1/clouds");
        answer.json()["warnings"].clone()
    };
    let zero = "normals are zero and count as missing";
    assert_eq!(
        warnings(|_| "0 0 0").await,
        json!([{"code": "normals_zero", "message": format!("100 of 100 {zero}")}])
    );
    assert_eq!(
        warnings(|i| ["0 0 0", "nan 0 1", "0 0 7", "0 0 7", "0 0.6 0.8"][i.min(4)]).await,
        json!([
            {"code": "normals_not_finite", "message": "1 of 100 normals are not finite and count as missing"},
            {"code": "normals_zero", "message": format!("1 of 100 {zero}")},
            {"code": "normals_not_unit", "message": "2 of 100 normals are far from unit length and are scaled to it"},
        ])
    );
    // As text with two digits.
    assert_eq!(warnings(|_| "0.58 0.58 0.58").await, json!([]));
}
