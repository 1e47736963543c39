//! A service whose database is behind `PgBouncer` in transaction mode, as `scripts/pgbouncer.sh` starts it.

use meshway::jobs::store::Options;
use rustix::process::{Signal, kill_process};
use serde_json::json;
use sqlx::ConnectOptions;
use sqlx::postgres::PgConnectOptions;

use crate::server::{PATIENCE, Server, job_ended, until, upload_sphere};
use crate::store::bare::{self, Bare, new_database};
use crate::upgraded::{run, said};
use crate::wire::Connection;

/// The same database through the pooler; none, and said so, where there is no pooler.
#[expect(
    clippy::disallowed_methods,
    reason = "a test is told of its servers by the environment"
)]
#[expect(clippy::print_stderr, reason = "what is left out is said aloud")]
pub(crate) fn through(url: &str) -> Option<String> {
    let Ok(address) = std::env::var("MESHWAY_TEST_PGBOUNCER") else {
        assert!(
            std::env::var_os("CI").is_none(),
            "MESHWAY_TEST_PGBOUNCER is not set: run the tests by scripts/pgbouncer.sh"
        );
        eprintln!("PgBouncer is left out: run by scripts/postgres.sh scripts/pgbouncer.sh");
        return None;
    };
    let (host, port) = address.split_once(':').unwrap();
    let options: PgConnectOptions = url.parse().unwrap();
    let options = options.host(host).port(port.parse().unwrap());
    Some(options.to_url_lossy().to_string())
}

/// Options of a store that reaches its database through the pooler, where the suite is to.
pub(crate) fn perhaps(options: Options) -> Options {
    let wanted = std::env::var_os("MESHWAY_TEST_POOLED").is_some();
    match options.database.as_deref().filter(|_| wanted) {
        None => options,
        Some(url) => Options {
            database: Some(through(url).unwrap()),
            database_pooled: true,
            ..options
        },
    }
}

async fn serve(folder: &tempfile::TempDir, pooled: &str, name: &str) -> Server {
    let database = format!("--database={pooled}");
    let flags = [
        &*database,
        "--database-pooled",
        "--workers=2",
        "--script=sleep:1.5",
    ];
    let data = folder.path().join("data");
    Server::start(&data, folder.path().join(name), &flags).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn a_service_lives_behind_a_pooler() {
    let Some(direct) = new_database().await else {
        return;
    };
    let Some(pooled) = through(&direct) else {
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let server = serve(&folder, &pooled, "first").await;
    let mut client = Connection::open(server.address()).await.unwrap();
    let cloud = upload_sphere(&mut client).await;
    let job =
        json!({"cloud_id": cloud["id"], "preset": "fast", "labels": {"who": "O'Neill \\ 'ß'"}});
    let mut jobs = Vec::new();
    for _ in 0..12 {
        let answer = client.post("/v1/jobs", "", &job).await.unwrap();
        assert_eq!(answer.status, 202, "{}\n{}", answer.json(), server.log());
        jobs.push(answer.json());
    }
    let path = |job: &serde_json::Value| job["links"]["self"].as_str().unwrap().to_owned();

    // The last one is cancelled while it waits, a worker is killed while it works, and a stream tells all.
    let cancel = format!("{}/cancel", path(&jobs[11]));
    let cancelled = client.post(&cancel, "", &json!({})).await.unwrap();
    assert!(cancelled.status < 300, "{}", cancelled.json());
    let mut db = Bare::postgres(&direct).await;
    let worker = until("a job runs", PATIENCE, async || {
        let select = "SELECT worker FROM jobs WHERE status = 'running' AND progress > 0";
        db.texts(select).await.pop()
    })
    .await;
    let pid = worker.split('-').nth(2).unwrap().parse().unwrap();
    kill_process(rustix::process::Pid::from_raw(pid).unwrap(), Signal::KILL).unwrap();
    let mut stream = Connection::open(server.address()).await.unwrap();
    let line = format!("GET {}/events", path(&jobs[3]));
    stream.send(&line, "", &[]).await.unwrap();
    stream.read_head().await.unwrap();
    let mut ids: Vec<i64> = Vec::new();
    loop {
        let line = stream.read_line().await.unwrap();
        ids.extend(
            line.strip_prefix("id: ")
                .map(|id| id.parse::<i64>().unwrap()),
        );
        if line == "event: job.succeeded" {
            break;
        }
    }
    assert_eq!(ids, (1..=ids.len() as i64).collect::<Vec<_>>());
    for job in &jobs[..11] {
        let ended = job_ended(&mut client, job).await;
        assert_eq!(ended["status"], "succeeded", "{ended}\n{}", server.log());
        assert_eq!(ended["labels"]["who"], "O'Neill \\ 'ß'");
        let mesh = format!("GET {}/mesh.ply", path(job));
        assert_eq!(client.ask(&mesh, "", &[]).await.unwrap().status, 200);
    }
    let ended = job_ended(&mut client, &jobs[11]).await;
    assert_eq!(ended["status"], "cancelled");
    // Nothing is kept in sessions that others get next.
    let select = "SELECT COUNT(*) FROM pg_stat_activity WHERE wait_event = 'ClientRead'
                  AND state LIKE 'idle in transaction%' AND datname = current_database()";
    until("no transaction stays open", PATIENCE, async || {
        (db.number(select).await == 0).then_some(())
    })
    .await;
    let refused = "prepared statement";
    assert!(!server.log().contains(refused), "{}", server.log());
    assert!(server.terminate().await.success());

    let data = format!("--data-dir={}", folder.path().join("data").display());
    let database = format!("--database={pooled}");
    let place = [&*database, "--database-pooled"];
    for command in [
        [&["check", &data, "--hashes"], &place[..]].concat(),
        [&["migrate", "--check"], &place[..]].concat(),
        [&["audit", "verify"], &place[..]].concat(),
    ] {
        let output = run(&command);
        assert!(output.status.success(), "{command:?}: {}", said(&output));
    }
    let server = serve(&folder, &pooled, "second").await;
    let mut client = Connection::open(server.address()).await.unwrap();
    let again = client
        .ask(&format!("GET {}", path(&jobs[0])), "", &[])
        .await;
    assert_eq!(again.unwrap().json()["status"], "succeeded");
    assert!(server.terminate().await.success());
}

#[tokio::test]
async fn new_tables_are_made_through_a_pooler_by_many_at_once() {
    let Some(pooled) = new_database().await.and_then(|url| through(&url)) else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let options = Options {
        database: Some(pooled),
        database_pooled: true,
        ..Options::default()
    };
    let opened = (0..6).map(|_| meshway::jobs::Store::open(dir.path(), options.clone()));
    for store in futures_util::future::join_all(opened).await {
        store.unwrap().check_writable().await.unwrap();
    }
    assert!(bare::server().is_some());
}
