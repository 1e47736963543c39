//! Several nodes are one service: whoever is asked, and whoever dies.

use std::fs;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Duration;

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use rustix::process::{Signal, kill_process};
use serde_json::{Value, json};

use crate::cluster::{Cluster, Node};
use crate::http::support::sphere_xyz;
use crate::proxy::{Proxy, Way};
use crate::server::{PATIENCE, PROGRAM, until};
use crate::wire::Connection;

async fn ended(node: &Node, job: &str) -> Value {
    until("the job ends", PATIENCE, async || {
        let job = node.get(job).await;
        job["finished_at"].is_string().then_some(job)
    })
    .await
}

#[tokio::test]
async fn two_nodes_and_a_worker_are_one_service() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let one = cluster.serve("one", &["--workers=0"]).await;
    let two = cluster.serve("two", &["--workers=0"]).await;
    let cloud = one.upload().await;
    let job = two.submit(&cloud).await;
    let mut stream = one.stream(&format!("{job}/events"), None).await;
    // Nobody works yet.
    assert_eq!(stream.next().await, (Some(1), "job.queued".to_owned()));
    let worker = cluster.worker("worker", &["--slots=1"]).await;
    let mut ids = vec![1];
    ids.extend(stream.until("job.succeeded").await);
    assert_eq!(ids, (1..=ids.len() as i64).collect::<Vec<_>>());
    // Where one node left off, the other goes on.
    let mut rest = two.stream(&format!("{job}/events"), Some(3)).await;
    assert_eq!(rest.until("job.succeeded").await, ids[3..]);

    let mesh = format!("GET {job}/mesh.obj");
    let (a, b) = (one.ask(&mesh, "", &[]).await, two.ask(&mesh, "", &[]).await);
    assert_eq!((a.status, b.status), (200, 200));
    assert!(a.body == b.body);
    let ready = worker.ask("GET /readyz", "", &[]).await;
    assert_eq!(ready.status, 200, "{}", ready.json());
    until("the worker rests", PATIENCE, async || {
        let metrics = worker.ask("GET /metrics", "", &[]).await.body;
        let metrics = String::from_utf8(metrics).unwrap();
        metrics
            .contains("meshway_workers{state=\"idle\"} 1")
            .then_some(())
    })
    .await;

    // What one erases, the other has no copy of, and tells its streams.
    assert!(worker.server.terminate().await.success());
    let cached = cluster.folder(&two).join("cache");
    assert!(fs::read_dir(&cached).unwrap().next().is_some());
    let waiting = one.submit(&cloud).await;
    let mut all = two.stream(&format!("{waiting}/events"), None).await;
    assert_eq!(all.next().await, (Some(1), "job.queued".to_owned()));
    let erase = format!("DELETE {waiting}");
    assert_eq!(one.ask(&erase, "", &[]).await.status, 204);
    let erased = one.ask(&format!("DELETE {job}"), "", &[]).await;
    assert_eq!(erased.status, 204);
    assert_eq!(two.ask(&mesh, "", &[]).await.status, 410);
    until("the copy is gone", PATIENCE, async || {
        let mut files = fs::read_dir(&cached).unwrap();
        files.next().is_none().then_some(())
    })
    .await;
    all.ends().await;
    let gone = until("the worker is gone", PATIENCE, async || {
        let metrics = one.ask("GET /metrics", "", &[]).await.body;
        let metrics = String::from_utf8(metrics).unwrap();
        metrics
            .contains("meshway_nodes{role=\"worker\"} 0")
            .then_some(metrics)
    })
    .await;
    assert!(gone.contains("meshway_nodes{role=\"serve\"} 2"), "{gone}");
}

#[tokio::test]
async fn a_request_that_is_repeated_elsewhere_is_done_once() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let nodes = [
        cluster.serve("one", &["--workers=0"]).await,
        cluster.serve("two", &["--workers=0"]).await,
    ];
    let cloud = nodes[0].upload().await;
    let body = json!({"cloud_id": cloud, "preset": "fast"});
    let mut names = std::collections::BTreeSet::new();
    let mut requests = tokio::task::JoinSet::new();
    for k in 0..40 {
        let (address, body) = (nodes[k % 2].address(), body.clone());
        requests.spawn(async move {
            let key = "Idempotency-Key: scan-7\r\n";
            loop {
                let mut client = Connection::open(address).await.unwrap();
                let answer = client.post("/v1/jobs", key, &body).await.unwrap();
                match answer.status {
                    202 => return answer.json()["id"].as_str().unwrap().to_owned(),
                    status => assert_eq!(status, 409, "{}", answer.json()),
                }
            }
        });
    }
    while let Some(name) = requests.join_next().await {
        names.insert(name.unwrap());
    }
    assert_eq!(names.len(), 1, "{names:?}");
    let jobs = nodes[1].get("/v1/jobs").await;
    assert_eq!(jobs["items"].as_array().unwrap().len(), 1, "{jobs}");
}

