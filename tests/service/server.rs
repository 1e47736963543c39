//! A real `meshway serve` on a free port, and the folder it works in, seen through the store.

use std::fs::{self, File};
use std::net::SocketAddr;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use meshway::jobs::store::DATABASE_FILE;
use meshway::jobs::{
    CloudId, Event, Job, JobId, Keep, NewCloud, NewJob, Status, Store, store::Options,
};
use meshway::reconstruction::cloud::Format;
use meshway::reconstruction::settings::{Preset, Settings};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, SqliteConnection};
use tempfile::TempDir;

use crate::http::support::sphere_xyz;
use crate::store::support::summary;
use crate::who::{ours, us};
use crate::wire::Connection;

/// How long anything may take on a busy machine before a test gives up.
pub(crate) const PATIENCE: Duration = Duration::from_mins(4);
/// Time between two looks at a condition.
const LOOK: Duration = Duration::from_millis(20);

/// The program under test.
pub(crate) const PROGRAM: &str = env!("CARGO_BIN_EXE_meshway");
/// The same with workers that do as a script says.
pub(crate) const SCRIPTED: &str = env!("CARGO_BIN_EXE_meshway-scripted");

/// The folder of a service with one cloud in it.
pub(crate) struct Folder {
    dir: TempDir,
    pub(crate) store: Store,
    cloud_id: CloudId,
}

impl Folder {
    pub(crate) async fn new() -> Self {
        Self::at(tempfile::tempdir().unwrap()).await
    }

    pub(crate) async fn at(dir: TempDir) -> Self {
        fs::create_dir(dir.path().join("clouds")).unwrap();
        let sha256 = "a".repeat(64);
        let bytes = (sphere_xyz(POINTS, 0.0) + "nan 0 0\n").into_bytes();
        fs::write(dir.path().join("clouds").join(&sha256), &bytes).unwrap();
        let store = Store::open(dir.path(), Options::default()).await.unwrap();
        let new = NewCloud {
            sha256,
            bytes: bytes.len() as u64,
            summary: summary(Format::Xyz, POINTS as u64),
            keep_ms: None,
        };
        let (cloud, _) = store.by(us()).insert_cloud(new).await.unwrap();
        Self {
            dir,
            store,
            cloud_id: cloud.id,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        self.dir.path()
    }

    pub(crate) fn cloud_id(&self) -> &CloudId {
        &self.cloud_id
    }

    /// A bare connection to the database.
    pub(crate) async fn connection(&self) -> SqliteConnection {
        let path = self.path().join(DATABASE_FILE);
        let options = SqliteConnectOptions::new().filename(path);
        options.connect().await.unwrap()
    }

    /// The processes that work in the folder.
    pub(crate) fn processes(&self) -> Vec<Pid> {
        let folder = self.path().as_os_str().as_bytes();
        let works_here = |line: &[u8]| line.windows(folder.len()).any(|part| part == folder);
        let processes = fs::read_dir("/proc").unwrap().filter_map(Result::ok);
        processes
            .filter(|process| {
                fs::read(process.path().join("cmdline")).is_ok_and(|l| works_here(&l))
            })
            .filter_map(|process| Pid::from_raw(process.file_name().to_str()?.parse().ok()?))
            .collect()
    }

    /// Starts a server and waits until it listens.
    pub(crate) async fn serve(&self, flags: &[&str]) -> Server {
        let log = unused(&self.path().join("log"));
        Server::start(self.path(), log, flags).await
    }

    /// Puts a job into the queue, with settings that differ from those of a quick run.
    pub(crate) async fn submit(&self, settings: Value) -> JobId {
        let mut all = json!({
            "training": { "max_evaluations": 40 },
            "surface": { "resolution": 32 },
        });
        for (group, values) in settings.as_object().unwrap() {
            for (name, value) in values.as_object().unwrap() {
                all[group][name] = value.clone();
            }
        }
        let new = NewJob {
            cloud_id: self.cloud_id.clone(),
            preset: Preset::Fast,
            settings: Settings::resolve(Preset::Fast, &all).unwrap(),
            labels: std::collections::BTreeMap::new(),
            source: None,
            derived_from: None,
            priority: 0,
            cost_seconds: 1.0,
            keep: Keep::default(),
        };
        self.store.by(us()).submit(new, None).await.unwrap().id
    }

    pub(crate) async fn job(&self, id: &JobId) -> Job {
        self.store
            .of(ours())
            .job(id)
            .await
            .unwrap()
            .found()
            .unwrap()
    }

    /// Waits until the job is as wanted.
    pub(crate) async fn wait(&self, id: &JobId, what: &str, is: impl Fn(&Job) -> bool) -> Job {
        until(what, PATIENCE, async || {
            let job = self.job(id).await;
            is(&job).then_some(job)
        })
        .await
    }

    /// Waits until the job has ended.
    pub(crate) async fn end(&self, id: &JobId) -> Job {
        self.wait(id, "the job ends", |job| job.status.is_final())
            .await
    }

    /// Waits until a worker works on the job; gives the worker's process.
    pub(crate) async fn running(&self, id: &JobId) -> Pid {
        let working = |job: &Job| job.status == Status::Running && job.phase.is_some();
        let job = self.wait(id, "the job runs", working).await;
        let name = job.worker.unwrap();
        let pid = name.rsplit('-').next().unwrap().parse().unwrap();
        Pid::from_raw(pid).unwrap()
    }

    /// The events of a job; their ids have no gap, they say one end at most, and that comes last.
    pub(crate) async fn events(&self, id: &JobId) -> Vec<Event> {
        let events = self
            .store
            .of(ours())
            .events_after(id, 0, 100_000)
            .await
            .unwrap();
        let ids: Vec<i64> = events.iter().map(|event| event.id).collect();
        assert_eq!(ids, (1..=events.len() as i64).collect::<Vec<_>>());
        if let Some(end) = events.iter().position(|event| event.kind.is_last()) {
            assert_eq!(end + 1, events.len(), "{events:?}");
        }
        events
    }
}

/// Points of the cloud, a sphere; one more has no place.
const POINTS: usize = 300;

fn unused(path: &Path) -> PathBuf {
    let names = (0..).map(|k| path.with_extension(k.to_string()));
    let mut unused = names.filter(|path| !path.exists());
    unused.next().unwrap()
}

/// A running server; killed when it is dropped.
pub(crate) struct Server {
    child: Child,
    log: PathBuf,
}

impl Server {
    /// Starts a server in a folder, with its log elsewhere, and waits until it listens.
    pub(crate) async fn start(folder: &Path, log: PathBuf, flags: &[&str]) -> Self {
        let serve = ["serve", "--disk-reserve-mib=0", "--disk-reserve-percent=0"];
        Self::spawn(folder, log, &[&serve, flags].concat()).await
    }

