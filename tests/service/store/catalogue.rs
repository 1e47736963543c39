//! What clients find: kept answers, lists, clouds, the stream of all events, and erasure.

use meshway::jobs::store::CHUNK_BYTES;
use meshway::jobs::{
    CloudId, Error, FailureReason, Idempotency, IdempotencyState, Job, JobFilter, Lookup, NewMesh,
    Record, Status, StoredResponse,
};
use meshway::reconstruction::training::{GradientHistogram, Metrics};

use super::ENGINE;
use super::support::{Bench, new_cloud, success};
use crate::server::{PATIENCE, until};
use crate::store::bare::Engine;

fn response(body: &str) -> StoredResponse {
    StoredResponse {
        status: 202,
        headers: vec![("location".to_owned(), "/v1/jobs/x".to_owned())],
        body: body.as_bytes().to_vec(),
    }
}

#[tokio::test]
async fn an_answer_is_given_again_and_a_key_has_one_use() {
    let bench = Bench::new().await;
    let (store, acts) = (&bench.store, bench.acts());
    let begin = |key: &'static str, hash: &'static str| acts.idempotency_begin(key, "POST", hash);
    assert_eq!(begin("k", "h").await.unwrap(), IdempotencyState::New);
    assert_eq!(begin("k", "h").await.unwrap(), IdempotencyState::InFlight);
    assert_eq!(
        begin("k", "other").await.unwrap(),
        IdempotencyState::Mismatch
    );
    acts.idempotency_complete("k", "POST", None, response("a"))
        .await
        .unwrap();
    assert_eq!(
        begin("k", "h").await.unwrap(),
        IdempotencyState::Replay(response("a"))
    );
    let twice = acts
        .idempotency_complete("k", "POST", None, response("b"))
        .await;
    assert!(matches!(twice, Err(Error::Stale)), "{twice:?}");

    assert_eq!(begin("l", "h").await.unwrap(), IdempotencyState::New);
    acts.idempotency_abandon("l", "POST").await.unwrap();
    assert_eq!(begin("l", "h").await.unwrap(), IdempotencyState::New);
    assert_eq!(store.idempotency_abandon_all().await.unwrap(), 1);
    bench.pass(1);
    assert_eq!(begin("m", "h").await.unwrap(), IdempotencyState::New);
    assert_eq!(store.idempotency_prune(store.now()).await.unwrap(), 1);
    assert_eq!(begin("k", "h").await.unwrap(), IdempotencyState::New);
}

#[tokio::test]
async fn the_answer_to_a_submission_is_in_the_jobs_own_transaction() {
    let bench = Bench::new().await;
    let keep = |key: &str| {
        Some(Idempotency {
            key: key.to_owned(),
            scope: "POST".to_owned(),
            respond: Box::new(|job: &Job| response(job.id.as_str())),
        })
    };
    let refused = bench
        .acts()
        .submit(bench.new_job(), keep("never begun"))
        .await;
    assert!(matches!(refused, Err(Error::Stale)), "{refused:?}");
    assert_eq!(bench.store.counts().await.unwrap().get(Status::Queued), 0);

    bench
        .acts()
        .idempotency_begin("k", "POST", "h")
        .await
        .unwrap();
    let job = bench
        .acts()
        .submit(bench.new_job(), keep("k"))
        .await
        .unwrap();
    let state = bench
        .acts()
        .idempotency_begin("k", "POST", "h")
        .await
        .unwrap();
    assert_eq!(state, IdempotencyState::Replay(response(job.id.as_str())));
}

