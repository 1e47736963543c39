//! Pages and filters.

use serde_json::json;

use crate::http::support::Service;

#[tokio::test]
async fn pages_are_stable_under_inserts() {
    let service = Service::new().await;
    let mut ids = Vec::new();
    for _ in 0..5 {
        ids.push(service.submit().await);
    }
    let mut seen = Vec::new();
    let mut next = "/v1/jobs?status=queued&limit=2".to_owned();
    loop {
        let page = service.get(&next).await.expect(200);
        let body = page.json();
        seen.extend(
            body["items"]
                .as_array()
                .unwrap()
                .iter()
                .map(|job| job["id"].as_str().unwrap().to_owned()),
        );
        // Newer than the first page: on no later one.
        service.submit().await;
        let Some(cursor) = body["next_cursor"].as_str() else {
            assert!(!page.headers.contains_key("link"));
            break;
        };
        next = format!("/v1/jobs?status=queued&limit=2&cursor={cursor}");
        assert_eq!(page.header("link"), format!("<{next}>; rel=\"next\""));
    }
    ids.reverse();
    assert_eq!(seen, ids);
}

#[tokio::test]
async fn lists_are_filtered_and_faulty_filters_refused() {
    let service = Service::new().await;
    let first = service.submit().await;
    let cloud = service.get(&format!("/v1/jobs/{first}")).await.json()["cloud_id"].clone();
    let labelled = json!({"cloud_id": cloud, "labels": {"ward": "3:b"}});
    let second = service
        .post_json("/v1/jobs", &labelled)
        .await
        .expect(202)
        .json();
    service
        .post_json(&format!("/v1/jobs/{first}/cancel"), &json!({}))
        .await
        .expect(200);
    let ids = async |query: &str| {
        let list = service
            .get(&format!("/v1/jobs?{query}"))
            .await
            .expect(200)
            .json();
        let ids = list["items"]
            .as_array()
            .unwrap()
            .iter()
            .map(|job| job["id"].as_str().unwrap().to_owned());
        ids.collect::<Vec<_>>()
    };
    let second = second["id"].as_str().unwrap().to_owned();
    assert_eq!(ids("status=cancelled").await, std::slice::from_ref(&first));
    assert_eq!(ids("label=ward:3:b").await, std::slice::from_ref(&second));
    assert_eq!(
        ids(&format!("cloud_id={}", cloud.as_str().unwrap())).await,
        [second, first]
    );
    assert!(ids("created_after=2999-01-01T00:00:00Z").await.is_empty());
    let faulty = "status=done&label=x&cloud_id=y&created_after=now&limit=0&colour=red";
    let problem = service
        .get(&format!("/v1/jobs?{faulty}"))
        .await
        .expect_problem(422, "request_invalid");
    assert_eq!(problem["errors"].as_array().unwrap().len(), 6, "{problem}");
    service
        .get("/v1/jobs?limit=1&limit=2")
        .await
        .expect_problem(422, "request_invalid");
    service
        .get("/v1/jobs?cursor=zz")
        .await
        .expect_problem(400, "bad_cursor");
    service
        .get("/v1/clouds?cursor=zz")
        .await
        .expect_problem(400, "bad_cursor");
}
