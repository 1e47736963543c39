//! Everything dies, again and again, and nothing is lost: two nodes and two machines with workers over one
//! database and one object store, each of which is killed at any moment and started again.
//!
//! `MESHWAY_STORM_KILLS` says how often (`make storm`); without it some times are enough.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use meshway::jobs::{JobFilter, Options, Store};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tokio_util::sync::CancellationToken;

use crate::cluster::{Cluster, Node};
use crate::http::support::sphere_xyz;
use crate::postgres::Postgres;
use crate::s3::S3;
use crate::server::{PATIENCE, until};
use crate::store::bare;
use crate::who::us;
use crate::wire::Connection;

/// Kills where nobody says how many.
const KILLS: u32 = 14;

/// Jobs that are open at most: else the queue grows faster than jobs end.
const OPEN: usize = 12;

/// Where the nodes are that answer; they move when they start again.
#[derive(Clone, Default)]
struct Addresses(Arc<Mutex<Vec<SocketAddr>>>);

impl Addresses {
    fn set(&self, node: usize, address: SocketAddr) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() <= node {
            all.resize(node + 1, address);
        }
        all[node] = address;
    }

    fn of(&self, k: usize) -> SocketAddr {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all[k % all.len()]
    }
}

/// What was answered with 202, with the number of the request.
type Taken = Arc<Mutex<BTreeMap<usize, String>>>;

