//! Batches that are here: followed, cancelled, erased, asked for again.

use axum::body::Body;
use axum::http::Request;
use meshway::jobs::Record;
use serde_json::json;

use crate::http::batches::{ids, number, own, show, spheres, submit};
use crate::http::contract::expect_contract;
use crate::http::support::{Service, job_id, json_request};
use crate::http::tenants::{Held, configure, finish};
use crate::server::{PATIENCE, until};
use crate::who::us;

#[tokio::test]
async fn progress_never_goes_back() {
    let service = Service::new().await;
    let batch = submit(&service, &[0.0, 1.0]).await;
    let path = own(&batch);
    let work = async |share: f64| {
        let claim = service.claim().await;
        let record = Record {
            progress: Some(share),
            ..Record::default()
        };
        service.store().record(&claim, record).await.unwrap();
        claim
    };
    let first = work(0.8).await;
    assert_eq!(show(&service, &path).await["progress"], 0.4);
    service.store().release(&first).await.unwrap();
    let again = work(0.2).await;
    assert_eq!(again.job_id(), first.job_id());
    let shown = show(&service, &path).await;
    assert_eq!(shown["jobs"][0]["progress"], 0.2);
    assert_eq!(shown["progress"], 0.4);
    work(0.6).await;
    assert_eq!(show(&service, &path).await["progress"], 0.4);
    let erased = &ids(&batch)[0];
    let erase = service.delete(&format!("/v1/jobs/{erased}")).await;
    erase.expect(204);
    let shown = show(&service, &path).await;
    assert_eq!(shown["progress"], 0.8);
    assert_eq!(shown["counts"]["erased"], 1);
}

#[tokio::test]
async fn one_stream_tells_of_all_its_jobs_and_ends_with_the_last() {
    let service = Service::new().await;
    let batch = submit(&service, &[0.0, 1.0]).await;
    let jobs = ids(&batch);
    let other = service.submit().await;
    let events = batch["links"]["events"].as_str().unwrap().to_owned();
    let stream = || {
        let request = Request::get(&events).header("accept", "text/event-stream");
        request.body(Body::empty()).unwrap()
    };
    let live = tokio::spawn(service.send(stream()));
    finish(&service).await;
    let claim = service.claim().await;
    service.fail(&claim, "no_surface").await;
    let told = live.await.unwrap().expect(200);
    let again = service.send(stream()).await.expect(200);
    assert_eq!(told.body, again.body);
    let told = String::from_utf8(told.body).unwrap();
    assert!(!told.contains(&other), "{told}");
    for (event, times) in [
        ("job.queued", 2),
        ("job.started", 2),
        ("job.succeeded", 1),
        ("job.failed", 1),
    ] {
        let said = told.matches(&format!("event: {event}\n")).count();
        assert_eq!(said, times, "{event}: {told}");
    }
    for job in &jobs {
        assert!(told.contains(job));
    }
    // As pages, and from where a client was.
    let page = |query: &str| {
        let path = format!("{events}?{query}");
        let request = Request::get(path).header("accept", "application/json");
        service.send(request.body(Body::empty()).unwrap())
    };
    let whole = page("limit=1000").await.expect(200);
    expect_contract(&whole, "get", "/v1/batches/{id}/events");
    let items = whole.json()["items"].as_array().unwrap().clone();
    assert_eq!(items.len(), told.matches("event: ").count());
    let part = page("limit=1").await.expect(200);
    let next = part.json()["next_after"].clone();
    assert_eq!(next, items[0]["id"]);
    let link = part.header("link").to_owned();
    assert!(
        link.starts_with(&format!("<{events}?after={next}")),
        "{link}"
    );
    let last = items.last().unwrap()["id"].as_i64().unwrap();
    let from = |id: String| {
        let mut request = stream();
        let id = id.parse().unwrap();
        request.headers_mut().insert("last-event-id", id);
        service.send(request)
    };
    from(last.to_string()).await.expect(204);
    let rest = from((last - 1).to_string()).await.expect(200);
    let rest = String::from_utf8(rest.body).unwrap();
    assert_eq!(rest.matches("event: ").count(), 1, "{rest}");
    let reset = from("elsewhere".to_owned()).await.expect(200);
    let reset = String::from_utf8(reset.body).unwrap();
    assert!(reset.contains("event: reset") && reset.contains("\"status\":\"ended\""));
}

#[tokio::test]
async fn a_stream_ends_when_what_is_left_is_erased() {
    let service = Service::new().await;
    let batch = submit(&service, &[0.0, 1.0]).await;
    let events = batch["links"]["events"].as_str().unwrap();
    let stream = Request::get(events).header("accept", "text/event-stream");
    let live = tokio::spawn(service.send(stream.body(Body::empty()).unwrap()));
    finish(&service).await;
    // The stream is open before its batch goes.
    let open = async || {
        let metrics = service.get("/metrics").await.body;
        let metrics = String::from_utf8(metrics).unwrap();
        metrics.contains("sse_streams 1").then_some(())
    };
    until("the stream is open", PATIENCE, open).await;
    service.delete(&own(&batch)).await.expect(200);
    live.await.unwrap().expect(200);
}

