//! Tests of the service. One binary, because linking libtorch is slow.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod data_folder;
mod erasure;
mod faults;
mod format_jobs;
mod full_disk;
mod http_clouds;
mod http_contract;
mod http_costs;
mod http_door;
mod http_edges;
mod http_events;
mod http_idempotency;
mod http_jobs;
mod http_lists;
mod http_meshes;
mod http_support;
mod http_system;
mod http_uploads;
mod http_verdicts;
mod http_waits;
mod kind_jobs;
mod server;
mod soak;
mod store_attempts;
mod store_catalogue;
mod store_content;
mod store_life;
mod store_machine;
mod store_migrations;
mod store_support;
mod store_writer;
mod wire;
mod work;
