//! A Postgres server of a test's own.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use crate::server::{PATIENCE, until};

/// A database server that may be killed.
pub(crate) struct Postgres {
    script: Child,
    pub(crate) url: String,
    data: PathBuf,
    start: String,
}

impl Postgres {
    /// Starts one.
    pub(crate) fn new() -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/postgres.sh");
        let told = "echo $MESHWAY_TEST_DATABASE; echo $MESHWAY_TEST_POSTGRES_DATA; \
                    echo $MESHWAY_TEST_POSTGRES_START; exec cat";
        let mut script = Command::new(script)
            .args(["sh", "-c", told])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(script.stdout.take().unwrap()).lines();
        let mut line = || lines.next().unwrap().unwrap();
        Self {
            url: line(),
            data: line().into(),
            start: line(),
            script,
        }
    }

    /// The server is killed, and its children end with it.
    pub(crate) fn kill(&self) {
        let pid = std::fs::read_to_string(self.data.join("postmaster.pid")).unwrap();
        let pid = pid.lines().next().unwrap().parse().unwrap();
        kill_process(Pid::from_raw(pid).unwrap(), Signal::KILL).unwrap();
    }

    /// It starts again, once what is left of the killed one is gone.
    pub(crate) async fn revive(&self) {
        until("the database starts again", PATIENCE, async || {
            let start = Command::new("sh").args(["-c", &self.start]).output();
            start.unwrap().status.success().then_some(())
        })
        .await;
    }
}

impl Drop for Postgres {
    fn drop(&mut self) {
        // The script stops the server at the end of its input.
        drop(self.script.stdin.take());
        drop(self.script.wait());
    }
}
