//! The audit trail: whole, in the transaction of the act, and not to be changed unseen.

use meshway::identity::{Actor, Caller};
use meshway::jobs::{Act, AuditHead, AuditOutcome, CloudDeletion, Error};

use super::support::{Bench, new_cloud};

const DAY: i64 = 24 * 60 * 60 * 1_000;

/// The holder of a key.
fn holder() -> Caller {
    let actor = Actor::Key {
        name: "pacs".into(),
        id: "0a0b0c0d".into(),
    };
    let address = Some("10.1.2.3".parse().unwrap());
    Caller {
        actor,
        ..Caller::anybody()
    }
    .asking(address, "r1")
}

async fn note(bench: &Bench, times: usize) {
    for i in 0..times {
        let caller = holder().asking(None, &format!("r{i}"));
        let acts = bench.store.by(&caller);
        let noted = acts.note(Act::MeshRead, "job_1", AuditOutcome::Done);
        noted.await.unwrap();
    }
}

/// Runs a statement past the triggers, as somebody with the file in his hands would.
async fn tamper(bench: &Bench, statement: &str) {
    let mut db = bench.bare().await;
    for trigger in ["audit_is_not_changed", "audit_is_not_removed"] {
        let table = bench.either("", " ON audit");
        let drop = format!("DROP TRIGGER IF EXISTS {trigger}{table}");
        db.run(&drop).await.unwrap();
    }
    db.run(statement).await.unwrap();
}

async fn broken_at(bench: &Bench, known: &[AuditHead]) -> Option<i64> {
    let verified = bench.store.audit_verify(known).await.unwrap();
    verified.err().map(|fault| fault.seq)
}

#[tokio::test]
async fn an_act_and_its_row_are_one_and_refused_acts_have_none() {
    let bench = Bench::new().await;
    let acts = holder();
    let acts = bench.store.by(&acts);
    let (cloud, _) = acts.insert_cloud(new_cloud("b")).await.unwrap();
    let mut job = bench.new_job();
    job.cloud_id = cloud.id.clone();
    let job = acts.submit(job, None).await.unwrap();
    let mut nowhere = bench.new_job();
    nowhere.cloud_id = meshway::jobs::CloudId::at(0);
    let refused = acts.submit(nowhere, None).await;
    assert!(
        matches!(refused, Err(Error::CloudMissing(_))),
        "{refused:?}"
    );
    let deletion = acts.delete_cloud(&cloud.id).await.unwrap();
    assert_eq!(deletion, CloudDeletion::InUse);
    acts.delete_job(&job.id).await.unwrap();
    let rows = bench.store.audit_after(0, 10).await.unwrap();
    let told: Vec<_> = rows
        .iter()
        .map(|row| (row.seq, row.event.as_str()))
        .collect();
    assert_eq!(
        told,
        [(1, "cloud.create"), (2, "job.create"), (3, "job.delete")]
    );
    assert_eq!(rows[0].object, cloud.id.as_str());
    assert_eq!(
        (rows[0].actor.as_deref(), rows[0].address.as_deref()),
        (Some("pacs"), Some("10.1.2.3"))
    );
    assert_eq!(
        (rows[0].action.as_str(), rows[2].action.as_str()),
        ("C", "D")
    );
    let head = bench.store.audit_verify(&[]).await.unwrap().unwrap();
    assert_eq!(head, bench.store.audit_head().await.unwrap());
}

#[tokio::test]
async fn a_row_cannot_be_changed_or_removed() {
    let bench = Bench::new().await;
    note(&bench, 3).await;
    let mut db = bench.bare().await;
    for statement in [
        "UPDATE audit SET actor = 'nobody' WHERE seq = 2",
        "DELETE FROM audit WHERE seq = 2",
        "DELETE FROM audit",
        "INSERT INTO audit_begins VALUES (2, 'x')",
    ] {
        let refused = db.run(statement).await.unwrap_err();
        assert!(
            refused.to_string().contains("the audit trail"),
            "{statement}: {refused}"
        );
    }
    assert_eq!(broken_at(&bench, &[]).await, None);
}

