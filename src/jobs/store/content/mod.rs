//! Large content, in a database of its own, and what keeps it together with the rows.

pub(in crate::jobs::store) mod ballast;
pub(in crate::jobs::store) mod graves;
pub(in crate::jobs::store) mod lift;
pub(in crate::jobs::store) mod objects;
