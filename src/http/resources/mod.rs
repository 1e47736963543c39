//! The resources: clouds, jobs, batches of them, what comes out of jobs, how long they are kept, who asked for
//! it, and who is told of it.

pub(in crate::http) mod batches;
pub(in crate::http) mod clouds;
pub(in crate::http) mod events;
pub(in crate::http) mod field;
pub(in crate::http) mod jobs;
pub(in crate::http) mod meshes;
pub(in crate::http) mod retention;
pub(in crate::http) mod series;
pub(in crate::http) mod session;
pub(in crate::http) mod trust;
pub(in crate::http) mod uploads;
pub(in crate::http) mod webhooks;
mod witness;
