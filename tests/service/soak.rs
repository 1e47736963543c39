//! A long run under random faults: no accepted job may be lost, and none may end twice.
//!
//! Clients submit over HTTP, and repeat what was not answered with the same key, while workers and
//! servers are killed and stopped, and jobs cancelled and erased. Then everything is counted.
//! `make soak` runs it; `MESHWAY_SOAK_MINUTES` says how long, `MESHWAY_SOAK_SEED` repeats the
//! choices (not their timing).

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::str::FromStr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use meshway::jobs::{Job, JobFilter, JobId, Lookup, Status};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use tokio::sync::watch;
use tokio::task::JoinSet;
use tokio::time::timeout;

use crate::server::{Folder, Server, until};
use crate::who::ours;
use crate::wire::{Answer, Connection};

/// What workers do while one server lives; half of the time they reconstruct.
const SCRIPTS: [Option<&str>; 10] = [
    None,
    None,
    None,
    None,
    None,
    Some("--script=instant"),
    Some("--script=sleep:0.5"),
    Some("--script=sleep:4"),
    Some("--script=fail:no_surface"),
    Some("--script=exit"),
];
const WORKERS: usize = 2;
const CLIENTS: u64 = 3;
/// Clients wait while so many jobs do, so that the end comes soon after the last submit.
const QUEUE: u64 = 12;
const SUBMIT_PAUSE: Duration = Duration::from_millis(150);
/// A request that takes longer is given up and repeated: its server is stopped or dead.
const ANSWER: Duration = Duration::from_secs(5);
/// How long the jobs that are left may take when the faults are over.
const DRAIN: Duration = Duration::from_mins(3);

/// What is known of the jobs, from answers of servers alone.
#[derive(Default)]
struct Book {
    /// By the number that their client gave them.
    accepted: BTreeMap<u64, JobId>,
    cancel_asked: BTreeSet<JobId>,
    erase_asked: BTreeSet<JobId>,
    erased: BTreeSet<JobId>,
}

/// The service under test, as its clients and its saboteur see it.
#[derive(Clone)]
struct Site {
    folder: Arc<Folder>,
    /// Where the server of the moment listens.
    address: watch::Sender<SocketAddr>,
    book: Arc<Mutex<Book>>,
}

impl Site {
    fn book(&self) -> std::sync::MutexGuard<'_, Book> {
        self.book.lock().unwrap()
    }

    /// The answer to a request, if there is one.
    async fn ask(&self, line: &str, headers: &str, body: &Value) -> Option<Answer> {
        let address = *self.address.borrow();
        let exchange = async {
            let mut connection = Connection::open(address).await?;
            match line.strip_prefix("POST ") {
                Some(path) if !body.is_null() => connection.post(path, headers, body).await,
                _ => connection.ask(line, headers, &[]).await,
            }
        };
        timeout(ANSWER, exchange).await.ok()?.ok()
    }

    /// Submits one job after the other until the faults are over, each until it is accepted.
    async fn submit(self, client: u64, over: watch::Receiver<bool>) {
        let mut number = client;
        while !*over.borrow() {
            let counts = self.folder.store.counts().await.unwrap();
            if counts.get(Status::Queued) >= QUEUE {
                tokio::time::sleep(Duration::from_millis(200)).await;
                continue;
            }
            let body = json!({
                "cloud_id": self.folder.cloud_id(),
                "preset": "fast",
                "settings": {
                    "training": {"max_evaluations": 60},
                    "surface": {"resolution": 24},
                },
                "labels": {"number": number.to_string()},
            });
            let key = format!("Idempotency-Key: soak-{number}\r\n");
            // Also when the faults are over: a job that may have been accepted has to be known.
            let id = loop {
                match self.ask("POST /v1/jobs", &key, &body).await {
                    Some(answer) if answer.status == 202 => break id_of(&answer.json()),
                    // In flight, draining or busy: each passes.
                    Some(answer) => assert!(
                        matches!(answer.status, 409 | 503),
                        "{} {}",
                        answer.status,
                        answer.json()
                    ),
                    None => {}
                }
                tokio::time::sleep(Duration::from_millis(200)).await;
            };
            self.book().accepted.insert(number, id);
            number += CLIENTS;
            // Jobs that fail at once would crowd out the others.
            tokio::time::sleep(SUBMIT_PAUSE).await;
        }
    }

    /// Cancels or erases a job.
    async fn stop(&self, id: JobId, erase: bool) {
        if erase {
            self.book().erase_asked.insert(id.clone());
            let line = format!("DELETE /v1/jobs/{id}");
            let answer = self.ask(&line, "", &Value::Null).await;
            match answer.map(|answer| answer.status) {
                Some(204) => drop(self.book().erased.insert(id)),
                // 410: an erasure before that was not answered.
                status => assert!(matches!(status, None | Some(410 | 503)), "{status:?}"),
            }
        } else {
            self.book().cancel_asked.insert(id.clone());
            let line = format!("POST /v1/jobs/{id}/cancel");
            let status = self.ask(&line, "", &Value::Null).await.map(|a| a.status);
            let fits = matches!(status, None | Some(200 | 202 | 410 | 503));
            assert!(fits, "{status:?}");
        }
    }

    async fn serve(&self, script: Option<&str>) -> Server {
        let workers = format!("--workers={WORKERS}");
        let mut flags = vec![workers.as_str(), "--checkpoint-seconds=1"];
        flags.extend(script);
        let server = self.folder.serve(&flags).await;
        self.address.send_replace(server.address());
        server
    }
}

