//! Tests of the service. One binary, because linking libtorch is slow.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod clock;
mod cluster;
mod cut;
mod data_folder;
mod erasure;
mod erasure_kinds;
mod faults;
mod format_jobs;
mod full_disk;
mod http;
mod kind_jobs;
mod medical_jobs;
mod nodes;
mod objects;
mod on_postgres;
mod people;
mod place;
mod postgres;
mod proxy;
mod receiver;
mod resumed;
mod s3;
mod server;
mod soak;
mod store;
mod storm;
mod swept;
mod texts;
mod trust;
mod turns;
mod webhooks;
mod who;
mod wire;
mod work;
