//! A network between two processes that a test may cut, stall and slow down.

use std::net::{SocketAddr, ToSocketAddrs};
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio_util::task::AbortOnDropHandle;

/// What becomes of bytes on their way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Way {
    /// They pass.
    Open,
    /// Connections end, and new ones end at once.
    Cut,
    /// No byte passes, and no connection ends.
    Stalled,
    /// Questions pass and answers do not.
    HalfOpen,
    /// So many bytes pass in a second, in each direction of each connection.
    Slow(usize),
}

/// Time between two portions on a slow way.
const PORTION: Duration = Duration::from_millis(50);

/// A way to an address.
pub(crate) struct Proxy {
    address: SocketAddr,
    target: SocketAddr,
    way: watch::Sender<Way>,
    _task: AbortOnDropHandle<()>,
}

impl Proxy {
    /// An open way to the host and port in an address of any kind.
    pub(crate) async fn to(url: &str) -> Self {
        let target = host_of(url).to_socket_addrs().unwrap().next().unwrap();
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let (way, watched) = watch::channel(Way::Open);
        let task = tokio::spawn(async move {
            loop {
                let (client, _) = listener.accept().await.unwrap();
                tokio::spawn(connect(client, target, watched.clone()));
            }
        });
        Self {
            address,
            target,
            way,
            _task: AbortOnDropHandle::new(task),
        }
    }

    /// Makes the way so.
    pub(crate) fn set(&self, way: Way) {
        self.way.send_replace(way);
    }

    /// The address with this way in it.
    pub(crate) fn instead_of(&self, url: &str) -> String {
        let (target, address) = (self.target.to_string(), self.address.to_string());
        assert!(url.contains(&target), "{url} has no {target}");
        url.replace(&target, &address)
    }
}

/// The last `127.0.0.1:PORT` in a text.
fn host_of(url: &str) -> String {
    let (_, rest) = url.rsplit_once("127.0.0.1:").unwrap();
    let port: String = rest.chars().take_while(char::is_ascii_digit).collect();
    format!("127.0.0.1:{port}")
}

async fn connect(client: TcpStream, target: SocketAddr, mut way: watch::Receiver<Way>) {
    let Ok(server) = TcpStream::connect(target).await else {
        return;
    };
    let ((from_client, to_client), (from_server, to_server)) =
        (client.into_split(), server.into_split());
    let passes = [
        |way| matches!(way, Way::Open | Way::Slow(_) | Way::HalfOpen),
        |way| matches!(way, Way::Open | Way::Slow(_)),
    ];
    tokio::select! {
        () = pass(from_client, to_server, way.clone(), passes[0]) => {}
        () = pass(from_server, to_client, way.clone(), passes[1]) => {}
        _ = way.wait_for(|way| *way == Way::Cut) => {}
    }
}

/// Passes bytes on while they may pass.
async fn pass(
    mut from: OwnedReadHalf,
    mut to: OwnedWriteHalf,
    mut way: watch::Receiver<Way>,
    passes: fn(Way) -> bool,
) {
    let mut bytes = vec![0; 64 << 10];
    loop {
        if way.wait_for(|way| passes(*way)).await.is_err() {
            return;
        }
        let most = match *way.borrow() {
            Way::Slow(rate) => (rate / 20).clamp(1, bytes.len()),
            _ => bytes.len(),
        };
        let Ok(read @ 1..) = from.read(&mut bytes[..most]).await else {
            return;
        };
        // What was read when the way was stalled waits here.
        if way.wait_for(|way| passes(*way)).await.is_err() {
            return;
        }
        if to.write_all(&bytes[..read]).await.is_err() {
            return;
        }
        if most < bytes.len() {
            tokio::time::sleep(PORTION).await;
        }
    }
}
