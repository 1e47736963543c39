//! Some of the points of a cloud, to look at.

use axum::body::Body;
use axum::http::Request;

use crate::http::contract::expect_contract;
use crate::http::support::{Answer, Service, gzip, sphere, upload_request};

/// A cloud that is uploaded, and the address of its points.
async fn upload(service: &Service, file: Vec<u8>) -> String {
    let cloud = service.send(upload_request(file)).await.json();
    cloud["links"]["points"].as_str().unwrap().to_owned()
}

/// Rows in the coordinates of the cloud, and their labels.
fn rows(answer: &Answer) -> Vec<([f64; 3], f32)> {
    let origin: Vec<f64> = answer
        .header("meshway-origin")
        .split(',')
        .map(|number| number.parse().unwrap())
        .collect();
    let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
    answer
        .body
        .chunks_exact(16)
        .map(|row| {
            let at = |axis: usize| f64::from(number(&row[4 * axis..4 * axis + 4])) + origin[axis];
            ([at(0), at(1), at(2)], number(&row[12..]))
        })
        .collect()
}

#[tokio::test]
async fn points_come_with_their_labels_and_keep_their_digits() {
    let service = Service::new().await;
    let points = sphere(100, 4_000_000.0);
    let rows_of_text = points.iter().enumerate().map(|(i, [x, y, z])| {
        let label = i32::from(i >= 60);
        format!("{x},{y},{z},{label}\n")
    });
    let file = String::from("x,y,z,label\n") + &rows_of_text.collect::<String>();
    let url = upload(&service, file.into_bytes()).await;
    let answer = service.get(&url).await.expect(200);
    expect_contract(&answer, "get", "/v1/clouds/{id}/points");
    let all = rows(&answer);
    assert_eq!(all.len(), 100);
    for (i, ((found, label), point)) in all.iter().zip(&points).enumerate() {
        for (found, point) in found.iter().zip(point) {
            // A unit sphere far away: f32 alone would leave a quarter.
            assert!((found - point).abs() < 1e-6, "{found} {point}");
        }
        assert!((label - if i < 60 { 0.0 } else { 1.0 }).abs() < f32::EPSILON);
    }
    let some = service.get(&format!("{url}?max=10")).await.expect(200);
    assert_eq!(rows(&some).len(), 10);
    let known = Request::get(format!("{url}?max=10")).header("if-none-match", some.header("etag"));
    let known = known.body(Body::empty()).unwrap();
    service.send(known).await.expect(304);
}

#[tokio::test]
async fn a_large_file_is_read_by_a_child() {
    let service = Service::new().await;
    let mut ply = b"ply\nformat binary_little_endian 1.0\nelement vertex 70000\nproperty double x\nproperty double y\nproperty double z\nend_header\n".to_vec();
    let points = sphere(70_000, 0.0);
    for coordinate in points.iter().flatten() {
        ply.extend_from_slice(&coordinate.to_le_bytes());
    }
    let packed = gzip(&ply);
    assert!(packed.len() > 1 << 20, "too small for a child");
    let url = upload(&service, packed).await;
    let some = rows(&service.get(&format!("{url}?max=500")).await.expect(200));
    assert_eq!(some.len(), 500);
    for (stretch, (found, _)) in some.iter().enumerate() {
        let near = &points[stretch * 140..(stretch + 1) * 140];
        let close = |point: &[f64; 3]| (0..3).all(|axis| (found[axis] - point[axis]).abs() < 1e-6);
        assert!(near.iter().any(close), "{found:?} is not of its stretch");
    }
}

#[tokio::test]
async fn what_cannot_be_given_is_refused() {
    let service = Service::new().await;
    let missing = format!("/v1/clouds/cld_{}/points", "0".repeat(32));
    service.get(&missing).await.expect_problem(404, "not_found");
    let url = upload(&service, crate::http::support::sphere_xyz(100, 0.0).into()).await;
    for query in ["max=0", "max=1000001", "max=many", "most=3"] {
        let answer = service.get(&format!("{url}?{query}")).await;
        answer.expect_problem(422, "request_invalid");
    }
    service
        .delete(url.trim_end_matches("/points"))
        .await
        .expect(204);
    service.get(&url).await.expect_problem(410, "gone");
}