#[tokio::test]
async fn all_jobs_are_cancelled_at_once() {
    let service = Service::new().await;
    let batch = submit(&service, &[0.0, 1.0, 2.0]).await;
    finish(&service).await;
    let claim = service.claim().await;
    let cancel = batch["links"]["cancel"].as_str().unwrap();
    let cancelled = || {
        let mut request = json_request(cancel, &json!({}));
        let key = "k".parse().unwrap();
        request.headers_mut().insert("idempotency-key", key);
        service.send(request)
    };
    let answer = cancelled().await.expect(200);
    expect_contract(&answer, "post", "/v1/batches/{id}/cancel");
    let counts = answer.json()["counts"].clone();
    assert_eq!(
        (&counts["cancelled"], &counts["running"]),
        (&json!(1), &json!(1))
    );
    service.store().cancelled(&claim).await.unwrap();
    let again = cancelled().await.expect(200);
    assert_eq!(again.header("idempotency-replayed"), "true");
    assert_eq!(again.json()["status"], "ended");
    assert_eq!(again.json()["counts"]["cancelled"], 2);
    assert_eq!(again.json()["counts"]["succeeded"], 1);
}

#[tokio::test]
async fn a_batch_is_erased_with_its_clouds_and_goes_with_its_last_job() {
    let service = Service::new().await;
    let batch = submit(&service, &[0.0, 1.0, 2.0]).await;
    let jobs = ids(&batch);
    let held = |on: bool| {
        let body = json!({ "hold": on }).to_string();
        let request = Request::patch(format!("/v1/jobs/{}", jobs[0]));
        let request = request.header("content-type", "application/json");
        service.send(request.body(body.into()).unwrap())
    };
    held(true).await.expect(200);
    let erased = service.delete(&own(&batch)).await;
    expect_contract(&erased, "delete", "/v1/batches/{id}");
    let counts = json!({"jobs": 2, "clouds": 2, "held": 1});
    assert_eq!(erased.expect(200).json(), counts);
    let shown = show(&service, &own(&batch)).await;
    assert_eq!(ids(&shown), jobs[..1]);
    held(false).await.expect(200);
    let all = format!("{}?clouds=false", own(&batch));
    let erased = service.delete(&all).await.expect(200).json();
    assert_eq!(erased, json!({"jobs": 1, "clouds": 0, "held": 0}));
    for path in ["self", "events"] {
        let path = batch["links"][path].as_str().unwrap();
        service.get(path).await.expect_problem(410, "gone");
    }
    let cancel = batch["links"]["cancel"].as_str().unwrap();
    let cancel = service.post_json(cancel, &json!({})).await;
    cancel.expect_problem(410, "gone");
    service
        .delete(&own(&batch))
        .await
        .expect_problem(410, "gone");
    // One that goes job by job goes with the last, too.
    let batch = submit(&service, &[5.0]).await;
    let store = service.store();
    store
        .by(us())
        .delete_job(&job_id(&ids(&batch)[0]))
        .await
        .unwrap();
    service.get(&own(&batch)).await.expect_problem(410, "gone");
}

#[tokio::test]
async fn a_repeated_request_is_answered_with_the_batch_as_it_is() {
    let service = Service::new().await;
    let send = || {
        let labels = json!({"preset": "fast", "labels": {"patient": "janedoe77"}});
        let mut request = spheres(&[0.0, 1.0], &labels);
        let key = "k".parse().unwrap();
        request.headers_mut().insert("idempotency-key", key);
        service.send(request)
    };
    let first = send().await.expect(202).json();
    let erased = &ids(&first)[0];
    service
        .delete(&format!("/v1/jobs/{erased}"))
        .await
        .expect(204);
    let again = send().await.expect(202);
    expect_contract(&again, "post", "/v1/batches");
    assert_eq!(again.header("idempotency-replayed"), "true");
    assert_eq!(again.json()["id"], first["id"]);
    assert_eq!(ids(&again.json()), ids(&first)[1..]);
    assert_eq!(number(&service, "/v1/batches").await, 1);
    let mut other = spheres(&[0.0, 2.0], &json!({"preset": "fast"}));
    let key = "k".parse().unwrap();
    other.headers_mut().insert("idempotency-key", key);
    let other = service.send(other).await;
    other.expect_problem(422, "idempotency_mismatch");
    service.delete(&own(&first)).await.expect(200);
    let gone = send().await.expect_problem(410, "gone");
    assert!(gone["detail"].as_str().unwrap().starts_with("the batch"));
}

#[tokio::test]
async fn the_audit_trail_tells_of_batches_and_of_each_job() {
    let service = Service::new().await;
    let ours = Held::all("radiology");
    configure(&service, &[&ours]);
    let made = service
        .ask(&ours, spheres(&[0.0, 1.0], &json!({"preset": "fast"})))
        .await
        .expect(202)
        .json();
    let cancel = made["links"]["cancel"].as_str().unwrap();
    service
        .ask(&ours, json_request(cancel, &json!({})))
        .await
        .expect(200);
    let erase = Request::delete(own(&made)).body(Body::empty()).unwrap();
    service.ask(&ours, erase).await.expect(200);
    let rows = service.store().audit_after(0, 100).await.unwrap();
    let told: Vec<&str> = rows.iter().map(|row| row.event.as_str()).collect();
    let times = |event: &str| told.iter().filter(|told| **told == event).count();
    for (event, expected) in [
        ("batch.create", 1),
        ("job.create", 2),
        ("batch.cancel", 1),
        ("job.cancel", 2),
        ("job.delete", 2),
        ("cloud.delete", 2),
        ("batch.delete", 1),
    ] {
        assert_eq!(times(event), expected, "{event}: {told:?}");
    }
}
