//! The API, asked in the same process unless a test says otherwise.

mod addresses;
mod clouds;
pub(crate) mod contract;
mod costs;
mod door;
mod edges;
mod events;
mod framing;
mod idempotency;
mod jobs;
mod key_api;
mod limits;
mod lists;
mod meshes;
mod passwords;
mod points;
mod sessions;
mod spaces;
pub(crate) mod support;
mod system;
pub(crate) mod tenants;
mod trail;
mod turns;
mod uploads;
mod verdicts;
mod waits;
mod web;