/// Does something bad every now and then. `resumed` keeps what wakes stopped processes.
struct Saboteur {
    site: Site,
    random: ChaCha8Rng,
    resumed: JoinSet<()>,
    done: BTreeMap<&'static str, u32>,
}

impl Saboteur {
    async fn work(&mut self, end: Instant) {
        while Instant::now() < end {
            let script = SCRIPTS[self.random.random_range(0..SCRIPTS.len())];
            let mut server = Some(self.site.serve(script).await);
            let life = Duration::from_secs(self.random.random_range(5..25));
            let end = end.min(Instant::now() + life);
            while let Some(running) = server.as_ref().filter(|_| Instant::now() < end) {
                let pause = self.random.random_range(100..1_500);
                tokio::time::sleep(Duration::from_millis(pause)).await;
                let kill = self.strike(running).await;
                server.take_if(|_| kill);
            }
            // One that was not killed is asked to end.
            if let Some(server) = server {
                self.count("ends of a server by SIGTERM");
                let status = server.terminate().await;
                assert!(status.success());
            }
        }
    }

    /// One fault; true when the server is to be killed.
    async fn strike(&mut self, server: &Server) -> bool {
        let mut workers = self.site.folder.processes();
        workers.retain(|process| *process != server.pid());
        let worker =
            (!workers.is_empty()).then(|| workers[self.random.random_range(0..workers.len())]);
        match (self.random.random_range(0..20), worker) {
            (0..=4, Some(worker)) => {
                self.count("kills of a worker");
                signal(worker, Signal::KILL);
            }
            (5..=6, Some(worker)) => {
                self.count("stops of a worker");
                // The lease is 6 s: some wake before it ends, some after.
                self.stop_for(worker, 200, 9_000);
            }
            (7, _) => {
                self.count("stops of the server");
                self.stop_for(server.pid(), 200, 8_000);
            }
            (8, _) => {
                self.count("kills of the server");
                return true;
            }
            (9, _) => {
                self.count("kills of the server and its workers");
                for worker in workers {
                    signal(worker, Signal::KILL);
                }
                return true;
            }
            (10..=14, _) => {
                let erase = self.random.random_bool(0.4);
                let jobs: Vec<JobId> = self.site.book().accepted.values().cloned().collect();
                // Mostly among the newest, which wait or run.
                let newest = jobs.len().min(2 * QUEUE as usize);
                if newest > 0 {
                    self.count(if erase { "erasures" } else { "cancels" });
                    let job = jobs[jobs.len() - 1 - self.random.random_range(0..newest)].clone();
                    self.site.stop(job, erase).await;
                }
            }
            _ => {}
        }
        false
    }

    /// Stops a process for a random time of these milliseconds.
    fn stop_for(&mut self, pid: Pid, shortest: u64, longest: u64) {
        let time = Duration::from_millis(self.random.random_range(shortest..longest));
        signal(pid, Signal::STOP);
        self.resumed.spawn(async move {
            tokio::time::sleep(time).await;
            signal(pid, Signal::CONT);
        });
    }

    fn count(&mut self, what: &'static str) {
        *self.done.entry(what).or_default() += 1;
    }
}

/// A process that has ended meanwhile gets no signal.
fn signal(pid: Pid, signal: Signal) {
    kill_process(pid, signal).ok();
}

