//! An object store that a test may kill, stop and start again.

use std::fs;
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};
use tempfile::TempDir;

use crate::place::{Bucket, told};
use crate::server::{PATIENCE, until};

/// The server of an object store, with its objects in a folder of its own.
pub(crate) struct S3 {
    program: String,
    dir: TempDir,
    address: SocketAddr,
    child: Child,
}

impl S3 {
    /// Starts one; none, and said so, where there is no program for it.
    pub(crate) async fn start() -> Option<Self> {
        let program = told("MESHWAY_TEST_S3_SERVER")?;
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("tests")).unwrap();
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = free.local_addr().unwrap();
        drop(free);
        let child = run(&program, address, dir.path());
        let s3 = Self {
            program,
            dir,
            address,
            child,
        };
        s3.answers().await;
        Some(s3)
    }

    /// A part of it.
    pub(crate) fn bucket(&self) -> Bucket {
        Bucket {
            url: format!(
                "s3://tests/here?endpoint=http://{}&region=us-east-1",
                self.address
            ),
            folder: self.dir.path().join("tests/here"),
        }
    }

    /// Ends it without warning.
    pub(crate) fn kill(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }

    /// Starts it again, with the objects that it had.
    pub(crate) async fn restart(&mut self) {
        self.child = run(&self.program, self.address, self.dir.path());
        self.answers().await;
    }

    /// Has it stop or go on.
    pub(crate) fn signal(&self, signal: Signal) {
        let pid = Pid::from_raw(self.child.id() as i32).unwrap();
        kill_process(pid, signal).unwrap();
    }

    async fn answers(&self) {
        until("the object store answers", PATIENCE, async || {
            TcpStream::connect(self.address).ok()
        })
        .await;
    }
}

impl Drop for S3 {
    fn drop(&mut self) {
        // One that has ended is not killed.
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn run(program: &str, address: SocketAddr, folder: &Path) -> Child {
    let credential = |name: &str| std::env::var_os(name).unwrap();
    Command::new(program)
        .args(["--host", "127.0.0.1", "--port", &address.port().to_string()])
        .arg("--access-key")
        .arg(credential("AWS_ACCESS_KEY_ID"))
        .arg("--secret-key")
        .arg(credential("AWS_SECRET_ACCESS_KEY"))
        .arg(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap()
}
