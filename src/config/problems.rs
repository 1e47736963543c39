//! What contradicts itself or the machine.

use super::{ClientAuth, Config};

/// Least memory of a worker: a job of the preset `fast` fits.
const LEAST_WORKER_MIB: u64 = 288;

impl Config {
    /// What contradicts itself or the machine, each in one sentence.
    pub fn problems(&self, cores: usize) -> Vec<String> {
        let mut problems = Vec::new();
        let shown = self.tls_client_ca.is_some() && self.tls_client_auth == ClientAuth::Required;
        let known = shown || !self.keys.is_empty();
        if !self.listen.ip().is_loopback() && !known && !self.allow_unauthenticated {
            problems.push(format!(
                "--listen {}: others can reach this address and there are no keys; put some into \
                 the file of --config (`meshway key new` makes them), listen on 127.0.0.1 behind a \
                 proxy that authenticates, or give --allow-unauthenticated",
                self.listen
            ));
        }
        if self.tls_cert.is_some() != self.tls_key.is_some() {
            problems.push("--tls-cert and --tls-key go together; give both or neither".to_owned());
        }
        if self.tls_client_ca.is_some() && self.tls_cert.is_none() {
            problems.push("--tls-client-ca needs --tls-cert and --tls-key".to_owned());
        }
        let asked = usize::from(self.workers) * usize::from(self.threads_per_worker.max(1));
        if asked > cores {
            problems.push(format!(
                "--workers {} with --threads-per-worker {} take {asked} threads, but there are \
                 {cores} cores",
                self.workers, self.threads_per_worker
            ));
        }
        if (1..LEAST_WORKER_MIB).contains(&self.worker_memory_mib) {
            problems.push(format!(
                "--worker-memory-mib {}: no job fits; give at least {LEAST_WORKER_MIB}, or 0 for \
                 no limit",
                self.worker_memory_mib
            ));
        }
        problems.extend(self.backend.exposures());
        problems
    }
}
