//! The rows, one file a noun.

pub(in crate::jobs::store) mod act;
pub(in crate::jobs::store) mod attempts;
pub(in crate::jobs::store) mod audit;
pub(in crate::jobs::store) mod batches;
pub(in crate::jobs::store) mod checkpoints;
pub(in crate::jobs::store) mod clouds;
pub(in crate::jobs::store) mod deliveries;
pub(in crate::jobs::store) mod events;
pub(in crate::jobs::store) mod handover;
pub(in crate::jobs::store) mod history;
pub(in crate::jobs::store) mod idempotency;
pub(in crate::jobs::store) mod jobs;
pub(in crate::jobs::store) mod keys;
pub(in crate::jobs::store) mod leases;
pub(in crate::jobs::store) mod meshes;
pub(in crate::jobs::store) mod metrics;
pub(in crate::jobs::store) mod nodes;
pub(in crate::jobs::store) mod outcome;
pub(in crate::jobs::store) mod queue;
pub(in crate::jobs::store) mod quotas;
pub(in crate::jobs::store) mod retention;
pub(in crate::jobs::store) mod row;
pub(in crate::jobs::store) mod sessions;
pub(in crate::jobs::store) mod tombstones;
pub(in crate::jobs::store) mod uploads;
pub(in crate::jobs::store) mod webhooks;
