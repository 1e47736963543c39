//! HTTP/1.1 over a plain connection: as much of a client as the soak and the benchmark need, so
//! that what they measure is the server.

use std::io::{Error, ErrorKind, Result};
use std::net::SocketAddr;

use serde_json::Value;
use tokio::io::{AsyncBufReadExt, AsyncReadExt, AsyncWriteExt, BufReader};
use tokio::net::TcpStream;

/// A connection that is kept for one request after the other.
pub(crate) struct Connection(pub(crate) BufReader<TcpStream>);

/// An answer with its whole body.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    /// The body as JSON; null where it is none.
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_default()
    }
}

impl Connection {
    pub(crate) async fn open(address: SocketAddr) -> Result<Self> {
        let stream = TcpStream::connect(address).await?;
        stream.set_nodelay(true)?;
        Ok(Self(BufReader::new(stream)))
    }

    /// Sends a request and reads its answer. `line` is `METHOD PATH`, `headers` are further header
    /// lines, each with its end; the body comes in pieces.
    pub(crate) async fn ask(
        &mut self,
        line: &str,
        headers: &str,
        body: &[&[u8]],
    ) -> Result<Answer> {
        self.send(line, headers, body).await?;
        let (status, length) = self.read_head().await?;
        let mut body = vec![0; length];
        self.0.read_exact(&mut body).await?;
        Ok(Answer { status, body })
    }

    /// [`Connection::ask`] with JSON.
    pub(crate) async fn post(&mut self, path: &str, headers: &str, body: &Value) -> Result<Answer> {
        let headers = format!("Content-Type: application/json\r\n{headers}");
        let body = body.to_string();
        self.ask(&format!("POST {path}"), &headers, &[body.as_bytes()])
            .await
    }

    pub(crate) async fn send(&mut self, line: &str, headers: &str, body: &[&[u8]]) -> Result<()> {
        let length: usize = body.iter().map(|piece| piece.len()).sum();
        let head = format!(
            "{line} HTTP/1.1\r\nHost: localhost\r\nContent-Length: {length}\r\n{headers}\r\n"
        );
        let mut request = head.into_bytes();
        // One write where the body is small, as clients do.
        let mut pieces = body.iter();
        request.extend_from_slice(pieces.next().unwrap_or(&[].as_slice()));
        self.0.write_all(&request).await?;
        for piece in pieces {
            self.0.write_all(piece).await?;
        }
        Ok(())
    }

    /// The status, and how long the body is; zero where its length is not given.
    pub(crate) async fn read_head(&mut self) -> Result<(u16, usize)> {
        let wrong = |line: &str| Error::new(ErrorKind::InvalidData, line.to_owned());
        let first = self.read_line().await?;
        let status = first.split(' ').nth(1).and_then(|code| code.parse().ok());
        let status = status.ok_or_else(|| wrong(&first))?;
        let mut length = 0;
        loop {
            let line = self.read_line().await?;
            if line.is_empty() {
                return Ok((status, length));
            }
            // The server writes the names of headers in lower case.
            if let Some(value) = line.strip_prefix("content-length: ") {
                length = value.parse().map_err(|_| wrong(&line))?;
            }
        }
    }

    /// A line without its end.
    pub(crate) async fn read_line(&mut self) -> Result<String> {
        let mut line = String::new();
        if self.0.read_line(&mut line).await? == 0 {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        line.truncate(line.trim_end().len());
        Ok(line)
    }
}
