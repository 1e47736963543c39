//! HTTP itself, independent of the resource: reading parts of requests, writing answers and problems,
//! pages, ranges, tags, idempotency keys.

pub(in crate::http) mod accept;
pub(in crate::http) mod catalogue;
pub(in crate::http) mod download;
pub mod error;
pub(in crate::http) mod extract;
pub(in crate::http) mod idempotency;
pub(in crate::http) mod page;
pub(in crate::http) mod quota;
pub(in crate::http) mod request_id;
