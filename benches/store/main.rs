//! What the store writes in a second, alone and with many at a time: on `SQLite`, and on Postgres where
//! `MESHWAY_TEST_DATABASE` names a server. `scripts/postgres.sh` starts one, which flushes nothing to the
//! disk unless `FSYNC=on`.
//!
//! Prints a Markdown table. Takes about a minute.
#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]

mod made;

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use made::{cloud, job, new_database, rate, record};
use meshway::identity::Caller;
use meshway::jobs::{Claim, Options, Store};

/// Clients at a time.
const CLIENTS: [usize; 3] = [1, 16, 64];

/// Length of a lease that does not end here, in milliseconds.
const LEASE_MS: i64 = 3_600_000;

#[tokio::main]
#[expect(
    clippy::disallowed_methods,
    reason = "a benchmark is told of its server by the environment"
)]
#[expect(clippy::print_stdout, reason = "the table is the output")]
async fn main() {
    println!("| rows in | clients | submits/s | records/s | renewals/s |\n|---|---|---|---|---|");
    for clients in CLIENTS {
        row("SQLite", clients, None).await;
    }
    if let Ok(server) = std::env::var("MESHWAY_TEST_DATABASE") {
        for clients in CLIENTS {
            let database = new_database(&server).await;
            row("Postgres", clients, Some(database)).await;
        }
    }
}

#[expect(clippy::print_stdout, reason = "the table is the output")]
async fn row(name: &str, clients: usize, database: Option<String>) {
    let dir = tempfile::tempdir().unwrap();
    let options = Options {
        queue_limit: u64::MAX,
        database,
        ..Options::default()
    };
    let store = Store::open(dir.path(), options).await.unwrap();
    let us = Caller::anybody();
    let (cloud, _) = store.by(&us).insert_cloud(cloud()).await.unwrap();
    let submits = rate(clients, async |_| {
        let new = job(&cloud.id);
        store.by(&us).submit(new, None).await.unwrap();
    })
    .await;
    let mut claims: Vec<Claim> = Vec::new();
    for _ in 0..clients {
        claims.push(store.claim("w", LEASE_MS).await.unwrap().unwrap());
    }
    let evaluations = AtomicU64::new(1);
    let records = rate(clients, async |client| {
        let evaluation = evaluations.fetch_add(1, Ordering::Relaxed);
        let record = record(evaluation);
        store.record(&claims[client], record).await.unwrap();
    })
    .await;
    let renewals = rate(clients, async |client| {
        let renewal = store.renew(&claims[client], LEASE_MS, Duration::ZERO);
        renewal.await.unwrap();
    })
    .await;
    store.close().await;
    println!("| {name} | {clients} | {submits:.0} | {records:.0} | {renewals:.0} |");
}