#[tokio::test]
async fn keys_and_sessions_hold_on_every_node() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let config = cluster.dir.path().join("clinic.toml");
    let made = |arguments: &[&str], input: &str| {
        let mut child = Command::new(PROGRAM)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        child
            .stdin
            .take()
            .unwrap()
            .write_all(input.as_bytes())
            .unwrap();
        String::from_utf8(child.wait_with_output().unwrap().stdout).unwrap()
    };
    let all = "--scopes=read,write,delete,admin";
    fs::write(
        &config,
        made(&["user", "passwd", "anna", all], "correct horse\n"),
    )
    .unwrap();
    let config = format!("--config={}", config.display());
    let one = cluster.serve("one", &[&config]).await;
    let two = cluster.serve("two", &[&config]).await;
    let pair = BASE64_STANDARD.encode("anna:correct horse");
    let mut client = Connection::open(one.address()).await.unwrap();
    let sign_in = format!("Authorization: Basic {pair}\r\n");
    client
        .send("POST /v1/session", &sign_in, &[])
        .await
        .unwrap();
    let cookie = loop {
        let line = client.read_line().await.unwrap();
        if let Some(cookie) = line.strip_prefix("set-cookie: meshway-session=") {
            break cookie.split(';').next().unwrap().to_owned();
        }
    };
    let cookie = format!("Cookie: meshway-session={cookie}\r\nSec-Fetch-Site: same-origin\r\n");
    let signed_in = two.ask("GET /v1/session", &cookie, &[]).await;
    assert_eq!(signed_in.status, 200, "{}", signed_in.json());

    // A key of one opens the other at once, and nothing soon after it was taken out.
    let wanted = json!({"name": "pacs", "scopes": ["read"]}).to_string();
    let origin = "Origin: http://localhost\r\n";
    let head = format!("{cookie}{origin}Content-Type: application/json\r\n");
    let key = one.ask("POST /v1/keys", &head, &[wanted.as_bytes()]).await;
    assert_eq!(key.status, 201, "{}", key.json());
    let (id, key) = (key.json()["id"].clone(), key.json()["key"].clone());
    let bearer = format!("Authorization: Bearer {}\r\n", key.as_str().unwrap());
    assert_eq!(two.ask("GET /v1/jobs", &bearer, &[]).await.status, 200);
    let remove = format!("DELETE /v1/keys/{}", id.as_str().unwrap());
    let head = format!("{cookie}{origin}");
    assert_eq!(one.ask(&remove, &head, &[]).await.status, 204);
    until("the key opens nothing", PATIENCE, async || {
        let answer = two.ask("GET /v1/jobs", &bearer, &[]).await;
        (answer.status == 401).then_some(())
    })
    .await;

    // Signed out is signed out; and a session goes on when its node starts again.
    assert!(one.server.terminate().await.success());
    let one = cluster.serve("one", &[&config]).await;
    assert_eq!(one.ask("GET /v1/session", &cookie, &[]).await.status, 200);
    let head = format!("{cookie}{origin}");
    assert_eq!(two.ask("DELETE /v1/session", &head, &[]).await.status, 204);
    assert_eq!(one.ask("GET /v1/session", &cookie, &[]).await.status, 401);
}

#[tokio::test]
async fn an_upload_goes_on_at_another_node() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let one = cluster.serve("one", &["--workers=0"]).await;
    let two = cluster.serve("two", &["--workers=0"]).await;
    let bytes = sphere_xyz(3_000, 0.0).into_bytes();
    let (first, second) = bytes.split_at(bytes.len() / 3);
    let tus = "Tus-Resumable: 1.0.0\r\n";
    let create = format!("{tus}Upload-Length: {}\r\n", bytes.len());
    let mut client = Connection::open(one.address()).await.unwrap();
    client.send("POST /v1/uploads", &create, &[]).await.unwrap();
    let path = loop {
        let line = client.read_line().await.unwrap();
        if let Some(path) = line.strip_prefix("location: ") {
            break path.to_owned();
        }
    };
    let append = |at: usize| {
        format!("{tus}Upload-Offset: {at}\r\nContent-Type: application/offset+octet-stream\r\n")
    };
    let patch = format!("PATCH {path}");
    assert_eq!(one.ask(&patch, &append(0), &[first]).await.status, 204);
    let offset = two.get(&path).await["offset"].clone();
    assert_eq!(offset, json!(first.len()));
    // The first node dies; what it took stays.
    kill_process(one.server.pid(), Signal::KILL).unwrap();
    assert_eq!(two.ask(&patch, &append(0), &[second]).await.status, 409);
    let done = two.ask(&patch, &append(first.len()), &[second]).await;
    assert_eq!(done.status, 204, "{}", done.json());
    let clouds = two.get("/v1/clouds").await;
    let cloud = &clouds["items"][0];
    assert_eq!(cloud["bytes"], json!(bytes.len()), "{clouds}");
    let content = format!("GET /v1/clouds/{}/content", cloud["id"].as_str().unwrap());
    assert!(two.ask(&content, "", &[]).await.body == bytes);
    until("the parts are gone", PATIENCE, async || {
        (cluster.bucket.keys().len() == 1).then_some(())
    })
    .await;
    // One that is given up leaves nothing.
    let begun = two.ask("POST /v1/uploads", &create, &[]).await;
    assert_eq!(begun.status, 201);
    assert!(
        fs::read_dir(cluster.folder(&two).join("tmp"))
            .unwrap()
            .next()
            .is_none()
    );
}

