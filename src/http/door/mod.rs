//! The door: connections, and the layers around every handler.

pub(in crate::http) mod base;
mod client;
pub(in crate::http) mod head;
pub(in crate::http) mod keys;
pub(in crate::http) mod limits;
pub(in crate::http) mod observe;
pub(in crate::http) mod origin;
pub(in crate::http) mod passwords;
pub(in crate::http) mod places;
pub(in crate::http) mod server;
pub(in crate::http) mod sessions;
mod stream;
pub(in crate::http) mod tags;
pub(in crate::http) mod tls;
mod window;
