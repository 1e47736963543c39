//! A real server on a free port, over a folder of its own.

use std::fs::{self, File};
use std::net::SocketAddr;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use meshway::identity::Secret;
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::wire::Connection;

/// How long a server may take to become ready, and a job to get where it is waited for.
const PATIENCE: Duration = Duration::from_secs(30);

/// A running server; killed when it is dropped.
pub(crate) struct Server {
    child: Child,
    /// On the disk of the build: what is measured depends on how fast that is made durable, and
    /// /tmp may be memory.
    folder: TempDir,
    pub(crate) address: SocketAddr,
    /// What each request has in its header, with the end of its line: the key, if there is one.
    pub(crate) bearer: String,
}

impl Server {
    /// A server that is ready, with an empty database.
    pub(crate) async fn start(flags: &[&str]) -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        Self::start_in(folder, flags, String::new()).await
    }

    /// The same with a key.
    pub(crate) async fn start_with_key(flags: &[&str]) -> Self {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        let key = Secret::generate().unwrap();
        let hash = key.hash();
        let block = format!(
            "[[keys]]\nname = \"bench\"\nhash = \"{hash}\"\nscopes = [\"read\", \"write\"]\n"
        );
        let file = folder.path().join("keys.toml");
        fs::write(&file, block).unwrap();
        let config = format!("--config={}", file.display());
        let flags = [flags, &[&config]].concat();
        let bearer = format!("Authorization: Bearer {}\r\n", key.reveal());
        Self::start_in(folder, &flags, bearer).await
    }

    async fn start_in(folder: TempDir, flags: &[&str], bearer: String) -> Self {
        let log = folder.path().join("log");
        let child = Command::new(env!("CARGO_BIN_EXE_meshway-scripted"))
            .args(["serve", "--listen=127.0.0.1:0", "--disk-reserve-mib=0"])
            .args(["--disk-reserve-percent=0", "--queue-limit=1000000"])
            .arg("--data-dir")
            .arg(folder.path().join("data"))
            .args(flags)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(File::create(&log).unwrap())
            .spawn()
            .unwrap();
        let mut server = Self {
            child,
            folder,
            address: SocketAddr::from(([127, 0, 0, 1], 0)),
            bearer,
        };
        let start = Instant::now();
        while !server.is_ready().await {
            let log = fs::read_to_string(&log).unwrap_or_default();
            let ended = server.child.try_wait().unwrap();
            assert!(ended.is_none() && start.elapsed() < PATIENCE, "{log}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
        server
    }

    async fn is_ready(&mut self) -> bool {
        let log = fs::read_to_string(self.folder.path().join("log")).unwrap_or_default();
        let said = log
            .split("listening on http://")
            .nth(1)
            .and_then(|rest| rest.split_whitespace().next()?.parse().ok());
        let Some(address) = said else {
            return false;
        };
        self.address = address;
        let answer = self.connect().await.ask("GET /readyz", "", &[]).await;
        answer.is_ok_and(|answer| answer.status == 200)
    }

    pub(crate) async fn connect(&self) -> Connection {
        Connection::open(self.address).await.unwrap()
    }

    /// Uploads a sphere of so many points; gives the cloud's id.
    pub(crate) async fn upload(&self, points: usize) -> String {
        let body = sphere(points);
        let answer = self.connect().await;
        let answer = { answer }
            .ask("POST /v1/clouds", &self.bearer, &[&body])
            .await;
        let answer = answer.unwrap();
        assert!(matches!(answer.status, 200 | 201), "{}", answer.json());
        id_of(&answer.json())
    }

    /// Submits a job; gives its id.
    pub(crate) async fn submit(&self, cloud: &str, settings: Value) -> String {
        let body = json!({"cloud_id": cloud, "preset": "fast", "settings": settings});
        let mut connection = self.connect().await;
        let answer = connection
            .post("/v1/jobs", &self.bearer, &body)
            .await
            .unwrap();
        assert_eq!(answer.status, 202, "{}", answer.json());
        id_of(&answer.json())
    }

    pub(crate) async fn job(&self, id: &str) -> Value {
        let mut connection = self.connect().await;
        let line = format!("GET /v1/jobs/{id}");
        let answer = connection.ask(&line, &self.bearer, &[]).await;
        answer.unwrap().json()
    }

    /// Waits until the job is as wanted.
    pub(crate) async fn wait(&self, id: &str, is: impl Fn(&Value) -> bool) -> Value {
        let start = Instant::now();
        loop {
            let job = self.job(id).await;
            if is(&job) {
                return job;
            }
            assert!(start.elapsed() < PATIENCE, "waited in vain: {job}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Resident memory of the server's process in MB (10⁶ bytes): now, and the most it ever was.
    pub(crate) fn memory_mb(&self) -> (f64, f64) {
        let status = fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let field = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name));
            let kib = line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok());
            kib.unwrap() * 1024.0 / 1e6
        };
        (field("VmRSS:"), field("VmHWM:"))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // One that has ended is not killed. Its workers end with their input.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn id_of(answer: &Value) -> String {
    answer["id"].as_str().unwrap().to_owned()
}

/// Points on the unit sphere along a spiral, as text.
pub(crate) fn sphere(points: usize) -> Vec<u8> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    let row = |k: usize| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / points as f64;
        let ring = (1.0 - z * z).sqrt();
        let (y, x) = (golden * k as f64).sin_cos();
        format!("{:.9} {:.9} {z:.9}\n", ring * x, ring * y)
    };
    (0..points).map(row).collect::<String>().into_bytes()
}
