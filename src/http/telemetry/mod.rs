//! Metrics of requests, for `/metrics` only.

pub(in crate::http) mod gauges;
mod process;
mod queue;
pub(in crate::http) mod workers;

use std::sync::Mutex;

use prometheus_client::encoding::EncodeLabelSet;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::histogram::Histogram;
use prometheus_client::registry::Registry;

use process::Process;

/// Upper bounds of the durations in seconds: from a look at a job to a large upload.
const DURATIONS: [f64; 12] = [
    0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 60.0, 300.0,
];

/// Labels of a request. The route is the pattern, not the path: ids would create a series for each
/// job.
#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RequestLabels {
    method: &'static str,
    route: String,
    status: u16,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, EncodeLabelSet)]
struct RouteLabels {
    method: &'static str,
    route: String,
}

/// The metrics of one server; a test has its own.
#[derive(Debug)]
pub struct Telemetry {
    /// All metrics, for `/metrics`.
    pub registry: Mutex<Registry>,
    process: Process,
    requests: Family<RequestLabels, Counter>,
    durations: Family<RouteLabels, Histogram>,
}

impl Default for Telemetry {
    fn default() -> Self {
        let mut registry = Registry::default();
        let process = Process::new(&mut registry);
        let own = own(&mut registry);
        let requests = Family::<RequestLabels, Counter>::default();
        let durations =
            Family::<RouteLabels, Histogram>::new_with_constructor(|| Histogram::new(DURATIONS));
        own.register("http_requests", "Requests answered", requests.clone());
        own.register(
            "http_request_duration_seconds",
            "Time to the head of the answer",
            durations.clone(),
        );
        Self {
            registry: Mutex::new(registry),
            process,
            requests,
            durations,
        }
    }
}

/// Where metrics of the service itself go: their names begin with its own.
pub(in crate::http) fn own(registry: &mut Registry) -> &mut Registry {
    registry.sub_registry_with_prefix("meshway")
}

impl Telemetry {
    /// Reads what is read when it is asked for.
    pub(in crate::http) fn refresh(&self) {
        self.process.refresh();
    }

    /// Counts an answered request.
    pub(in crate::http) fn answered(
        &self,
        method: &'static str,
        route: &str,
        status: u16,
        seconds: f64,
    ) {
        let route = route.to_owned();
        self.durations
            .get_or_create(&RouteLabels {
                method,
                route: route.clone(),
            })
            .observe(seconds);
        self.requests
            .get_or_create(&RequestLabels {
                method,
                route,
                status,
            })
            .inc();
    }
}
