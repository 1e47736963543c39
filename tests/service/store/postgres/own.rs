//! What is Postgres' own: a lock over all processes, connections that are lost, notices.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use meshway::jobs::{Act, AuditOutcome, Error, JobFilter, Status, Store};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use url::Url;

use crate::store::bare::Bare;
use crate::store::postgres::support::{Bench, LEASE_MS};
use crate::who::us;

/// Far longer than what is waited for takes.
const PATIENCE: Duration = Duration::from_secs(30);

/// The lock of the one who writes, as another client of the server takes it.
const LOCK: &str = "SELECT pg_advisory_xact_lock(5715126710434267)";

/// The server; none where there is no Postgres to test with.
async fn bench() -> Option<(Bench, Bare)> {
    let bench = Bench::new().await;
    match bench.bare().await {
        db @ Bare::Postgres(_) => Some((bench, db)),
        Bare::Sqlite(_) => None,
    }
}

#[tokio::test]
async fn one_transaction_writes_at_a_time() {
    let Some((bench, mut other)) = bench().await else {
        return;
    };
    let job = bench.submit().await;
    other.run("BEGIN").await.unwrap();
    other.run(LOCK).await.unwrap();
    let submit = bench.acts().submit(bench.new_job(), None);
    tokio::pin!(submit);
    let early = tokio::time::timeout(Duration::from_millis(300), &mut submit).await;
    assert!(early.is_err(), "{early:?}");
    assert_eq!(bench.job(&job.id).await, job, "reading goes on");
    other.run("ROLLBACK").await.unwrap();
    submit.await.unwrap();
}

#[tokio::test]
async fn a_lock_that_is_held_too_long_is_busy_and_not_waited_for_again() {
    let Some((bench, mut other)) = bench().await else {
        return;
    };
    other.run("BEGIN").await.unwrap();
    other.run(LOCK).await.unwrap();
    let refused = bench.acts().submit(bench.new_job(), None).await;
    assert!(matches!(refused, Err(Error::Busy)), "{refused:?}");
    other.run("ROLLBACK").await.unwrap();
    bench.store.check_writable().await.unwrap();
    assert_eq!(bench.store.counts().await.unwrap().get(Status::Queued), 0);
}

#[tokio::test]
async fn connections_that_are_cut_are_made_again() {
    const CUT: &str = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity
        WHERE datname = current_database() AND pid <> pg_backend_pid()";
    let Some((bench, mut other)) = bench().await else {
        return;
    };
    let mut written = BTreeSet::new();
    for _ in 0..5 {
        written.insert(bench.submit().await.id);
        other.run(CUT).await.unwrap();
        // The one that meets it is told; the next one goes through.
        while let Err(error) = bench.store.check_writable().await {
            assert!(matches!(error, Error::Busy), "{error:?}");
        }
        while bench.store.counts().await.is_err() {}
    }
    let all = JobFilter::default();
    let listed = bench.records().list_jobs(&all, None, 50).await.unwrap();
    assert_eq!(
        listed
            .into_iter()
            .map(|job| job.id)
            .collect::<BTreeSet<_>>(),
        written
    );
}

#[tokio::test]
async fn a_commit_that_is_cut_is_there_or_refused() {
    let Some((bench, mut other)) = bench().await else {
        return;
    };
    // Deferred to the commit, which thereby takes a while, and can be cut.
    other
        .run(
            "CREATE FUNCTION slow() RETURNS trigger LANGUAGE plpgsql AS
                 $$BEGIN PERFORM pg_sleep(0.5); RETURN NULL; END$$;
             CREATE CONSTRAINT TRIGGER slow AFTER INSERT ON jobs DEFERRABLE INITIALLY DEFERRED
                 FOR EACH ROW EXECUTE FUNCTION slow()",
        )
        .await
        .unwrap();
    let cut = async {
        tokio::time::sleep(Duration::from_millis(250)).await;
        other
            .run(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity
                 WHERE datname = current_database() AND query = 'COMMIT' AND state = 'active'",
            )
            .await
            .unwrap();
    };
    let (submitted, ()) = tokio::join!(bench.acts().submit(bench.new_job(), None), cut);
    // Cut before its end it is not there, and that is what is said: nobody is left in doubt.
    let all = JobFilter::default();
    let listed = bench.records().list_jobs(&all, None, 50).await.unwrap();
    assert_eq!(submitted.is_ok(), listed.len() == 1, "{submitted:?}");
    bench.store.check_writable().await.unwrap();
}

/// A way to the server that takes the answer to a commit away once, and cuts the connection.
async fn thief(server: SocketAddr, armed: Arc<AtomicBool>) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    tokio::spawn(async move {
        while let Ok((client, _)) = listener.accept().await {
            tokio::spawn(carry(client, server, Arc::clone(&armed)));
        }
    });
    address
}

async fn carry(mut client: TcpStream, server: SocketAddr, armed: Arc<AtomicBool>) {
    let mut server = TcpStream::connect(server).await.unwrap();
    let (mut asked, mut answered) = ([0; 8_192], [0; 8_192]);
    let mut stolen = false;
    loop {
        tokio::select! {
            Ok(bytes @ 1..) = client.read(&mut asked) => {
                let commits = asked[..bytes].windows(6).any(|part| part == b"COMMIT");
                stolen = commits && armed.swap(false, Ordering::SeqCst);
                server.write_all(&asked[..bytes]).await.unwrap();
            }
            Ok(bytes @ 1..) = server.read(&mut answered) => {
                if stolen || client.write_all(&answered[..bytes]).await.is_err() {
                    return;
                }
            }
            else => return,
        }
    }
}

