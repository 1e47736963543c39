//! What contradicts itself or the machine.

use super::{ClientAuth, Config};

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
        problems.extend(self.work.problems(cores, ("--workers", self.workers)));
        problems.extend(self.backend.exposures());
        problems
    }
}