#[tokio::test]
async fn the_job_of_a_machine_that_dies_goes_on_elsewhere() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let node = cluster
        .serve("one", &["--workers=0", "--checkpoint-seconds=1"])
        .await;
    let script = ["--script=sleep:8", "--checkpoint-seconds=1"];
    let first = cluster.worker("first", &script).await;
    let cloud = node.upload().await;
    let job = node.submit(&cloud).await;
    until("the job runs", PATIENCE, async || {
        let job = node.get(&job).await;
        (job["progress"].as_f64()? > 0.1).then_some(())
    })
    .await;
    // The supervisor dies, and its worker with it: nobody settles the job but its lease.
    kill_process(first.server.pid(), Signal::KILL).unwrap();
    let second = cluster.worker("second", &script).await;
    let end = ended(&node, &job).await;
    assert_eq!(
        (&end["status"], &end["attempt"]),
        (&json!("succeeded"), &json!(2)),
        "{end}\n{}",
        second.server.log()
    );
}

#[tokio::test]
async fn a_worker_that_starts_again_takes_no_cloud_from_the_one_before() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let node = cluster.serve("one", &["--workers=0"]).await;
    let cloud = node.upload().await;
    let way = Proxy::to(&cluster.bucket.url).await;
    let stalled = cluster.by(None, Some(&way));
    let first = stalled.worker("worker", &[]).await;
    way.set(Way::Stalled);
    let job = node.submit(&cloud).await;
    let fetched = stalled.folder(&first).join("tmp");
    until("the cloud is on its way", PATIENCE, async || {
        let mut files = fs::read_dir(&fetched).ok()?;
        files.next().map(drop)
    })
    .await;
    // Its child is still there, and finds the cloud after the next worker has cleared the folder.
    kill_process(first.server.pid(), Signal::KILL).unwrap();
    let again = Cluster {
        bucket: cluster.bucket.clone(),
        ..stalled
    };
    let second = again.worker_in("worker", "worker-again", &[]).await;
    way.set(Way::Open);
    let end = ended(&node, &job).await;
    assert_eq!(
        (&end["status"], &end["failures"]),
        (&json!("succeeded"), &json!(0)),
        "{end}\n{}",
        second.server.log()
    );
}

#[tokio::test]
async fn a_worker_ends_when_there_is_nothing_to_do() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    // Without a service there is nothing to work for.
    let line = ["worker", "--exit-when-idle=1"];
    let objects = cluster.bucket.flag();
    let alone = |flags: &[&str]| {
        let told = Command::new(PROGRAM)
            .args(line)
            .arg(format!(
                "--data-dir={}",
                cluster.dir.path().join("none").display()
            ))
            .args(flags)
            .output()
            .unwrap();
        (told.status.code(), String::from_utf8(told.stderr).unwrap())
    };
    let database = format!("--database={}", cluster.database);
    let (code, said) = alone(&[&database]);
    assert!(code == Some(2) && said.contains("--objects"), "{said}");
    let (code, said) = alone(&[&database, &objects]);
    assert!(
        code == Some(1) && said.contains("start one first"),
        "{said}"
    );

    let node = cluster.serve("one", &["--workers=0"]).await;
    let job = node.submit(&node.upload().await).await;
    let mut worker = cluster.worker("worker", &["--exit-when-idle=2"]).await;
    let status = worker.server.ended().await;
    assert!(status.success(), "{}", worker.server.log());
    assert_eq!(node.get(&job).await["status"], "succeeded");
}

#[tokio::test]
async fn one_of_them_tells_webhooks() {
    let Some(cluster) = Cluster::new().await else {
        return;
    };
    let options = |name: &str| meshway::jobs::Options {
        database: Some(cluster.database.clone()),
        objects: Some(cluster.bucket.url()),
        node: name.to_owned(),
        ..Default::default()
    };
    let open = async |name: &str| {
        let folder = cluster.dir.path().join(name);
        fs::create_dir(&folder).unwrap();
        meshway::jobs::Store::open(&folder, options(name))
            .await
            .unwrap()
    };
    let (one, two) = (open("one").await, open("two").await);
    assert!(one.take_duty("webhooks", 500).await.unwrap());
    assert!(!two.take_duty("webhooks", 500).await.unwrap());
    assert!(one.take_duty("webhooks", 500).await.unwrap());
    tokio::time::sleep(Duration::from_millis(600)).await;
    assert!(two.take_duty("webhooks", 60_000).await.unwrap());
    assert!(!one.take_duty("webhooks", 60_000).await.unwrap());
    two.leave("two").await.unwrap();
    assert!(one.take_duty("webhooks", 60_000).await.unwrap());
    one.close().await;
    two.close().await;
}
