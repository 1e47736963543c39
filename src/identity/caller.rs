//! Who sent a request.

use std::net::IpAddr;
use std::sync::Arc;

use super::{Scope, Scopes, Tenant};

/// Who acts, as the audit trail names them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Actor {
    /// Anybody: the service has no keys, so it cannot tell, and writes no audit trail.
    Anybody,
    /// Somebody without a key that is good.
    Stranger,
    /// The service itself: what has expired is erased, and what was cut is finished.
    Service,
    /// The holder of a key.
    Key {
        /// Name in the configuration.
        name: Arc<str>,
        /// First digits of the key's hash.
        id: Arc<str>,
    },
}

/// Who sent a request, and from where. Cheap to clone.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Caller {
    /// Whose records are meant.
    pub tenant: Tenant,
    /// What is allowed.
    pub scopes: Scopes,
    /// Who it is.
    pub actor: Actor,
    /// The other end of the connection.
    pub address: Option<IpAddr>,
    /// The id of the request.
    pub request: Arc<str>,
}

impl Caller {
    /// Whoever asks a service without keys.
    pub fn anybody() -> Self {
        Self {
            tenant: Tenant::default(),
            scopes: Scopes::all(),
            actor: Actor::Anybody,
            address: None,
            request: "".into(),
        }
    }

    /// Somebody without a good key: may do nothing, in the name of nobody.
    pub fn stranger() -> Self {
        Self {
            scopes: Scopes::default(),
            actor: Actor::Stranger,
            ..Self::anybody()
        }
    }

    /// The service itself, in the name of a tenant.
    pub fn service(tenant: Tenant) -> Self {
        Self {
            tenant,
            actor: Actor::Service,
            ..Self::anybody()
        }
    }

    /// The same, for the request of this id from this address.
    #[must_use]
    pub fn asking(self, address: Option<IpAddr>, request: &str) -> Self {
        Self {
            address,
            request: request.into(),
            ..self
        }
    }

    /// Whether the caller may do this.
    pub fn may(&self, scope: Scope) -> bool {
        self.scopes.has(scope)
    }
}
