//! PyTorch and JAX in a process of their own.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Evaluations of a peer in one turn.
const REPETITIONS: usize = 10;

/// A running `peers.py`.
pub(super) struct Peers {
    child: Child,
    requests: ChildStdin,
    answers: BufReader<ChildStdout>,
}

impl Peers {
    /// Starts it with the Python that has the peers; `None` where that is not installed.
    pub(super) fn start() -> Option<Self> {
        let root = env!("CARGO_MANIFEST_DIR");
        let mut child = Command::new(format!("{root}/target/engines-venv/bin/python"))
            .arg(format!("{root}/benches/engines/peers.py"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .ok()?;
        let mut peers = Self {
            requests: child.stdin.take()?,
            answers: BufReader::new(child.stdout.take()?),
            child,
        };
        println!("PyTorch and JAX: {}\n", peers.answer());
        Some(peers)
    }

    /// Seconds of its fastest evaluation.
    pub(super) fn fastest(&mut self, peer: &str, points: usize, width: usize) -> f64 {
        writeln!(self.requests, "{peer} {points} {width} {REPETITIONS}")
            .expect("the peers are running");
        self.answer()
            .parse()
            .expect("the peers answer with seconds")
    }

    fn answer(&mut self) -> String {
        let mut line = String::new();
        self.answers
            .read_line(&mut line)
            .expect("the peers write text");
        line.trim().to_owned()
    }
}

impl Drop for Peers {
    fn drop(&mut self) {
        // It is of no use without us, whatever it is doing.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
