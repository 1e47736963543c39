//! Sends what the outbox holds to the webhooks of tenants, as Standard Webhooks 1.0 has it
//! (<https://www.standardwebhooks.com>).
//!
//! A message is a row that was written in the transaction of what it tells of, so none is lost and none
//! tells of what did not happen. [`Sender`] has a task of its own: a receiver that is slow or dead delays
//! no job and no other receiver. Each message is sent at least once, always with the same id.
//!
//! An address of a webhook comes from a client, so that it must not lead the service to places that only
//! the service can reach. A name is resolved once, every address it stands for is held against the
//! [`Policy`], and the connection goes to an address that was checked: a name that stands for something
//! else a moment later changes nothing. No redirect is followed and no proxy is used.

mod policy;
mod post;
mod schedule;
mod sender;
mod signature;

pub use policy::Policy;
pub use post::{Post, Resolve, TrustError};
pub use sender::Sender;
pub use signature::Secret;
