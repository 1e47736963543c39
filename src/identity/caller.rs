//! Who sent a request.

use std::borrow::Cow;
use std::net::IpAddr;
use std::sync::Arc;

use super::{Allowance, Scope, Scopes, Tenant};

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
    /// Somebody who signed in with a password.
    User {
        /// Name in the configuration.
        name: Arc<str>,
    },
}

impl Actor {
    /// Name in the configuration; none for who has none.
    pub fn name(&self) -> Option<&str> {
        match self {
            Self::Anybody | Self::Stranger | Self::Service => None,
            Self::Key { name, .. } | Self::User { name } => Some(name),
        }
    }
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
    /// What may be taken.
    pub allowance: Allowance,
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
            allowance: Allowance::default(),
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

    /// What limits are counted by: the id of the key, or the name of the user; empty for others.
    pub fn account(&self) -> Cow<'_, str> {
        match &self.actor {
            Actor::Anybody | Actor::Stranger | Actor::Service => Cow::Borrowed(""),
            Actor::Key { id, .. } => Cow::Borrowed(id),
            // No id of a key has a colon.
            Actor::User { name } => Cow::Owned(format!("user:{name}")),
        }
    }

    /// Whether the caller may do this.
    pub fn may(&self, scope: Scope) -> bool {
        self.scopes.has(scope)
    }
}
