//! How jobs are worked on: what `meshway serve` and `meshway worker` have in common.

use clap::Args;
use serde::Serialize;

use super::{LogFormat, MIB};

/// Memory of a worker besides grid and training: program, libtorch, cloud.
const BASE_MIB: u64 = 256;

/// Least memory of a worker: a job of the preset `fast` fits.
const LEAST_MIB: u64 = 288;

/// Settings of workers.
#[derive(Debug, Clone, Serialize, Args)]
pub struct Work {
    /// Threads of each worker; 0: the cores shared out among the workers.
    #[arg(long, env = "MESHWAY_THREADS_PER_WORKER", default_value_t = 0)]
    pub threads_per_worker: u16,

    /// Most memory of a worker in MiB, above which it is killed; 0: no limit.
    #[arg(long, env = "MESHWAY_WORKER_MEMORY_MIB", default_value_t = 4_096)]
    pub worker_memory_mib: u64,

    /// Longest time that is worked on one job, in seconds, over all its attempts.
    #[arg(long, env = "MESHWAY_JOB_TIME_LIMIT_SECONDS", default_value_t = 3_600)]
    pub job_time_limit_seconds: u32,

    /// Seconds between checkpoints of a training run.
    #[arg(long, env = "MESHWAY_CHECKPOINT_SECONDS", default_value_t = 10)]
    pub checkpoint_seconds: u32,

    /// Most events kept for a job.
    #[arg(long, env = "MESHWAY_MAX_EVENTS", default_value_t = 100_000)]
    pub max_events: u32,

    /// Most metric rows kept for a job.
    #[arg(long, env = "MESHWAY_MAX_METRICS", default_value_t = 200_000)]
    pub max_metrics: u32,

    /// Format of the log.
    #[arg(long, env = "MESHWAY_LOG_FORMAT", default_value = "text", value_enum)]
    pub log_format: LogFormat,

    /// What is logged, as in `info,meshway=debug`.
    #[arg(long, env = "MESHWAY_LOG", default_value = "info")]
    pub log: String,
}

impl Work {
    /// Most memory of a worker in bytes; `None`: no limit.
    pub fn memory_bytes(&self) -> Option<u64> {
        (self.worker_memory_mib > 0).then_some(self.worker_memory_mib.saturating_mul(MIB))
    }

    /// Memory that a worker has for the grid of a job, and for its training; `None`: no limit.
    pub fn job_memory_bytes(&self) -> Option<u64> {
        Some(self.memory_bytes()?.saturating_sub(BASE_MIB * MIB))
    }

    /// Threads of each of so many workers on a machine with `cores`: together never more than the cores.
    pub fn threads(&self, cores: usize, workers: u16) -> usize {
        let share = (cores / usize::from(workers.max(1))).max(1);
        match usize::from(self.threads_per_worker) {
            0 => share,
            asked => asked.min(share),
        }
    }

    /// What contradicts the machine, each in one sentence; `flag` is the one that says how many workers.
    pub fn problems(&self, cores: usize, (flag, workers): (&str, u16)) -> Vec<String> {
        let mut problems = Vec::new();
        let asked = usize::from(workers) * usize::from(self.threads_per_worker.max(1));
        if asked > cores {
            problems.push(format!(
                "{flag} {workers} with --threads-per-worker {} take {asked} threads, but there are \
                 {cores} cores",
                self.threads_per_worker
            ));
        }
        if (1..LEAST_MIB).contains(&self.worker_memory_mib) {
            problems.push(format!(
                "--worker-memory-mib {}: no job fits; give at least {LEAST_MIB}, or 0 for no limit",
                self.worker_memory_mib
            ));
        }
        problems
    }
}
