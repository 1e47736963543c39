//! How much a tenant, a key or a user may take.

use serde::{Deserialize, Serialize};

/// What may be taken; what is left out is not limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Requests in a minute.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requests_per_minute: Option<u32>,
    /// Jobs that wait.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub queued_jobs: Option<u32>,
    /// Clouds, meshes and networks together, in MiB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stored_mib: Option<u32>,
    /// Seconds of workers in a day (UTC).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub compute_seconds_per_day: Option<u32>,
}

/// What a caller may take: what its tenant may, and what its own key may of that.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Allowance {
    /// Of all keys and users of the tenant together.
    pub tenant: Limits,
    /// Of the key or the user.
    pub account: Limits,
}

/// Whose limit it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Holder {
    /// The tenant's.
    Tenant,
    /// The key's, or the user's.
    Account,
}

/// What is limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Measure {
    /// Requests.
    Requests,
    /// Waiting jobs.
    Queued,
    /// Bytes of content.
    Stored,
    /// Seconds of workers.
    Compute,
}

/// One limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Policy {
    /// Whose it is.
    pub holder: Holder,
    /// Of what.
    pub measure: Measure,
    /// How much.
    pub quota: u64,
}

impl Limits {
    fn of(self, measure: Measure) -> Option<u64> {
        let limit = |limit: Option<u32>| limit.map(u64::from);
        match measure {
            Measure::Requests => limit(self.requests_per_minute),
            Measure::Queued => limit(self.queued_jobs),
            Measure::Stored => limit(self.stored_mib).map(|mib| mib << 20),
            Measure::Compute => limit(self.compute_seconds_per_day),
        }
    }
}

impl Allowance {
    /// The limits of this kind, that of the tenant first.
    pub fn policies(self, measure: Measure) -> impl Iterator<Item = Policy> {
        let both = [
            (Holder::Tenant, self.tenant),
            (Holder::Account, self.account),
        ];
        both.into_iter().filter_map(move |(holder, limits)| {
            let quota = limits.of(measure)?;
            Some(Policy {
                holder,
                measure,
                quota,
            })
        })
    }
}

impl Policy {
    /// Its name in headers and problems.
    pub fn name(self) -> &'static str {
        match (self.holder, self.measure) {
            (Holder::Tenant, Measure::Requests) => "tenant-requests",
            (Holder::Tenant, Measure::Queued) => "tenant-queued-jobs",
            (Holder::Tenant, Measure::Stored) => "tenant-stored-bytes",
            (Holder::Tenant, Measure::Compute) => "tenant-compute-seconds",
            (Holder::Account, Measure::Requests) => "key-requests",
            (Holder::Account, Measure::Queued) => "key-queued-jobs",
            (Holder::Account, Measure::Stored) => "key-stored-bytes",
            (Holder::Account, Measure::Compute) => "key-compute-seconds",
        }
    }

    /// What it counts.
    pub fn unit(self) -> &'static str {
        match self.measure {
            Measure::Requests => "requests",
            Measure::Queued => "jobs",
            Measure::Stored => "bytes",
            Measure::Compute => "seconds",
        }
    }

    /// Seconds after which it begins anew, where it does.
    pub fn window(self) -> Option<u32> {
        match self.measure {
            Measure::Requests => Some(60),
            Measure::Compute => Some(86_400),
            Measure::Queued | Measure::Stored => None,
        }
    }
}
