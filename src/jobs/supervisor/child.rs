//! One worker process, from its start to its end.

use std::io;
use std::os::unix::process::ExitStatusExt;
use std::process::{ExitStatus, Stdio};
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};
use tokio::io::{AsyncBufReadExt, AsyncWriteExt, BufReader, Lines};
use tokio::process::{ChildStdin, ChildStdout, Command};
use tokio::time::MissedTickBehavior;

use super::{Living, Options, Supervisor};
use crate::jobs::FailureReason;
use crate::jobs::worker::{SIGN_OF_LIFE, worker_name};
use crate::process::resident_bytes;

/// Time between two checks of the memory. A worker can exceed its limit by what it takes in this
/// time.
const MEMORY_LOOK: Duration = Duration::from_millis(250);
/// How long to wait for a full pipe. After that the worker wakes by its own poll.
const WRITE_PATIENCE: Duration = Duration::from_millis(100);

/// A worker process and its pipes.
pub(super) struct Child {
    name: String,
    process: tokio::process::Child,
    /// Dropped to say that the service stops.
    stdin: Option<ChildStdin>,
    stdout: Lines<BufReader<ChildStdout>>,
}

impl Child {
    pub(super) async fn spawn(options: &Options, slot: u16) -> io::Result<Self> {
        let mut process = Command::new(&options.program)
            .args(&options.arguments)
            .arg("--slot")
            .arg(slot.to_string())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .kill_on_drop(true)
            .spawn()?;
        let stdin = process.stdin.take();
        let stdout = process.stdout.take();
        let (Some(pid), Some(mut stdin), Some(stdout)) = (process.id(), stdin, stdout) else {
            return Err(io::Error::other("the worker has no pipes"));
        };
        let orders = format!("{}\n", options.orders);
        stdin.write_all(orders.as_bytes()).await?;
        Ok(Self {
            name: worker_name(slot, pid, &options.node),
            process,
            stdin: Some(stdin),
            stdout: BufReader::new(stdout).lines(),
        })
    }

    pub(super) fn name(&self) -> &str {
        &self.name
    }

    /// Stays with the worker: wakes it, passes its news on, limits its memory, and ends it at the
    /// shutdown or when it is condemned. Returns why it ended, for the job that it leaves.
    pub(super) async fn attend(
        mut self,
        supervisor: &Supervisor,
        living: &Living,
    ) -> FailureReason {
        let mut ring = supervisor.ring.subscribe();
        let mut look = tokio::time::interval(MEMORY_LOOK);
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut killed = None;
        let mut talking = true;
        let deadline = async {
            supervisor.shutdown.cancelled().await;
            tokio::time::sleep(supervisor.options.drain).await;
        };
        tokio::pin!(deadline);
        loop {
            tokio::select! {
                status = self.process.wait() => {
                    return killed.unwrap_or_else(|| crash(status.ok()));
                }
                line = self.stdout.next_line(), if talking => match line {
                    Ok(Some(line)) => {
                        living.pulse.heard();
                        if line != SIGN_OF_LIFE {
                            supervisor.store.wake();
                        }
                    }
                    Ok(None) | Err(_) => talking = false,
                },
                Ok(()) = ring.changed() => self.wake().await,
                _ = look.tick(), if killed.is_none() => {
                    killed = self.check_memory(supervisor.options.memory_limit_bytes);
                }
                () = living.condemned.cancelled(), if killed.is_none() => {
                    self.kill();
                    killed = Some(FailureReason::Unresponsive);
                }
                () = supervisor.shutdown.cancelled(), if self.stdin.is_some() => self.terminate(),
                () = &mut deadline, if killed.is_none() => {
                    tracing::error!(worker = %self.name, "a worker does not end; it is killed");
                    self.kill();
                    killed = Some(FailureReason::Unresponsive);
                }
            }
        }
    }

    async fn wake(&mut self) {
        if let Some(stdin) = &mut self.stdin {
            // If the pipe is full or broken, the worker's own poll wakes it.
            drop(tokio::time::timeout(WRITE_PATIENCE, stdin.write_all(b".")).await);
        }
    }

    fn check_memory(&mut self, limit: Option<u64>) -> Option<FailureReason> {
        let limit_bytes = limit?;
        let resident = resident_bytes(self.process.id()?)?;
        if resident <= limit_bytes {
            return None;
        }
        tracing::warn!(worker = %self.name, resident, limit_bytes, "a worker takes too much memory");
        self.kill();
        Some(FailureReason::OutOfMemory { limit_bytes })
    }

    /// Asks the worker to give its job back and to end.
    fn terminate(&mut self) {
        self.stdin = None;
        let pid = self.process.id().and_then(|pid| Pid::from_raw(pid as i32));
        // A worker that has ended needs no signal.
        if let Some(Err(error)) = pid.map(|pid| kill_process(pid, Signal::TERM)) {
            tracing::debug!(worker = %self.name, error.message = %error, "no signal was sent");
        }
    }

    fn kill(&mut self) {
        if let Err(error) = self.process.start_kill() {
            tracing::debug!(worker = %self.name, error.message = %error, "nothing was killed");
        }
    }
}

fn crash(status: Option<ExitStatus>) -> FailureReason {
    FailureReason::WorkerCrashed {
        signal: status.and_then(|status| status.signal()),
        exit_code: status.and_then(|status| status.code()),
    }
}
