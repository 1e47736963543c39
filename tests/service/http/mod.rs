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
mod labels;
mod lists;
mod meshes;
mod points;
mod resumable;
mod retention;
mod sessions;
mod spaces;
pub(crate) mod support;
mod system;
pub(crate) mod tenants;
mod trail;
mod unfinished;
mod uploads;
mod verdicts;
mod waits;
mod web;
