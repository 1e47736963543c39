//! Many processes over one Postgres: what they write in a second, how soon one hears of another, and a
//! thousand workers at a time. `FSYNC=on scripts/postgres.sh` starts a server that flushes to the disk;
//! `make bench-cluster MINUTES=10` takes as long as it says, and two minutes more.
//!
//! A process is a store of its own, with connections of its own, as those of nodes and workers are. Prints
//! Markdown tables.
#![expect(clippy::unwrap_used, reason = "a benchmark fails by panicking")]
#![expect(clippy::print_stdout, reason = "the tables are the output")]

#[path = "../store/made.rs"]
mod made;

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use futures_util::future::join_all;
use made::{LONG, rate};
use meshway::identity::Caller;
use meshway::jobs::{Claim, Lease, Options, Store};

/// Processes, and clients in all of them.
const PROCESSES: [usize; 4] = [1, 4, 16, 48];
const CLIENTS: usize = 64;

/// Length of a lease that does not end here, in milliseconds.
const LEASE_MS: i64 = 3_600_000;

/// Workers of the long run, and the processes that they are in.
const WORKERS: usize = 1_000;
const THEIR_PROCESSES: usize = 48;

#[tokio::main]
#[expect(
    clippy::disallowed_methods,
    reason = "a benchmark is told by the environment"
)]
async fn main() {
    let server = std::env::var("MESHWAY_TEST_DATABASE").expect("run it by scripts/postgres.sh");
    let minutes = std::env::var("MINUTES").map_or(1, |text| text.parse().unwrap());
    println!("| processes | clients | submits/s | claims/s | records/s | renewals/s |");
    println!("|---|---|---|---|---|---|");
    for processes in PROCESSES {
        rates(&server, processes).await;
    }
    println!("\n| records/s | an event is seen by another process after: p50 | p99 | most |");
    println!("|---|---|---|---|");
    for rate in [10, 100, 500] {
        latency(&server, rate).await;
    }
    workers(&server, Duration::from_secs(60 * minutes)).await;
}

/// Processes over a new database.
struct Processes {
    stores: Vec<Store>,
    _dir: tempfile::TempDir,
}

impl Processes {
    async fn new(server: &str, count: usize) -> Self {
        let database = made::new_database(server).await;
        let dir = tempfile::tempdir().unwrap();
        let mut stores = Vec::new();
        for _ in 0..count {
            let options = Options {
                queue_limit: u64::MAX,
                database: Some(database.clone()),
                ..Options::default()
            };
            stores.push(Store::open(dir.path(), options).await.unwrap());
        }
        Self { stores, _dir: dir }
    }

    fn of(&self, client: usize) -> &Store {
        &self.stores[client % self.stores.len()]
    }

    /// Puts so many jobs into the queue.
    async fn submit(&self, jobs: usize) {
        let us = Caller::anybody();
        let (cloud, _) = self
            .of(0)
            .by(&us)
            .insert_cloud(made::cloud())
            .await
            .unwrap();
        let submits = (0..jobs).map(|k| {
            let (us, cloud) = (&us, &cloud);
            async move {
                let new = made::job(&cloud.id);
                self.of(k).by(us).submit(new, None).await.unwrap();
            }
        });
        join_all(submits).await;
    }

    async fn close(self) {
        join_all(self.stores.iter().map(Store::close)).await;
    }
}

async fn rates(server: &str, count: usize) {
    let processes = Processes::new(server, count).await;
    let us = Caller::anybody();
    let cloud = made::cloud();
    let (cloud, _) = processes.of(0).by(&us).insert_cloud(cloud).await.unwrap();
    let submits = rate(CLIENTS, async |client| {
        let new = made::job(&cloud.id);
        let store = processes.of(client);
        store.by(&us).submit(new, None).await.unwrap();
    })
    .await;
    let waiting = AtomicU64::new(0);
    let claims = rate(CLIENTS, async |client| {
        let claimed = processes.of(client).claim("w", LEASE_MS).await.unwrap();
        if claimed.is_none() {
            waiting.fetch_add(1, Ordering::Relaxed);
            let new = made::job(&cloud.id);
            processes
                .of(client)
                .by(&us)
                .submit(new, None)
                .await
                .unwrap();
        }
    })
    .await;
    assert!(
        waiting.into_inner() < 64,
        "there were fewer jobs than claims"
    );
    let mut held = Vec::new();
    for client in 0..CLIENTS {
        let new = made::job(&cloud.id);
        let store = processes.of(client);
        store.by(&us).submit(new, None).await.unwrap();
        held.push(store.claim("w", LEASE_MS).await.unwrap().unwrap());
    }
    let evaluations = AtomicU64::new(1);
    let records = rate(CLIENTS, async |client| {
        let record = made::record(evaluations.fetch_add(1, Ordering::Relaxed));
        let store = processes.of(client);
        store.record(&held[client], record).await.unwrap();
    })
    .await;
    let renewals = rate(CLIENTS, async |client| {
        let renewal = processes
            .of(client)
            .renew(&held[client], LEASE_MS, Duration::ZERO);
        renewal.await.unwrap();
    })
    .await;
    processes.close().await;
    println!("| {count} | {CLIENTS} | {submits:.0} | {claims:.0} | {records:.0} | {renewals:.0} |");
}

