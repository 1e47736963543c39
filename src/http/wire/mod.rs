//! What HTTP itself asks for, whatever the resource: parts of a request read, answers and problems
//! written, pages, ranges, tags, keys against repetition.

pub(in crate::http) mod accept;
pub(in crate::http) mod catalogue;
pub(in crate::http) mod download;
pub mod error;
pub(in crate::http) mod extract;
pub(in crate::http) mod idempotency;
pub(in crate::http) mod page;
pub(in crate::http) mod time;
