//! Whose job is next.

use std::time::Duration;

use meshway::identity::{Caller, Tenant};
use meshway::jobs::{
    FailureReason, Job, JobId, KeepChange, NewJob, Options, Place, Problem, Store,
};
use serde_json::json;
use sqlx::Connection;

use crate::store::migrations::{TENTH, database};
use super::support::{Bench, LEASE_MS, new_cloud};
use crate::who::ours;

fn of(tenant: &str) -> Caller {
    Caller {
        tenant: tenant.parse().unwrap(),
        ..Caller::anybody()
    }
}

async fn submit(bench: &Bench, caller: &Caller, seconds: f64, priority: i64) -> Job {
    let acts = bench.store.by(caller);
    let (cloud, _) = acts.insert_cloud(new_cloud("a")).await.unwrap();
    let new = NewJob {
        cloud_id: cloud.id,
        cost_seconds: seconds,
        priority,
        ..bench.new_job()
    };
    let job = bench.store.by(caller).submit(new, None).await.unwrap();
    bench.pass(1);
    job
}

async fn place(bench: &Bench, caller: &Caller, id: &JobId) -> Place {
    let place = bench.store.of(&caller.tenant).place(id).await.unwrap();
    place.unwrap()
}

/// Claims the next job and ends it; gives its id and tenant.
async fn run_one(store: &Store) -> (JobId, Tenant) {
    let claim = store.claim("w", LEASE_MS).await.unwrap().unwrap();
    let ended = Problem::new("no_surface", "none");
    store.fail(&claim, ended).await.unwrap();
    (claim.job.id, claim.job.tenant)
}

#[tokio::test]
async fn a_short_job_waits_for_one_of_a_hundred_long_ones_of_others() {
    let bench = Bench::new().await;
    let (many, few) = (of("many"), of("few"));
    for _ in 0..100 {
        submit(&bench, &many, 600.0, 9).await;
    }
    let running = bench.claim().await;
    let short = submit(&bench, &few, 0.5, 0).await;
    let seen = place(&bench, &few, &short.id).await;
    assert_eq!((seen.position, seen.before_ms), (1, 600_000));
    let eta = |workers| seen.eta_seconds(workers);
    assert_eq!((eta(1), eta(2)), (600.5, 300.5));
    bench
        .store
        .fail(&running, Problem::new("no_surface", "none"))
        .await
        .unwrap();
    assert_eq!(run_one(&bench.store).await.0, short.id);
    // Also when nothing was claimed before.
    let first = run_one(&bench.store).await;
    let again = submit(&bench, &few, 0.5, 0).await;
    assert_eq!(first.1, many.tenant);
    assert_eq!(run_one(&bench.store).await.0, again.id);
}

#[tokio::test]
async fn tenants_get_the_same_work_and_not_the_same_number_of_jobs() {
    let bench = Bench::new().await;
    for _ in 0..6 {
        submit(&bench, &of("long"), 10.0, 0).await;
    }
    for _ in 0..60 {
        submit(&bench, &of("short"), 1.0, 0).await;
    }
    let mut done = [0, 0];
    for _ in 0..33 {
        let (_, tenant) = run_one(&bench.store).await;
        done[usize::from(tenant.as_str() == "short")] += 1;
    }
    assert_eq!(done, [3, 30]);
}

#[tokio::test]
async fn nobody_saves_turns_up_and_nobody_pays_for_what_is_long_ago() {
    let bench = Bench::new().await;
    let (idle, busy) = (of("idle"), of("busy"));
    for _ in 0..50 {
        submit(&bench, &busy, 100.0, 0).await;
    }
    for _ in 0..40 {
        run_one(&bench.store).await;
    }
    for _ in 0..20 {
        submit(&bench, &idle, 100.0, 0).await;
    }
    let mut turns = Vec::new();
    for _ in 0..20 {
        turns.push(run_one(&bench.store).await.1);
    }
    let own = turns.iter().filter(|turn| **turn == idle.tenant).count();
    assert!((10..=11).contains(&own), "{turns:?}");
}

#[tokio::test]
async fn priorities_order_the_jobs_of_a_tenant_and_give_nothing_over_others() {
    let bench = Bench::new().await;
    let (ours, theirs) = (of("a"), of("b"));
    let low = submit(&bench, &ours, 1.0, -9).await;
    let plain = submit(&bench, &ours, 1.0, 0).await;
    let first_of_theirs = submit(&bench, &theirs, 1.0, 0).await;
    let urgent = submit(&bench, &ours, 1.0, 9).await;
    let second_of_theirs = submit(&bench, &theirs, 1.0, 0).await;
    assert_eq!(urgent.priority, 9);
    let mut order = Vec::new();
    for _ in 0..5 {
        order.push(run_one(&bench.store).await.0);
    }
    let expected = [&first_of_theirs, &urgent, &plain, &second_of_theirs, &low];
    assert_eq!(
        order.iter().collect::<Vec<_>>(),
        expected.map(|job| &job.id)
    );
}