    /// Starts a process that listens, by its whole command line but folder and address.
    pub(crate) async fn spawn(folder: &Path, log: PathBuf, line: &[&str]) -> Self {
        Self::spawn_among(folder, log, line, &[]).await
    }

    /// The same with these variables of its environment.
    pub(crate) async fn spawn_among(
        folder: &Path,
        log: PathBuf,
        line: &[&str],
        environment: &[(&str, &str)],
    ) -> Self {
        let scripted = line.iter().any(|flag| flag.starts_with("--script="));
        let child = Command::new(if scripted { SCRIPTED } else { PROGRAM })
            .args(line)
            .envs(environment.iter().copied())
            .args(["--listen=127.0.0.1:0", "--data-dir"])
            .arg(folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(&log).unwrap())
            .spawn()
            .unwrap();
        let mut server = Self { child, log };
        until("the server listens", PATIENCE, async || {
            let ended = server.child.try_wait().unwrap();
            assert!(ended.is_none(), "{}", server.log());
            // The whole line: the port is in it.
            let log = server.log();
            let (_, address) = log.split_once("listening on http://127.0.0.1:")?;
            address.contains('\n').then_some(())
        })
        .await;
        server
    }

    pub(crate) fn log(&self) -> String {
        fs::read_to_string(&self.log).unwrap_or_default()
    }

    /// Where it listens.
    pub(crate) fn address(&self) -> SocketAddr {
        let log = self.log();
        let address = log.split("listening on http://").nth(1).unwrap();
        address.split_whitespace().next().unwrap().parse().unwrap()
    }

    pub(crate) fn pid(&self) -> Pid {
        Pid::from_raw(self.child.id() as i32).unwrap()
    }

    /// Asks the server to end, and waits until it has.
    pub(crate) async fn terminate(mut self) -> ExitStatus {
        kill_process(self.pid(), Signal::TERM).unwrap();
        self.ended().await
    }

    /// Waits until the server has ended.
    pub(crate) async fn ended(&mut self) -> ExitStatus {
        until("the server ends", PATIENCE, async || {
            self.child.try_wait().unwrap()
        })
        .await
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // One that has ended is not killed.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// Uploads a sphere; gives the cloud as JSON.
pub(crate) async fn upload_sphere(client: &mut Connection) -> Value {
    let bytes = sphere_xyz(300, 0.0).into_bytes();
    let answer = client.ask("POST /v1/clouds", "", &[&bytes]).await;
    answer.unwrap().json()
}

/// A job as JSON once it has ended: on a busy machine a wait for it may be too short.
pub(crate) async fn job_ended(client: &mut Connection, job: &Value) -> Value {
    let path = format!("GET {}", job["links"]["self"].as_str().unwrap());
    until("the job ends", PATIENCE, async || {
        let job = client.ask(&path, "", &[]).await.unwrap().json();
        job["finished_at"].is_string().then_some(job)
    })
    .await
}

/// Looks again and again until there is something.
///
/// # Panics
/// When there is nothing in time.
pub(crate) async fn until<T>(
    what: &str,
    patience: Duration,
    mut look: impl AsyncFnMut() -> Option<T>,
) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = look().await {
            return found;
        }
        assert!(start.elapsed() < patience, "waited in vain: {what}");
        tokio::time::sleep(LOOK).await;
    }
}
