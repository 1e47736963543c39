//! Metrics of the worker processes of a process, and of what program it is.

use std::sync::atomic::Ordering;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::info::Info;
use prometheus_client::registry::Registry;

use crate::jobs::Workers;

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ByState {
    state: &'static str,
}

/// What is told of workers.
#[derive(Debug, Clone, Default)]
pub(in crate::http) struct WorkerGauges {
    workers: Family<ByState, Gauge>,
    restarts: Counter,
}

impl WorkerGauges {
    /// Adds them to the registry.
    pub(in crate::http) fn register(&self, registry: &mut Registry) {
        let build = Info::new([("version", env!("CARGO_PKG_VERSION"))]);
        registry.register("build", "Version of the service", build);
        registry.register("workers", "Worker processes", self.workers.clone());
        let help = "Workers started again";
        registry.register("worker_restarts", help, self.restarts.clone());
    }

    /// What the supervisor says of them.
    pub(in crate::http) fn set(&self, workers: Workers) {
        for (state, count) in [
            ("busy", workers.busy),
            ("idle", workers.idle),
            ("starting", workers.starting),
        ] {
            let gauge = self.workers.get_or_create(&ByState { state });
            gauge.set(count.into());
        }
        let restarts = self.restarts.inner();
        restarts.store(workers.restarts, Ordering::Relaxed);
    }
}
