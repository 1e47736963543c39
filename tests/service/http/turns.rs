//! Priorities and places of waiting jobs, as clients see them.

use serde_json::{Value, json};

use crate::http::contract::{expect_contract, expect_named};
use crate::http::support::{Service, json_request};

#[tokio::test]
async fn a_job_of_a_higher_priority_goes_first_and_tells_when_it_will_be_done() {
    let service = Service::new().await;
    let cloud = service.upload().await;
    let submit = async |body: Value| service.post_json("/v1/jobs", &body).await;
    let asked = json!({"cloud_id": cloud, "preset": "fast"});
    let plain = submit(asked.clone()).await.expect(202).json();
    let mut urgent = asked.clone();
    urgent["priority"] = json!(9);
    let urgent = submit(urgent).await.expect(202).json();
    assert_eq!(
        (&plain["priority"], &urgent["priority"]),
        (&json!(0), &json!(9))
    );
    let show = async |job: &Value| {
        let url = job["links"]["self"].as_str().unwrap();
        service.get(url).await.expect(200).json()
    };
    let (plain, urgent) = (show(&plain).await, show(&urgent).await);
    expect_named("Job", &plain);
    assert_eq!(
        (&urgent["queue_position"], &plain["queue_position"]),
        (&json!(1), &json!(2))
    );
    let eta = |job: &Value| job["eta_seconds"].as_f64().unwrap();
    assert!(eta(&urgent) > 0.0 && eta(&plain) >= 2.0 * eta(&urgent) - 0.2);
    let listed = service.get("/v1/jobs").await.expect(200).json();
    assert_eq!(listed["items"], json!([urgent, plain]));

    let patch = async |job: &Value, body: Value| {
        let mut request = json_request(job["links"]["self"].as_str().unwrap(), &body);
        *request.method_mut() = axum::http::Method::PATCH;
        service.send(request).await
    };
    let first = patch(&urgent, json!({"priority": -1})).await;
    expect_contract(&first, "patch", "/v1/jobs/{id}");
    let first = first.expect(200).json();
    assert_eq!(
        (&first["priority"], &first["queue_position"]),
        (&json!(-1), &json!(2))
    );
    let problem = patch(&urgent, json!({"priority": 10})).await;
    let problem = problem.expect_problem(422, "request_invalid");
    assert_eq!(problem["errors"][0]["pointer"], "/priority");
    let back = patch(&urgent, json!({"priority": 9})).await.expect(200);
    assert_eq!(back.json()["queue_position"], 1);

    let claim = service.claim().await;
    assert_eq!(claim.job.id.as_str(), urgent["id"]);
    service.fail(&claim, "no_surface").await;
    let retry = urgent["links"]["retry"].as_str().unwrap();
    let again = service
        .post_json(retry, &json!({}))
        .await
        .expect(202)
        .json();
    assert_eq!(again["priority"], 9);
    let lower = service.post_json(retry, &json!({"priority": -9})).await;
    assert_eq!(lower.expect(202).json()["queue_position"], 3);

    for wrong in [json!(10), json!(-10), json!(1.5), json!("high")] {
        let mut body = asked.clone();
        body["priority"] = wrong;
        let problem = submit(body).await.expect_problem(422, "request_invalid");
        assert_eq!(problem["errors"][0]["pointer"], "/priority");
    }
    let limits = service.get("/v1/limits").await.expect(200).json();
    assert_eq!(limits["priority"], json!({"minimum": -9.0, "maximum": 9.0}));
}
