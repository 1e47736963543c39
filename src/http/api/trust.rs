//! Keys, and rows of the audit trail.

use std::collections::HashMap;

use serde::Serialize;

use super::Time;
use crate::identity;
use crate::jobs;

/// A key, which nobody can make of this.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Key<'a> {
    name: &'a str,
    id: String,
    tenant: &'a str,
    scopes: Vec<&'static str>,
    networks: Vec<String>,
    limits: identity::Limits,
    in_file: bool,
    expires_at: Option<Time>,
    last_used_at: Option<Time>,
}

impl<'a> Key<'a> {
    /// The key; `uses` says when each was used last, by its id.
    pub(in crate::http) fn new(key: &'a identity::Key, uses: &HashMap<String, i64>) -> Self {
        let id = key.hash.id();
        Self {
            name: &key.name,
            tenant: key.tenant.as_str(),
            scopes: key.scopes.iter().map(identity::Scope::name).collect(),
            networks: key.networks.iter().map(ToString::to_string).collect(),
            limits: key.limits,
            in_file: key.in_file,
            expires_at: key.expires.map(Time),
            last_used_at: uses.get(&id).copied().map(Time),
            id,
        }
    }
}

/// A key that was just made, with its text, this once.
#[derive(Debug, Serialize)]
pub(in crate::http) struct NewKey<'a> {
    /// The text.
    pub(in crate::http) key: &'a str,
    /// What it is.
    #[serde(flatten)]
    pub(in crate::http) what: Key<'a>,
}

/// Who a request comes from, as it may know itself.
#[derive(Debug, Serialize)]
pub(in crate::http) struct Session<'a> {
    name: Option<&'a str>,
    tenant: &'a str,
    scopes: Vec<&'static str>,
}

impl<'a> From<&'a identity::Caller> for Session<'a> {
    fn from(caller: &'a identity::Caller) -> Self {
        Self {
            name: caller.actor.name(),
            tenant: caller.tenant.as_str(),
            scopes: caller.scopes.iter().map(identity::Scope::name).collect(),
        }
    }
}

/// A row of the audit trail.
#[derive(Debug, Serialize)]
pub(in crate::http) struct AuditRow<'a> {
    seq: i64,
    time: Time,
    actor: Option<&'a str>,
    key: Option<&'a str>,
    address: Option<&'a str>,
    action: &'a str,
    event: &'a str,
    object: &'a str,
    outcome: i64,
    request: &'a str,
    hash: &'a str,
}

impl<'a> From<&'a jobs::AuditRow> for AuditRow<'a> {
    fn from(row: &'a jobs::AuditRow) -> Self {
        Self {
            seq: row.seq,
            time: Time(row.at),
            actor: row.actor.as_deref(),
            key: row.key.as_deref(),
            address: row.address.as_deref(),
            action: &row.action,
            event: &row.event,
            object: &row.object,
            outcome: row.outcome,
            request: &row.request,
            hash: &row.hash,
        }
    }
}
