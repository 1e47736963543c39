//! Tests of the service. One binary, because linking libtorch is slow.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod checked;
mod clock;
mod data_folder;
mod erasure;
mod erasure_kinds;
mod faults;
mod format_jobs;
mod full_disk;
mod http;
mod kind_jobs;
mod medical_jobs;
mod moved;
mod objects;
mod on_postgres;
mod people;
mod place;
mod pooled;
mod receiver;
mod resumed;
mod s3;
mod server;
mod soak;
mod store;
mod swept;
mod texts;
mod trust;
mod turns;
mod upgraded;
mod webhooks;
mod who;
mod wire;
mod work;