/// How long it takes from the beginning of a worker's write to when a node has the event, which looks as
/// the source of its streams does.
async fn latency(server: &str, rate: u64) {
    let processes = Processes::new(server, 2).await;
    processes.submit(1).await;
    let [worker, node] = &processes.stores[..] else {
        unreachable!("there are two");
    };
    let claim = worker.claim("w", LEASE_MS).await.unwrap().unwrap();
    let mut changed = node.changed();
    let mut seq = node.last_seq_of_all().await.unwrap();
    let begun = Instant::now();
    let writing = async {
        let mut sent = Vec::new();
        let mut ticks = tokio::time::interval(Duration::from_secs(1) / rate as u32);
        while begun.elapsed() < 2 * LONG {
            ticks.tick().await;
            sent.push(begun.elapsed());
            let record = made::record(sent.len() as u64);
            worker.record(&claim, record).await.unwrap();
        }
        sent
    };
    let reading = async {
        let mut seen = Vec::new();
        while begun.elapsed() < 2 * LONG + Duration::from_secs(2) {
            let _ = tokio::time::timeout(Duration::from_secs(1), changed.changed()).await;
            let events = node.events_of_all(seq, 500).await.unwrap();
            seq = events.last().map_or(seq, |event| event.seq);
            let progress = events
                .iter()
                .filter(|event| event.kind.name() == "job.progress");
            seen.extend(progress.map(|_| begun.elapsed()));
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        seen
    };
    let (sent, seen) = tokio::join!(writing, reading);
    assert_eq!(sent.len(), seen.len(), "each is seen once");
    let mut delays: Vec<Duration> = sent
        .iter()
        .zip(&seen)
        .map(|(a, b)| b.saturating_sub(*a))
        .collect();
    delays.sort();
    let at = |share: f64| delays[((delays.len() - 1) as f64 * share) as usize].as_millis();
    let told = sent.len() as f64 / (2 * LONG).as_secs_f64();
    println!(
        "| {told:.0} | {} ms | {} ms | {} ms |",
        at(0.5),
        at(0.99),
        at(1.0)
    );
    processes.close().await;
}

/// What a worker of the long run saw.
#[derive(Default)]
struct Seen {
    writes: AtomicU64,
    late: AtomicU64,
    longest_ms: AtomicU64,
}

/// A thousand workers, each of which renews its lease every five seconds and writes progress every second.
async fn workers(server: &str, long: Duration) {
    let processes = Processes::new(server, THEIR_PROCESSES).await;
    processes.submit(WORKERS).await;
    let mut claims = Vec::new();
    for worker in 0..WORKERS {
        let claimed = processes
            .of(worker)
            .claim(&format!("w{worker}"), 30_000)
            .await;
        claims.push(claimed.unwrap().unwrap());
    }
    let (begun, seen) = (Instant::now(), Arc::new(Seen::default()));
    let work = claims.into_iter().enumerate().map(|(worker, claim)| {
        let (store, seen) = (processes.of(worker).clone(), Arc::clone(&seen));
        tokio::spawn(work_on(store, claim, seen, (begun, long), worker))
    });
    for ended in join_all(work.collect::<Vec<_>>()).await {
        ended.unwrap();
    }
    let (writes, seconds) = (
        seen.writes.load(Ordering::Relaxed),
        begun.elapsed().as_secs_f64(),
    );
    println!(
        "\n{WORKERS} workers in {THEIR_PROCESSES} processes for {seconds:.0} s: {:.0} writes/s of {:.0} wanted, \
         longest {} ms, {} of {writes} later than a second, no lease lost",
        writes as f64 / seconds,
        WORKERS as f64 * 1.2,
        seen.longest_ms.load(Ordering::Relaxed),
        seen.late.load(Ordering::Relaxed),
    );
    processes.close().await;
}

async fn work_on(
    store: Store,
    claim: Claim,
    seen: Arc<Seen>,
    (begun, long): (Instant, Duration),
    worker: usize,
) {
    // Not all at the same moment.
    tokio::time::sleep(Duration::from_millis(worker as u64 % 1_000)).await;
    let mut ticks = tokio::time::interval(Duration::from_secs(1));
    let mut beats = 0;
    while begun.elapsed() < long {
        ticks.tick().await;
        beats += 1;
        let asked = Instant::now();
        store.record(&claim, made::record(beats)).await.unwrap();
        note(&seen, asked);
        if beats % 5 == 0 {
            let asked = Instant::now();
            let lease = store.renew(&claim, 30_000, Duration::ZERO).await.unwrap();
            assert!(matches!(lease, Lease::Held { .. }), "{lease:?}");
            note(&seen, asked);
        }
    }
}

fn note(seen: &Seen, asked: Instant) {
    let ms = asked.elapsed().as_millis() as u64;
    seen.writes.fetch_add(1, Ordering::Relaxed);
    seen.late
        .fetch_add(u64::from(ms > 1_000), Ordering::Relaxed);
    seen.longest_ms.fetch_max(ms, Ordering::Relaxed);
}