#[tokio::test]
async fn lists_go_backwards_in_pages_and_take_filters() {
    let bench = Bench::new().await;
    let mut ids = Vec::new();
    for i in 0..5 {
        let mut new = bench.new_job();
        new.labels.insert("run \"1'".to_owned(), i.to_string());
        ids.push(bench.acts().submit(new, None).await.unwrap().id);
        bench.pass(1_000);
    }
    ids.reverse();
    let all = JobFilter::default();
    let page = bench.records().list_jobs(&all, None, 2).await.unwrap();
    bench.submit().await;
    let rest = bench
        .records()
        .list_jobs(&all, Some(&page[1].id), 10)
        .await
        .unwrap();
    let seen: Vec<_> = page.iter().chain(&rest).map(|job| job.id.clone()).collect();
    assert_eq!(seen, ids, "an insert does not move the pages");

    bench.acts().request_cancel(&ids[4]).await.unwrap();
    let count = async |filter: JobFilter| {
        bench
            .records()
            .list_jobs(&filter, None, 50)
            .await
            .unwrap()
            .len()
    };
    let label = |value: &str| Some(("run \"1'".to_owned(), value.to_owned()));
    assert_eq!(
        count(JobFilter {
            status: Some(Status::Cancelled),
            ..JobFilter::default()
        })
        .await,
        1
    );
    assert_eq!(
        count(JobFilter {
            status: Some(Status::Queued),
            ..JobFilter::default()
        })
        .await,
        5
    );
    assert_eq!(
        count(JobFilter {
            label: label("3"),
            ..JobFilter::default()
        })
        .await,
        1
    );
    assert_eq!(
        count(JobFilter {
            label: label("9"),
            ..JobFilter::default()
        })
        .await,
        0
    );
    let after = bench.job(&ids[1]).await.created_at;
    assert_eq!(
        count(JobFilter {
            created_after: Some(after),
            ..JobFilter::default()
        })
        .await,
        2
    );
    let cloud = JobFilter {
        cloud_id: Some(bench.cloud_id.clone()),
        ..JobFilter::default()
    };
    assert_eq!(count(cloud).await, 6);
    let cloud = JobFilter {
        cloud_id: Some(CloudId::at(0)),
        ..JobFilter::default()
    };
    assert_eq!(count(cloud).await, 0);
}

#[tokio::test]
async fn the_same_bytes_are_one_cloud() {
    let bench = Bench::new().await;
    let (again, created) = bench.acts().insert_cloud(new_cloud("a")).await.unwrap();
    assert_eq!((&again.id, created), (&bench.cloud_id, false));
    let (other, created) = bench.acts().insert_cloud(new_cloud("b")).await.unwrap();
    assert!(created);
    assert_eq!(
        bench.records().cloud(&other.id).await.unwrap(),
        Some(other.clone())
    );
    assert_eq!(
        bench.records().cloud_by_sha256("b").await.unwrap(),
        Some(other.clone())
    );
    assert_eq!(bench.store.sha256s().await.unwrap(), ["a", "b"]);
    let page = bench.records().list_clouds(None, 1).await.unwrap();
    assert_eq!(page, [other]);
    assert_eq!(
        bench
            .records()
            .list_clouds(Some(&page[0].id), 9)
            .await
            .unwrap(),
        [again]
    );
}

#[tokio::test]
async fn one_stream_tells_the_events_of_all_jobs_in_order() {
    let bench = Bench::new().await;
    bench.submit().await;
    let before = bench.records().last_seq().await.unwrap();
    let second = bench.submit().await.id;
    let claim = bench.claim().await;
    let reason = FailureReason::Unresponsive;
    bench
        .store
        .attempt_failed(claim.job_id(), 1, reason)
        .await
        .unwrap();
    let events = bench.records().all_events_after(before, 10).await.unwrap();
    let told: Vec<_> = events
        .iter()
        .map(|e| (e.job_id.clone(), e.kind.name()))
        .collect();
    let first = claim.job.id;
    assert_eq!(
        told,
        [
            (second, "job.queued"),
            (first.clone(), "job.started"),
            (first, "job.queued")
        ]
    );
    assert_eq!(bench.records().last_seq().await.unwrap(), events[2].seq);
    // A newest event that is erased does not give its place to another one.
    bench.acts().delete_job(&events[2].job_id).await.unwrap();
    bench.submit().await;
    assert!(bench.records().last_seq().await.unwrap() > events[2].seq);
}

#[tokio::test]
async fn a_row_that_cannot_be_read_names_its_column() {
    let bench = Bench::new().await;
    let id = bench.submit().await.id;
    let mut db = bench.bare().await;
    for (statement, wanted) in [
        ("UPDATE jobs SET settings = '{\"network\": 3}'", "settings"),
        ("UPDATE jobs SET preset = 'slow'", "preset"),
        ("UPDATE jobs SET evaluations = -1", "evaluations"),
    ] {
        let settings = db.texts("SELECT settings FROM jobs").await.remove(0);
        db.run(statement).await.unwrap();
        let error = bench.records().job(&id).await.unwrap_err();
        assert!(
            matches!(&error, Error::Inconsistent { table: "jobs", column, .. } if *column == wanted),
            "{error}"
        );
        assert_eq!(error.code(), "internal");
        let mend =
            format!("UPDATE jobs SET settings = '{settings}', preset = 'fast', evaluations = 0");
        db.run(&mend).await.unwrap();
    }
    bench.job(&id).await;
}

