//! The resources: clouds, jobs, and what comes out of jobs.

pub(in crate::http) mod clouds;
pub(in crate::http) mod events;
pub(in crate::http) mod field;
pub(in crate::http) mod jobs;
pub(in crate::http) mod meshes;
pub(in crate::http) mod series;