/// Asks one node and then the other until one does it.
async fn insist(
    addresses: &Addresses,
    k: usize,
    (line, headers): (&str, &str),
    body: &[u8],
) -> Value {
    for asked in k.. {
        let sent = async {
            let mut client = Connection::open(addresses.of(asked)).await?;
            client.ask(line, headers, &[body]).await
        };
        match tokio::time::timeout(Duration::from_secs(20), sent).await {
            Ok(Ok(answer)) if (200..300).contains(&answer.status) => return answer.json(),
            // 409: the first request with the key is under way, or died with its node a moment ago.
            Ok(Ok(answer)) => {
                assert!(
                    [409, 429, 503, 507].contains(&answer.status),
                    "{line}: {}",
                    answer.json()
                );
            }
            Ok(Err(_)) | Err(_) => {}
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    unreachable!("there is always another try")
}

/// Submits real jobs, each with a cloud of its own and under a key of its own.
async fn submit(addresses: Addresses, taken: Taken, end: CancellationToken) {
    let mut k = 0;
    while !end.is_cancelled() {
        let points = sphere_xyz(300, 1e-3 * k as f64).into_bytes();
        let cloud = insist(&addresses, k, ("POST /v1/clouds", ""), &points).await;
        let body = json!({
            "cloud_id": cloud["id"],
            "preset": "fast",
            "settings": {"training": {"max_evaluations": 60}, "surface": {"resolution": 32}},
        });
        let headers = format!("Content-Type: application/json\r\nIdempotency-Key: storm-{k}\r\n");
        let asked = ("POST /v1/jobs", headers.as_str());
        let job = insist(&addresses, k + 1, asked, body.to_string().as_bytes()).await;
        taken
            .lock()
            .unwrap()
            .insert(k, job["id"].as_str().unwrap().to_owned());
        k += 1;
        while !end.is_cancelled()
            && open_jobs(addresses.of(k))
                .await
                .is_none_or(|open| open >= OPEN)
        {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }
}

async fn open_jobs(address: SocketAddr) -> Option<usize> {
    let mut client = Connection::open(address).await.ok()?;
    let mut open = 0;
    for status in ["queued", "running"] {
        let line = format!("GET /v1/jobs?status={status}");
        let answer = client.ask(&line, "", &[]).await.ok()?;
        if answer.status != 200 {
            return None;
        }
        open += answer.json()["items"].as_array()?.len();
    }
    Some(open)
}

/// Follows the events of all jobs over the deaths of nodes, going on at the other one behind the last that
/// was seen; gives how many each job had.
async fn follow(addresses: Addresses, end: CancellationToken) -> BTreeMap<String, usize> {
    let (mut seen, mut last, mut k) = (BTreeMap::<_, usize>::new(), 0_i64, 0);
    while !end.is_cancelled() {
        k += 1;
        let read = async {
            let mut client = Connection::open(addresses.of(k)).await?;
            let head = format!("Last-Event-ID: {last}\r\n");
            client.send("GET /v1/events", &head, &[]).await?;
            client.read_head().await?;
            let mut place = last;
            loop {
                let line = client.read_line().await?;
                if let Some(text) = line.strip_prefix("id: ") {
                    place = text.parse().unwrap();
                }
                if let Some(text) = line.strip_prefix("data: ") {
                    let data: Value = serde_json::from_str(text).unwrap();
                    let job = data["job_id"].as_str().unwrap().to_owned();
                    assert!(place > last, "{place} after {last}");
                    last = place;
                    *seen.entry(job).or_default() += 1;
                }
            }
        };
        let ended: std::io::Result<()> = tokio::select! {
            ended = read => ended,
            () = end.cancelled() => break,
        };
        drop(ended);
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    seen
}

/// A process of the cluster, which is killed and started again.
struct Party<'c> {
    cluster: &'c Cluster,
    name: String,
    node: Option<Node>,
    starts: u32,
}

impl<'c> Party<'c> {
    async fn new(cluster: &'c Cluster, name: &str) -> Self {
        let mut party = Self {
            cluster,
            name: name.to_owned(),
            node: None,
            starts: 0,
        };
        party.start().await;
        party
    }

    async fn start(&mut self) {
        self.starts += 1;
        let log = format!("{}.{}", self.name, self.starts);
        let node = if self.name.starts_with("node") {
            self.cluster
                .serve_in(&self.name, &log, &["--workers=0"])
                .await
        } else {
            self.cluster
                .worker_in(&self.name, &log, &["--slots=1", "--checkpoint-seconds=1"])
                .await
        };
        self.node = Some(node);
    }

    /// Kills it, or one of its children where it has some.
    async fn kill(&mut self, random: &mut ChaCha8Rng) {
        let pid = self.node.as_ref().unwrap().server.pid();
        let children = children(pid);
        if !children.is_empty() && random.random_bool(0.5) {
            let child = children[random.random_range(0..children.len())];
            // It may have ended by itself.
            let _ = kill_process(child, Signal::KILL);
            return;
        }
        // Children notice the end of their input, unless they die with it.
        kill_process(pid, Signal::KILL).unwrap();
        if random.random_bool(0.5) {
            for child in children {
                let _ = kill_process(child, Signal::KILL);
            }
        }
        self.node = None;
        self.start().await;
    }
}

fn children(pid: Pid) -> Vec<Pid> {
    let pid = pid.as_raw_nonzero();
    let listed = std::fs::read_to_string(format!("/proc/{pid}/task/{pid}/children"));
    let listed = listed.unwrap_or_default();
    let pids = listed
        .split_whitespace()
        .map(|child| child.parse().unwrap());
    pids.filter_map(Pid::from_raw).collect()
}

#[expect(
    clippy::disallowed_methods,
    reason = "a test is told by the environment how long it is"
)]
fn kills() -> u32 {
    let told = std::env::var("MESHWAY_STORM_KILLS").ok();
    told.map_or(KILLS, |kills| kills.parse().unwrap())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
#[expect(clippy::print_stderr, reason = "a long storm says how far it is")]
async fn everything_dies_and_nothing_is_lost() {
    if bare::server().is_none() {
        return;
    }
    let Some(mut s3) = S3::start().await else {
        return;
    };
    let postgres = Postgres::new();
    let cluster = Cluster {
        database: postgres.url.clone(),
        bucket: s3.bucket(),
        dir: tempfile::tempdir().unwrap(),
    };
    let mut parties = Vec::new();
    for name in ["node-1", "node-2", "worker-1", "worker-2"] {
        parties.push(Party::new(&cluster, name).await);
    }
    let addresses = Addresses::default();
    let tell = |parties: &[Party]| {
        for (k, party) in parties[..2].iter().enumerate() {
            addresses.set(k, party.node.as_ref().unwrap().address());
        }
    };
    tell(&parties);
    let (taken, end, ended) = (
        Taken::default(),
        CancellationToken::new(),
        CancellationToken::new(),
    );
    let submitting = tokio::spawn(submit(addresses.clone(), Arc::clone(&taken), end.clone()));
    let following = tokio::spawn(follow(addresses.clone(), ended.clone()));

    let mut random = ChaCha8Rng::seed_from_u64(7);
    for kill in 0..kills() {
        tokio::time::sleep(Duration::from_millis(random.random_range(50..2_000))).await;
        strike(&postgres, &mut s3, &mut parties, &mut random).await;
        tell(&parties);
        if kill % 50 == 49 {
            eprintln!("{} kills, {} jobs", kill + 1, taken.lock().unwrap().len());
        }
    }
    end.cancel();
    submitting.await.unwrap();
    until("all jobs end", 10 * PATIENCE, async || {
        (open_jobs(addresses.of(0)).await? == 0).then_some(())
    })
    .await;
    // The last event is read.
    tokio::time::sleep(Duration::from_secs(3)).await;
    ended.cancel();
    let seen = following.await.unwrap();

    let jobs: Vec<String> = taken.lock().unwrap().values().cloned().collect();
    let names: BTreeSet<&String> = jobs.iter().collect();
    assert_eq!(names.len(), jobs.len());
    judge(parties[0].node.as_ref().unwrap(), &jobs, &seen).await;
    drop(parties);
    erase(&cluster, jobs.len()).await;
}

/// Kills somebody, or all of them, and has them start again.
async fn strike(
    postgres: &Postgres,
    s3: &mut S3,
    parties: &mut [Party<'_>],
    random: &mut ChaCha8Rng,
) {
    match random.random_range(0..8) {
        0 => {
            postgres.kill();
            postgres.revive().await;
        }
        1 => {
            s3.kill();
            tokio::time::sleep(Duration::from_millis(random.random_range(0..3_000))).await;
            s3.restart().await;
        }
        2 => {
            postgres.kill();
            s3.kill();
            s3.restart().await;
            postgres.revive().await;
            for party in parties {
                party.kill(random).await;
            }
        }
        _ => {
            let victim = random.random_range(0..parties.len());
            parties[victim].kill(random).await;
        }
    }
}

/// Each job ended once, its events have no gap, were seen so on the way, and its mesh is there.
#[expect(clippy::print_stderr, reason = "a storm says how it ended")]
async fn judge(node: &Node, jobs: &[String], seen: &BTreeMap<String, usize>) {
    let (mut succeeded, mut failed) = (0, 0);
    for id in jobs {
        let job = node.get(&format!("/v1/jobs/{id}")).await;
        let mut stream = node.stream(&format!("/v1/jobs/{id}/events"), None).await;
        let kind = format!("job.{}", job["status"].as_str().unwrap());
        let ids = stream.until(&kind).await;
        let all: Vec<i64> = (1..=ids.len() as i64).collect();
        assert_eq!(ids, all, "{id}");
        assert_eq!(
            seen.get(id),
            Some(&all.len()),
            "{id} as it was seen on the way"
        );
        if kind == "job.succeeded" {
            succeeded += 1;
            let mesh = node
                .ask(&format!("GET /v1/jobs/{id}/mesh.ply"), "", &[])
                .await;
            assert_eq!(mesh.status, 200, "{id}");
        } else {
            // Three of its workers were killed.
            failed += 1;
            assert_eq!(job["failures"], json!(3), "{job}");
        }
    }
    eprintln!("{succeeded} jobs succeeded, {failed} lost three workers");
    assert!(succeeded > 0);
}

/// All is erased, and with it all objects; no job is there that nobody asked for.
async fn erase(cluster: &Cluster, jobs: usize) {
    let options = Options {
        database: Some(cluster.database.clone()),
        objects: Some(cluster.bucket.url()),
        garbage_age: Duration::ZERO,
        ..Options::default()
    };
    let folder = cluster.dir.path().join("last");
    std::fs::create_dir(&folder).unwrap();
    let store = Store::open(&folder, options).await.unwrap();
    let records = store.of(&us().tenant);
    let listed = records
        .list_jobs(&JobFilter::default(), None, 100_000)
        .await
        .unwrap();
    assert_eq!(listed.len(), jobs);
    for job in listed {
        store.by(us()).delete_job(&job.id).await.unwrap();
        store.by(us()).delete_cloud(&job.cloud_id).await.unwrap();
    }
    store.collect_garbage(None).await.unwrap();
    until("no object is left", PATIENCE, async || {
        cluster.bucket.keys().is_empty().then_some(())
    })
    .await;
    store.close().await;
}