#[tokio::test]
async fn nothing_stays_of_an_erased_job_but_its_tombstone() {
    let bench = Bench::new().await;
    bench
        .acts()
        .idempotency_begin("k", "POST", "h")
        .await
        .unwrap();
    let keep = Idempotency {
        key: "k".to_owned(),
        scope: "POST".to_owned(),
        respond: Box::new(|job: &Job| response(job.id.as_str())),
    };
    let job = bench
        .acts()
        .submit(bench.new_job(), Some(keep))
        .await
        .unwrap();
    let claim = bench.claim().await;
    bench
        .store
        .record(&claim, row_of_everything())
        .await
        .unwrap();
    let mesh = NewMesh::new(1, 1, vec![1; CHUNK_BYTES + 1]);
    bench.store.put_snapshot(&claim, 2, mesh).await.unwrap();
    bench
        .store
        .put_checkpoint(&claim, 3, vec![1])
        .await
        .unwrap();
    let running = bench.submit().await.id;
    let second = bench.claim().await;
    bench
        .store
        .put_checkpoint(&second, 3, vec![1])
        .await
        .unwrap();
    bench.store.succeed(&claim, success()).await.unwrap();

    for id in [&job.id, &running] {
        let before = bench.acts().delete_job(id).await.unwrap();
        assert_eq!(before.found().map(|job| job.id), Some(id.clone()));
        for known in [
            bench.records().job(id).await.unwrap(),
            bench.acts().request_cancel(id).await.unwrap(),
            bench.acts().delete_job(id).await.unwrap(),
        ] {
            assert!(
                matches!(&known, Lookup::Gone(stone) if stone.reason == "deleted" && stone.deleted_at == bench.store.now()),
                "{known:?}"
            );
        }
    }
    // Every table that the schema has, so that a new one cannot be forgotten.
    let mut db = bench.bare().await;
    let tables = bench.either(
        "SELECT name FROM sqlite_schema WHERE type = 'table'",
        "SELECT CAST(tablename AS TEXT) FROM pg_tables WHERE schemaname = 'public'",
    );
    let tables = db.texts(tables).await;
    assert!(tables.len() >= 11);
    for table in tables {
        let count = db.number(&format!("SELECT COUNT(*) FROM \"{table}\"")).await;
        let expected = match table.as_str() {
            "_sqlx_migrations" => continue,
            // Of idempotency the key, so that a repeated request makes no second job; of the tenant, not of
            // the job: where it stands in the queue, and how long was worked for it.
            // And of each process its last commit.
            "clouds" | "writers" | "idempotency" | "turns" | "now_served" | "compute" => 1,
            // Of the database its id; on a server the name of its folder, too.
            "meta" => match ENGINE {
                Engine::Sqlite => 1,
                Engine::Postgres => 2,
            },
            // sqlite_sequence: the largest ids of events and meshes that were ever given.
            "tombstones" | "sqlite_sequence" => 2,
            _ => 0,
        };
        assert_eq!(count, expected, "{table}");
    }
    let emptied =
        "SELECT COUNT(*) FROM idempotency WHERE length(body) = 0 AND headers = '[]'";
    assert_eq!(db.number(emptied).await, 1);
    let again = bench.acts().idempotency_begin("k", "POST", "h");
    let state = again.await.unwrap();
    assert!(
        matches!(&state, IdempotencyState::Gone(stone) if stone.reason == "deleted"),
        "{state:?}"
    );
}

#[tokio::test]
async fn erased_bytes_are_in_no_file() {
    let bench = Bench::new().await;
    let secret = b"the liver of patient 17";
    let id = bench.submit().await.id;
    let claim = bench.claim().await;
    let mesh = NewMesh::new(1, 1, secret.repeat(1_000));
    bench.store.put_snapshot(&claim, 2, mesh).await.unwrap();
    let found = || {
        let files = std::fs::read_dir(bench.path()).unwrap();
        files.map(|file| file.unwrap().path()).any(|file| {
            let bytes = std::fs::read(file).unwrap_or_default();
            bytes.windows(secret.len()).any(|part| part == secret)
        })
    };
    assert!(found());
    bench.acts().delete_job(&id).await.unwrap();
    until("they are overwritten", PATIENCE, async || {
        (!found()).then_some(())
    })
    .await;
}

fn row_of_everything() -> Record {
    let metrics = Metrics {
        iteration: 1,
        evaluation: 2,
        loss: 0.5,
        validation_loss: None,
        gradient_norm: 1.0,
        step_length: 1.0,
        weight_norms: vec![1.0],
        blocks: None,
    };
    let gradients = GradientHistogram {
        evaluation: 2,
        layers: Vec::new(),
    };
    Record {
        metrics: vec![metrics],
        gradients: vec![gradients],
        ..Record::default()
    }
}
