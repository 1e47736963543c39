//! What jobs told is the same before and after it is packed.

use meshway::jobs::{Event, JobId, NewEvent, Record};
use meshway::reconstruction::training::{GradientHistogram, LayerHistogram, Metrics};

use super::support::{Bench, success};

fn metrics(evaluation: u64) -> Metrics {
    Metrics {
        iteration: evaluation,
        evaluation,
        // Numbers that a text of them would change, or has no word for.
        loss: if evaluation == 2 { f64::NAN } else { 0.1 + 0.2 },
        validation_loss: (evaluation > 1).then_some(f64::MIN_POSITIVE),
        gradient_norm: 1e-300,
        step_length: -0.0,
        weight_norms: vec![1.0 / 3.0, 7.5],
        blocks: (evaluation == 3).then_some(2),
    }
}

/// A job that told something and ended.
async fn ended(bench: &Bench) -> JobId {
    bench.submit().await;
    let claim = bench.claim().await;
    for evaluation in 1..4 {
        let record = Record {
            progress: Some(0.2 * evaluation as f64),
            evaluations: Some(evaluation),
            loss: Some(0.5),
            events: vec![NewEvent::Progress {
                fraction: 0.2 * evaluation as f64,
                eta_seconds: None,
            }],
            metrics: vec![metrics(evaluation)],
            gradients: vec![GradientHistogram {
                evaluation,
                layers: vec![LayerHistogram {
                    layer: "linear.0".to_owned(),
                    min: -0.1,
                    max: 1e-9,
                    counts: vec![0, 7],
                }],
            }],
            ..Record::default()
        };
        bench.store.record(&claim, record).await.unwrap();
    }
    bench.store.succeed(&claim, success()).await.unwrap();
    claim.job.id
}

/// All that is told of a job, as text: NaN is not equal to itself.
async fn told(bench: &Bench, job: &JobId) -> String {
    let records = bench.records();
    let events = records.events_after(job, 0, 1_000).await.unwrap();
    let some = records.events_after(job, 2, 2).await.unwrap();
    let metrics = records.metrics(job, 0, 1_000).await.unwrap();
    let last = records.metrics(job, 1, 1).await.unwrap();
    let gradients = records.gradients(job).await.unwrap();
    format!("{events:#?}{some:#?}{metrics:#?}{last:#?}{gradients:#?}")
}

/// All events of the tenant, read in pages of this size.
async fn all(bench: &Bench, limit: u32) -> Vec<Event> {
    let (mut all, mut seq) = (Vec::new(), 0);
    loop {
        let page = bench.records().all_events_after(seq, limit).await.unwrap();
        assert!(page.len() <= limit as usize);
        let Some(last) = page.last() else {
            return all;
        };
        assert!(page.first().unwrap().seq > seq);
        seq = last.seq;
        all.extend(page);
    }
}

#[tokio::test]
async fn what_a_job_told_is_the_same_when_it_is_packed() {
    let bench = Bench::new().await;
    let jobs = [ended(&bench).await, ended(&bench).await, ended(&bench).await];
    bench.submit().await;
    let store = &bench.store;
    let before = [told(&bench, &jobs[0]).await, told(&bench, &jobs[1]).await];
    let events = all(&bench, 1_000).await;
    let (newest, counts) = (
        bench.records().last_seq().await.unwrap(),
        bench.records().counts().await.unwrap(),
    );
    let due = store.jobs_to_archive(store.now() + 1, 10).await.unwrap();
    assert_eq!(due.len(), 3, "the job that waits is not among them");
    assert_eq!(store.jobs_to_archive(0, 10).await.unwrap(), []);
    for (job, tenant) in &due[..2] {
        store.archive(job, tenant).await.unwrap();
        // Again does nothing.
        store.archive(job, tenant).await.unwrap();
    }
    assert_eq!(store.jobs_to_archive(store.now() + 1, 10).await.unwrap().len(), 1);
    assert_eq!([told(&bench, &jobs[0]).await, told(&bench, &jobs[1]).await], before);
    for limit in [1, 2, 7, 1_000] {
        assert_eq!(all(&bench, limit).await, events, "in pages of {limit}");
    }
    assert_eq!(bench.records().last_seq().await.unwrap(), newest);
    assert_eq!(store.last_seq_of_all().await.unwrap(), newest);
    assert_eq!(bench.records().counts().await.unwrap(), counts);
    let rows = bench.bare().await.texts("SELECT DISTINCT job_id FROM events ORDER BY 1").await;
    assert_eq!(rows.len(), 2, "{rows:?}");

    // Nobody else reads it, and it goes with its job.
    let other = "other".parse().unwrap();
    assert_eq!(store.of(&other).events_after(&jobs[0], 0, 10).await.unwrap(), []);
    assert_eq!(store.of(&other).metrics(&jobs[0], 0, 10).await.unwrap(), []);
    bench.acts().delete_job(&jobs[0]).await.unwrap();
    assert_eq!(bench.records().events_after(&jobs[0], 0, 10).await.unwrap(), []);
    let left = bench.bare().await.texts("SELECT job_id FROM histories").await;
    assert_eq!(left, [jobs[1].to_string()]);
    let kept = all(&bench, 3).await;
    let expected: Vec<Event> = events.into_iter().filter(|e| e.job_id != jobs[0]).collect();
    assert_eq!(kept, expected);
}
