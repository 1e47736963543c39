//! An open event stream, as its client sees it.

use std::io::Result;
use std::net::SocketAddr;
use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::Value;
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;
use tokio::io::AsyncReadExt;

use crate::wire::Connection;

/// A stream of server-sent events.
pub(crate) struct Events {
    connection: Connection,
    text: String,
}

/// One of them.
pub(crate) struct Event {
    pub(crate) name: String,
    /// From the time that its row carries, taken as the transaction begins, to its arrival.
    pub(crate) lag_ms: f64,
    pub(crate) job: String,
}

impl Events {
    /// Opens the stream at a path; it is open when this returns.
    pub(crate) async fn open(address: SocketAddr, path: &str) -> Result<Self> {
        let mut connection = Connection::open(address).await?;
        connection
            .send(&format!("GET {path}"), "Accept: text/event-stream\r\n", &[])
            .await?;
        let (status, _) = connection.read_head().await?;
        assert_eq!(status, 200, "{path}");
        let mut events = Self {
            connection,
            text: String::new(),
        };
        // The first frame tells when to come back; after it the stream listens.
        events.read_chunk().await?;
        Ok(events)
    }

    /// The next event; none when the stream has ended.
    pub(crate) async fn next(&mut self) -> Result<Option<Event>> {
        loop {
            if let Some(end) = self.text.find("\n\n") {
                let frame: String = self.text.drain(..end + 2).collect();
                if let Some(event) = parse(&frame) {
                    return Ok(Some(event));
                }
            } else if !self.read_chunk().await? {
                return Ok(None);
            }
        }
    }

    /// Reads a chunk (RFC 9112 section 7.1); false for the last one.
    async fn read_chunk(&mut self) -> Result<bool> {
        let line = self.connection.read_line().await?;
        let length = usize::from_str_radix(&line, 16).expect("the length of a chunk");
        let mut chunk = vec![0; length + 2];
        self.connection.0.read_exact(&mut chunk).await?;
        chunk.truncate(length);
        self.text
            .push_str(&String::from_utf8(chunk).expect("a server sends whole frames"));
        Ok(length > 0)
    }
}

/// The event of a frame; none for comments, and for what is about the stream itself.
fn parse(frame: &str) -> Option<Event> {
    let field = |name: &str| frame.lines().find_map(|line| line.strip_prefix(name));
    let data: Value = serde_json::from_str(field("data: ")?).ok()?;
    let time = OffsetDateTime::parse(data["time"].as_str()?, &Rfc3339).ok()?;
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
    Some(Event {
        name: field("event: ")?.to_owned(),
        lag_ms: now.as_secs_f64() * 1e3 - time.unix_timestamp_nanos() as f64 / 1e6,
        job: data["job_id"].as_str()?.to_owned(),
    })
}
