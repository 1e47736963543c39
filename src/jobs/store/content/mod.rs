//! Large content, apart from the rows, and what keeps it together with them.

pub(in crate::jobs::store) mod ballast;
mod bring;
pub(in crate::jobs::store) mod bucket;
pub(in crate::jobs::store) mod clouds;
pub(in crate::jobs::store) mod embedded;
pub(in crate::jobs::store) mod graves;
pub(in crate::jobs::store) mod lift;
pub(in crate::jobs::store) mod objects;
pub(in crate::jobs::store) mod place;
pub(in crate::jobs::store) mod shelf;
