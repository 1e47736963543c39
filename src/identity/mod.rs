//! Who asks, and what they may: tenants, scopes, keys, and the caller whom a key stands for.
//!
//! Nothing here knows of HTTP or of rows. A [`Keyring`] is read from the configuration file and turns
//! the text of a key into a [`Caller`], which travels through the handlers into the store: what
//! belongs to a tenant can only be asked for in the name of one.

mod caller;
mod doubts;
pub mod file;
mod key;
mod keyring;
mod limits;
mod scope;
mod tenant;
mod user;

pub use caller::{Actor, Caller};
pub(crate) use file::told;
pub use key::{KeyHash, Secret};
pub use keyring::{Key, KeyFault, Keyring, Refusal};
pub use limits::{Allowance, Holder, Limits, Measure, Policy};
pub use scope::{Scope, Scopes};
pub use tenant::{InvalidTenant, Tenant};
pub use user::{LEAST_PASSWORD, MOST_PASSWORD, Password, User};
