//! The door: connections, and what is around every request before and after its handler.

pub(in crate::http) mod observe;
pub(in crate::http) mod origin;
pub(in crate::http) mod places;
pub(in crate::http) mod server;