fn id_of(answer: &Value) -> JobId {
    JobId::from_str(answer["id"].as_str().unwrap()).unwrap()
}

fn number(name: &str) -> Option<f64> {
    std::env::var_os(name)?.to_str()?.parse().ok()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "runs for minutes; make soak"]
#[expect(clippy::print_stdout, reason = "a long run says what it did")]
async fn no_job_is_lost_under_random_faults() {
    let minutes = number("MESHWAY_SOAK_MINUTES").unwrap_or(1.0);
    let clock = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let seed = number("MESHWAY_SOAK_SEED").map_or(clock.subsec_nanos().into(), |seed| seed as u64);
    println!("soak: {minutes} minutes, seed {seed}");
    let site = Site {
        folder: Arc::new(Folder::new().await),
        address: watch::channel(SocketAddr::from(([127, 0, 0, 1], 1))).0,
        book: Arc::default(),
    };
    let (over, hears) = watch::channel(false);
    let mut clients = JoinSet::new();
    for client in 0..CLIENTS {
        clients.spawn(site.clone().submit(client, hears.clone()));
    }
    let mut saboteur = Saboteur {
        site: site.clone(),
        random: ChaCha8Rng::seed_from_u64(seed),
        resumed: JoinSet::new(),
        done: BTreeMap::new(),
    };
    let end = Instant::now() + Duration::from_secs_f64(60.0 * minutes);
    saboteur.work(end).await;

    let server = site.serve(None).await;
    over.send_replace(true);
    timeout(DRAIN, clients.join_all())
        .await
        .expect("all submits are answered");
    saboteur.resumed.join_all().await;
    until("all jobs end", DRAIN, async || {
        let counts = site.folder.store.counts().await.unwrap();
        (counts.get(Status::Queued) + counts.get(Status::Running) == 0).then_some(())
    })
    .await;
    let ends = audit(&site).await;
    println!("soak: faults {:?}", saboteur.done);
    println!("soak: {} jobs, {ends:?}", site.book().accepted.len());

    let status = server.terminate().await;
    assert!(status.success());
    until("all processes end", DRAIN, async || {
        site.folder.processes().is_empty().then_some(())
    })
    .await;
}

/// Holds what is in the database against what was answered; gives the jobs by their end.
async fn audit(site: &Site) -> BTreeMap<String, u32> {
    let book = std::mem::take(&mut *site.book());
    let mut ends = BTreeMap::new();
    for (number, id) in &book.accepted {
        let end = match site.folder.store.of(ours()).job(id).await.unwrap() {
            Lookup::Found(job) => {
                assert!(!book.erased.contains(id), "{job:?} was erased");
                check(site, &book, &job).await;
                job.status.name().to_owned()
            }
            Lookup::Gone(_) => {
                assert!(book.erase_asked.contains(id), "{id} was erased by nobody");
                "erased".to_owned()
            }
            Lookup::Missing => panic!("{id} was accepted and is lost"),
        };
        *ends.entry(end).or_default() += 1;
        // Repeated submits made no second job.
        let label = Some(("number".to_owned(), number.to_string()));
        let filter = JobFilter {
            label,
            ..JobFilter::default()
        };
        let same = site
            .folder
            .store
            .of(ours())
            .list_jobs(&filter, None, 10)
            .await
            .unwrap();
        assert!(same.iter().all(|job| job.id == *id), "{number}: {same:?}");
    }
    *site.book() = book;
    ends
}

/// A job that ended: once, for a reason, and with all that belongs to its end.
async fn check(site: &Site, book: &Book, job: &Job) {
    let events = site.folder.events(&job.id).await;
    let last = events.last().map(|event| event.kind.name().to_owned());
    assert_eq!(last, Some(format!("job.{}", job.status.name())), "{job:?}");
    assert!(job.failures <= 3, "{job:?}");
    match job.status {
        Status::Succeeded => {
            let mesh = site
                .folder
                .store
                .of(ours())
                .mesh_info(&job.id, 0)
                .await
                .unwrap();
            assert!(mesh.is_some() && job.report.is_some(), "{job:?}");
        }
        Status::Failed => {
            let code = &job.error.as_ref().unwrap().code;
            let known = ["no_surface", "worker_crashed"].contains(&code.as_str());
            assert!(known, "{job:?}");
        }
        Status::Cancelled => assert!(book.cancel_asked.contains(&job.id), "{job:?}"),
        Status::Queued | Status::Running => panic!("{job:?} has not ended"),
    }
}