#[tokio::test]
async fn whatever_is_done_to_the_file_shows() {
    let cases: [(&str, i64); 6] = [
        ("UPDATE audit SET actor = 'nobody' WHERE seq = 2", 2),
        ("UPDATE audit SET at = at + 1 WHERE seq = 5", 5),
        ("DELETE FROM audit WHERE seq = 3", 3),
        ("DELETE FROM audit WHERE seq = 1", 1),
        ("DELETE FROM audit WHERE seq >= 4", 4),
        // Two rows change places.
        (
            "UPDATE audit SET request = CASE seq WHEN 2 THEN 'r2' ELSE 'r1' END WHERE seq IN (2, 3)",
            2,
        ),
    ];
    for (statement, place) in cases {
        let bench = Bench::new().await;
        note(&bench, 5).await;
        tamper(&bench, statement).await;
        assert_eq!(broken_at(&bench, &[]).await, Some(place), "{statement}");
    }
}

#[tokio::test]
async fn a_trail_that_is_cut_and_written_anew_shows_against_a_noted_head() {
    let bench = Bench::new().await;
    note(&bench, 5).await;
    let noted = bench.store.audit_head().await.unwrap();
    assert_eq!(broken_at(&bench, std::slice::from_ref(&noted)).await, None);
    tamper(&bench, "DELETE FROM audit WHERE seq >= 4").await;
    let given = bench.either(
        "UPDATE sqlite_sequence SET seq = 3 WHERE name = 'audit'",
        "UPDATE audit_given SET seq = 3",
    );
    tamper(&bench, given).await;
    assert_eq!(broken_at(&bench, &[]).await, None);
    assert_eq!(
        broken_at(&bench, std::slice::from_ref(&noted)).await,
        Some(4)
    );
    bench.pass(1);
    note(&bench, 3).await;
    assert_eq!(broken_at(&bench, &[]).await, None);
    assert_eq!(broken_at(&bench, &[noted]).await, Some(5));
}

#[tokio::test]
async fn old_rows_go_and_the_rest_stays_whole() {
    let bench = Bench::new().await;
    note(&bench, 3).await;
    let old = bench.store.audit_head().await.unwrap();
    bench.pass(10 * DAY);
    note(&bench, 2).await;
    let store = &bench.store;
    assert_eq!(store.audit_prune(store.now() - 20 * DAY).await.unwrap(), 0);
    assert_eq!(store.audit_prune(store.now() - 5 * DAY).await.unwrap(), 3);
    let rows = store.audit_after(0, 10).await.unwrap();
    let places: Vec<_> = rows.iter().map(|row| row.seq).collect();
    assert_eq!(places, [4, 5]);
    assert_eq!(broken_at(&bench, &[old]).await, None);
    bench.pass(10 * DAY);
    assert_eq!(store.audit_prune(store.now() - 5 * DAY).await.unwrap(), 2);
    assert_eq!(broken_at(&bench, &[]).await, None);
    note(&bench, 1).await;
    assert_eq!(store.audit_head().await.unwrap().seq, 6);
    assert_eq!(broken_at(&bench, &[]).await, None);
}

#[tokio::test]
async fn two_processes_write_one_trail() {
    let bench = Bench::new().await;
    let other = bench.second().await;
    let caller = holder();
    let write = |store: meshway::jobs::Store| {
        let caller = caller.clone();
        async move {
            for _ in 0..50 {
                let acts = store.by(&caller);
                acts.note(Act::MeshRead, "job_1", AuditOutcome::Done)
                    .await
                    .unwrap();
            }
        }
    };
    tokio::join!(write(bench.store.clone()), write(other));
    assert_eq!(bench.store.audit_head().await.unwrap().seq, 100);
    assert_eq!(broken_at(&bench, &[]).await, None);
}
