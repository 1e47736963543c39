//! Metrics of what waits and of who may take it: what scales workers. All nodes tell the same.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicU64;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;

use crate::http::App;
use crate::jobs::{Result, Role};

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct Waiting {
    tenant: String,
    /// By the time that the work is estimated to take.
    size: &'static str,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct ByRole {
    role: &'static str,
}

type Number = Gauge<f64, AtomicU64>;

/// What is told of the queue and of all processes.
#[derive(Debug, Default)]
pub(in crate::http) struct QueueGauges {
    oldest: Number,
    jobs: Family<Waiting, Gauge>,
    ages: Family<Waiting, Number>,
    nodes: Family<ByRole, Gauge>,
    slots: Gauge,
}

impl QueueGauges {
    /// Adds them to the registry.
    pub(in crate::http) fn register(&self, registry: &mut Registry) {
        let help = "Age of the first in the queue";
        registry.register("queue_oldest_age_seconds", help, self.oldest.clone());
        let help =
            "Jobs that wait, by tenant and estimated work: short < 1 min, medium < 10 min, long";
        registry.register("queue_jobs", help, self.jobs.clone());
        let help = "Age of the first of them";
        registry.register("queue_age_seconds", help, self.ages.clone());
        let help = "Processes with these records, by what they do";
        registry.register("nodes", help, self.nodes.clone());
        let help = "Jobs that all processes work on at the same time";
        registry.register("slots", help, self.slots.clone());
    }

    /// Reads them.
    ///
    /// # Errors
    /// Those of the store.
    pub(in crate::http) async fn refresh(&self, app: &App) -> Result<()> {
        let now = app.store.now();
        let age = |since: i64| (now - since).max(0) as f64 / 1e3;
        let oldest = app.store.oldest_queued().await?;
        self.oldest.set(oldest.map_or(0.0, age));
        // Tenants come and go with their jobs.
        self.jobs.clear();
        self.ages.clear();
        for found in app.store.waiting().await? {
            let label = Waiting {
                tenant: found.tenant.to_string(),
                size: found.size,
            };
            self.jobs.get_or_create(&label).set(found.jobs as i64);
            self.ages.get_or_create(&label).set(age(found.oldest_at));
        }
        let (nodes, slots) = if app.store.is_shared() {
            app.store.nodes().await?
        } else {
            (
                BTreeMap::from([(Role::Serve, 1)]),
                app.config.workers.into(),
            )
        };
        for role in Role::ALL {
            let label = ByRole { role: role.name() };
            let count = nodes.get(&role).copied().unwrap_or_default();
            self.nodes.get_or_create(&label).set(count as i64);
        }
        self.slots.set(slots as i64);
        Ok(())
    }
}