#[tokio::test]
async fn a_commit_whose_answer_is_lost_is_asked_for() {
    let Some((bench, _)) = bench().await else {
        return;
    };
    let mut options = bench.options();
    let mut url: Url = options.database.unwrap().parse().unwrap();
    let server = url.socket_addrs(|| None).unwrap()[0];
    let armed = Arc::new(AtomicBool::new(false));
    let way = thief(server, Arc::clone(&armed)).await;
    url.set_port(Some(way.port())).unwrap();
    options.database = Some(url.into());
    let store = Store::open(bench.path(), options).await.unwrap();
    store.check_writable().await.unwrap();
    armed.store(true, Ordering::SeqCst);
    let job = store.by(us()).submit(bench.new_job(), None).await.unwrap();
    assert!(!armed.load(Ordering::SeqCst), "no answer was taken away");
    let all = JobFilter::default();
    let listed = bench.records().list_jobs(&all, None, 50).await.unwrap();
    assert_eq!(listed, [job]);
    store.by(us()).submit(bench.new_job(), None).await.unwrap();
}

#[tokio::test]
async fn other_processes_hear_of_a_commit() {
    let Some((bench, _)) = bench().await else {
        return;
    };
    let other = bench.second().await;
    let mut changed = other.changed();
    let job = bench.submit().await;
    let seen = async {
        loop {
            changed.changed().await.unwrap();
            if other.counts().await.unwrap().get(Status::Queued) == 1 {
                break;
            }
        }
    };
    tokio::time::timeout(PATIENCE, seen).await.unwrap();
    let claim = other.claim("w", LEASE_MS).await.unwrap().unwrap();
    assert_eq!(claim.job.id, job.id);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn readers_that_go_on_after_the_newest_number_miss_no_event() {
    const WRITERS: usize = 4;
    const EACH: usize = 50;
    let Some((bench, _)) = bench().await else {
        return;
    };
    let mut writers = Vec::new();
    for _ in 0..WRITERS {
        let store = bench.second().await;
        let jobs: Vec<_> = (0..EACH).map(|_| bench.new_job()).collect();
        writers.push(tokio::spawn(async move {
            for job in jobs {
                store.by(us()).submit(job, None).await.unwrap();
            }
        }));
    }
    let reader = bench.second().await;
    let read = async {
        let (mut last, mut seen) = (0, BTreeSet::new());
        while seen.len() < WRITERS * EACH {
            for event in reader.events_of_all(last, 1_000).await.unwrap() {
                assert!(event.seq > last);
                last = event.seq;
                seen.insert(event.job_id);
            }
        }
    };
    tokio::time::timeout(PATIENCE, read).await.unwrap();
    for writer in writers {
        writer.await.unwrap();
    }
}

#[tokio::test]
async fn a_label_with_a_character_that_texts_cannot_have_is_found() {
    let Some((bench, _)) = bench().await else {
        return;
    };
    let mut new = bench.new_job();
    let label = ("zero".to_owned(), "a\0b".to_owned());
    new.labels.insert(label.0.clone(), label.1.clone());
    let job = bench.acts().submit(new, None).await.unwrap();
    let filter = JobFilter {
        label: Some(label),
        ..JobFilter::default()
    };
    let listed = bench.records().list_jobs(&filter, None, 5).await.unwrap();
    assert_eq!(listed, [job]);
    let noted = bench
        .acts()
        .note(Act::AuthFail, "/\0", AuditOutcome::Refused);
    noted.await.unwrap();
}

#[tokio::test]
async fn processes_that_open_a_new_database_together_agree() {
    let Some(database) = crate::store::bare::new_database().await else {
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let options = meshway::jobs::Options {
        database: Some(database),
        ..meshway::jobs::Options::default()
    };
    let opened = (0..6).map(|_| Store::open(dir.path(), options.clone()));
    for store in futures_util::future::join_all(opened).await {
        store.unwrap().check_writable().await.unwrap();
    }
}

#[tokio::test]
async fn a_database_has_one_folder() {
    let Some((bench, _)) = bench().await else {
        return;
    };
    let other = tempfile::tempdir().unwrap();
    let refused = Store::open(other.path(), bench.options()).await;
    assert!(matches!(refused.err(), Some(Error::Elsewhere)));
    bench.second().await.check_writable().await.unwrap();
}

#[tokio::test]
async fn a_server_that_is_not_there_is_told_with_why() {
    let dir = tempfile::tempdir().unwrap();
    let options = meshway::jobs::Options {
        database: Some("postgres://nobody@127.0.0.1:1/none".to_owned()),
        ..meshway::jobs::Options::default()
    };
    let refused = Store::open(dir.path(), options).await.err().unwrap();
    assert!(matches!(refused, Error::Database(_)), "{refused:?}");
    assert!(refused.to_string().contains("refused"), "{refused}");
}
