//! Several processes over one database and one object store.

use std::net::SocketAddr;

use serde_json::{Value, json};
use tempfile::TempDir;

use crate::http::support::sphere_xyz;
use crate::place::Bucket;
use crate::proxy::Proxy;
use crate::server::Server;
use crate::store::bare;
use crate::wire::{Answer, Connection};

/// A database and a part of an object store of their own, and the folders of who works with them.
pub(crate) struct Cluster {
    pub(crate) database: String,
    pub(crate) bucket: Bucket,
    pub(crate) dir: TempDir,
}

impl Cluster {
    /// None, and said so, where there is no server of either kind.
    pub(crate) async fn new() -> Option<Self> {
        Some(Self {
            bucket: Bucket::new()?,
            database: bare::new_database().await?,
            dir: tempfile::tempdir().unwrap(),
        })
    }

    /// Starts a node of this name that answers requests.
    pub(crate) async fn serve(&self, name: &str, flags: &[&str]) -> Node {
        self.serve_in(name, name, flags).await
    }

    /// The same with a name for its log.
    pub(crate) async fn serve_in(&self, name: &str, log: &str, flags: &[&str]) -> Node {
        let serve = ["serve", "--disk-reserve-mib=0", "--disk-reserve-percent=0"];
        self.start(name, log, &[&serve, flags].concat()).await
    }

    /// Starts a node of this name that works on jobs.
    pub(crate) async fn worker(&self, name: &str, flags: &[&str]) -> Node {
        self.worker_in(name, name, flags).await
    }

    /// The same with a name for its log.
    pub(crate) async fn worker_in(&self, name: &str, log: &str, flags: &[&str]) -> Node {
        self.start(name, log, &[&["worker"], flags].concat()).await
    }

    /// The same cluster by other ways to its database and its object store.
    pub(crate) fn by(&self, database: Option<&Proxy>, objects: Option<&Proxy>) -> Self {
        let by = |url: &str, proxy: Option<&Proxy>| match proxy {
            Some(proxy) => proxy.instead_of(url),
            None => url.to_owned(),
        };
        Self {
            database: by(&self.database, database),
            bucket: Bucket {
                url: by(&self.bucket.url, objects),
                folder: self.bucket.folder.clone(),
            },
            dir: tempfile::tempdir().unwrap(),
        }
    }

    async fn start(&self, name: &str, log: &str, line: &[&str]) -> Node {
        self.start_among(name, log, line, &[]).await
    }

    /// Starts a node of this name by its command line, with these variables of its environment.
    pub(crate) async fn start_among(
        &self,
        name: &str,
        log: &str,
        line: &[&str],
        environment: &[(&str, &str)],
    ) -> Node {
        let (database, objects) = (format!("--database={}", self.database), self.bucket.flag());
        let line = [line, &[&database, &objects]].concat();
        let log = self.dir.path().join(format!("{log}.log"));
        let folder = self.dir.path().join(name);
        let server = Server::spawn_among(&folder, log, &line, environment).await;
        Node {
            name: name.to_owned(),
            server,
        }
    }

    /// The folder of a node.
    pub(crate) fn folder(&self, node: &Node) -> std::path::PathBuf {
        self.dir.path().join(&node.name)
    }
}

/// One of its processes.
pub(crate) struct Node {
    name: String,
    pub(crate) server: Server,
}

impl Node {
    pub(crate) fn address(&self) -> SocketAddr {
        self.server.address()
    }

    /// An answer on a connection of its own, as behind a balancer.
    pub(crate) async fn ask(&self, line: &str, headers: &str, body: &[&[u8]]) -> Answer {
        let mut client = Connection::open(self.address()).await.unwrap();
        client.ask(line, headers, body).await.unwrap()
    }

    /// The JSON of an answer that is as it should be.
    pub(crate) async fn get(&self, path: &str) -> Value {
        let answer = self.ask(&format!("GET {path}"), "", &[]).await;
        assert_eq!(answer.status, 200, "{path}: {}", answer.json());
        answer.json()
    }

    /// Uploads a sphere; gives its name.
    pub(crate) async fn upload(&self) -> String {
        let bytes = sphere_xyz(300, 0.0).into_bytes();
        let sent = self.ask("POST /v1/clouds", "", &[&bytes]).await.json();
        sent["id"].as_str().unwrap().to_owned()
    }

    /// Submits a quick job of a cloud; gives its address.
    pub(crate) async fn submit(&self, cloud: &str) -> String {
        let body = json!({
            "cloud_id": cloud,
            "preset": "fast",
            "settings": {"training": {"max_evaluations": 40}, "surface": {"resolution": 32}},
        });
        let mut client = Connection::open(self.address()).await.unwrap();
        let answer = client.post("/v1/jobs", "", &body).await.unwrap();
        assert_eq!(answer.status, 202, "{}", answer.json());
        let job = answer.json();
        job["links"]["self"].as_str().unwrap().to_owned()
    }

    /// Begins to read a stream of events behind the one of this number.
    pub(crate) async fn stream(&self, path: &str, last: Option<i64>) -> Stream {
        let mut client = Connection::open(self.address()).await.unwrap();
        let last = last.map_or_else(String::new, |id| format!("Last-Event-ID: {id}\r\n"));
        client
            .send(&format!("GET {path}"), &last, &[])
            .await
            .unwrap();
        let (status, _) = client.read_head().await.unwrap();
        assert_eq!(status, 200);
        Stream(client)
    }
}

/// A stream of events.
pub(crate) struct Stream(Connection);

impl Stream {
    /// Number and kind of the next event.
    pub(crate) async fn next(&mut self) -> (Option<i64>, String) {
        let mut id = None;
        loop {
            let line = self.0.read_line().await.unwrap();
            if let Some(text) = line.strip_prefix("id: ") {
                id = Some(text.parse().unwrap());
            }
            if let Some(kind) = line.strip_prefix("event: ") {
                return (id, kind.to_owned());
            }
        }
    }

    /// Waits until the node ends it.
    pub(crate) async fn ends(&mut self) {
        // An empty chunk is the last one.
        while self.0.read_line().await.unwrap() != "0" {}
    }

    /// Numbers of all events up to one of this kind.
    pub(crate) async fn until(&mut self, kind: &str) -> Vec<i64> {
        let mut ids = Vec::new();
        loop {
            let (id, found) = self.next().await;
            ids.extend(id);
            if found == kind {
                return ids;
            }
        }
    }
}