#[tokio::test]
async fn places_are_the_order_in_which_jobs_are_claimed() {
    let bench = Bench::new().await;
    let callers = ["a", "b", "c"].map(of);
    // Digits of a number without a pattern.
    let digits = "3141592653589793238462643383279502884197169399375105820974944592";
    let digits: Vec<i64> = digits.bytes().map(|b| i64::from(b - b'0')).collect();
    for (i, step) in digits.windows(3).enumerate() {
        let caller = &callers[step[0] as usize % 3];
        let job = submit(&bench, caller, 0.5 + step[1] as f64, step[2] % 3).await;
        if i % 4 == 3 {
            run_one(&bench.store).await;
        }
        if i % 8 == 1 {
            let claim = bench.claim().await;
            bench.store.release(&claim).await.unwrap();
        }
        if i % 8 == 5 {
            let priority = Some(step[0] % 3);
            let change = KeepChange {
                priority,
                ..KeepChange::default()
            };
            let acts = bench.store.by(caller);
            acts.keep_job(&job.id, change).await.unwrap();
        }
    }
    let mut places = Vec::new();
    for caller in &callers {
        let records = bench.store.of(&caller.tenant);
        for (id, listed) in records.places().await.unwrap() {
            assert_eq!(place(&bench, caller, &id).await, listed);
            places.push((listed.position, id));
        }
    }
    places.sort();
    let numbers: Vec<u64> = places.iter().map(|(position, _)| *position).collect();
    assert_eq!(numbers, (1..=places.len() as u64).collect::<Vec<_>>());
    for (_, id) in places {
        assert_eq!(run_one(&bench.store).await.0, id);
    }
}

#[tokio::test]
async fn what_was_given_back_goes_first_and_what_failed_waits_for_a_turn() {
    let bench = Bench::new().await;
    let (ours, theirs) = (of("a"), of("b"));
    let first = submit(&bench, &ours, 5.0, 0).await;
    let other = submit(&bench, &theirs, 5.0, 0).await;
    let claim = bench.claim().await;
    bench.store.release(&claim).await.unwrap();
    let claim = bench.claim().await;
    assert_eq!(claim.job.id, first.id);
    let crash = FailureReason::LeaseExpired;
    let failed = bench.store.attempt_failed(&first.id, claim.attempt, crash);
    failed.await.unwrap();
    assert_eq!(bench.claim().await.job.id, other.id);
}

#[tokio::test]
async fn worked_time_is_counted_once_for_whom_it_was_done() {
    let bench = Bench::new().await;
    let job = submit(&bench, &of("a"), 5.0, 0).await;
    let claim = bench.claim().await;
    for _ in 0..3 {
        bench.pass(2_000);
        let renewal = bench.store.renew(&claim, LEASE_MS, Duration::ZERO);
        renewal.await.unwrap();
    }
    bench.pass(500);
    bench.store.release(&claim).await.unwrap();
    bench.pass(70_000);
    // The first attempt has no say any more.
    let second = bench.claim().await;
    bench.pass(1_000);
    drop(bench.store.renew(&claim, LEASE_MS, Duration::ZERO).await);
    bench.store.cancelled(&second).await.unwrap();
    bench.store.by(&of("a")).delete_job(&job.id).await.unwrap();
    let rows = "SELECT tenant || '/' || account || '/' || ms FROM compute";
    assert_eq!(bench.bare().await.texts(rows).await, ["a//7500"]);
}

#[tokio::test]
async fn jobs_from_before_turns_are_claimed_in_their_order() {
    let folder = tempfile::tempdir().unwrap();
    let mut db = database(folder.path(), TENTH).await;
    let settings = meshway::reconstruction::Preset::Fast.settings();
    let ids = [JobId::at(0), JobId::at(0)];
    for (at, id) in (1..).zip(&ids) {
        sqlx::query(
            "INSERT INTO jobs (id, cloud_id, status, preset, settings, labels, created_at, events)
             VALUES (?1, 'cld_019a9f3b2c5d7e8f9a0b1c2d3e4f5a6b', 'queued', 'fast', ?2, '{}', ?3, 1)",
        )
        .bind(id.as_str())
        .bind(json!(settings).to_string())
        .bind(at)
        .execute(&mut db)
        .await
        .unwrap();
    }
    db.close().await.unwrap();
    let store = Store::open(folder.path(), Options::default())
        .await
        .unwrap();
    let places = store.of(ours()).places().await.unwrap();
    assert_eq!((places[&ids[0]].position, places[&ids[1]].position), (1, 2));
    for id in &ids {
        let place = store.of(ours()).place(id).await.unwrap();
        assert_eq!(place, Some(places[id]));
    }
    for id in &ids {
        let claim = store.claim("w", LEASE_MS).await.unwrap().unwrap();
        assert_eq!((&claim.job.id, claim.job.priority), (id, 0));
    }
}
