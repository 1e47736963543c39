//! What Prometheus knows of every process, by the names of its own libraries.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

use crate::process::usage;

/// The metrics of this process.
#[derive(Debug, Default)]
pub(super) struct Process {
    cpu: Counter<f64, AtomicU64>,
    resident: Gauge<i64, AtomicI64>,
    addresses: Gauge<i64, AtomicI64>,
    open: Gauge<i64, AtomicI64>,
    most: Gauge<i64, AtomicI64>,
    started: Gauge<f64, AtomicU64>,
}

impl Process {
    /// New ones, known to the registry.
    pub(super) fn new(registry: &mut Registry) -> Self {
        let process = Self::default();
        let p = &process;
        registry.register("process_cpu_seconds", "Time on processors", p.cpu.clone());
        for (name, help, gauge) in [
            ("process_resident_memory_bytes", "Memory held", &p.resident),
            ("process_virtual_memory_bytes", "Addresses", &p.addresses),
            ("process_open_fds", "Open files and connections", &p.open),
            ("process_max_fds", "Most of them", &p.most),
        ] {
            registry.register(name, help, gauge.clone());
        }
        let help = "Start, in seconds since the epoch";
        registry.register("process_start_time_seconds", help, p.started.clone());
        process.refresh();
        process
    }

    /// Reads them; they stay as they are where the system tells nothing.
    pub(super) fn refresh(&self) {
        let Some(usage) = usage() else { return };
        let cpu = usage.cpu_seconds.to_bits();
        self.cpu.inner().store(cpu, Ordering::Relaxed);
        self.resident.set(usage.resident_bytes as i64);
        self.addresses.set(usage.virtual_bytes as i64);
        self.open.set(usage.open_files as i64);
        self.most
            .set(usage.most_files.map_or(-1, |most| most as i64));
        self.started.set(usage.started_seconds);
    }
}
