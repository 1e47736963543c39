//! Requests in a minute of a tenant and of a key.

use super::window::{self, Quota};
use crate::http::wire::quota::{Left, Standing};
use crate::identity::{Caller, Holder, Measure, Policy};

/// The windows of all tenants and keys.
#[derive(Debug, Default)]
pub(in crate::http) struct Windows(window::Windows<(Holder, String)>);

impl Windows {
    /// Counts a request, at a time in milliseconds since the epoch. One that is refused counts, too,
    /// but never beyond its quota.
    pub(in crate::http) fn count(&self, caller: &Caller, now: i64) -> Standing {
        let policies = caller.allowance.policies(Measure::Requests);
        Standing(
            policies
                .map(|policy| (policy, self.count_one(caller, policy, now)))
                .collect(),
        )
    }

    fn count_one(&self, caller: &Caller, policy: Policy, now: i64) -> Left {
        let whose = match policy.holder {
            Holder::Tenant => caller.tenant.as_str().to_owned(),
            Holder::Account => caller.account().into_owned(),
        };
        let quota = Quota {
            most: policy.quota,
            window_ms: i64::from(policy.window().unwrap_or(60)) * 1_000,
        };
        let counted = self.0.count((policy.holder, whose), quota, now);
        Left {
            units: counted.left,
            reset: Some(counted.reset),
        }
    }
}

#[cfg(test)]
mod tests {
    use axum::http::HeaderMap;
    use serde_json::json;

    use super::*;
    use crate::http::wire::error::Code;
    use crate::identity::{Allowance, Limits};

    fn caller(tenant: u32, account: Option<u32>) -> Caller {
        let of = |requests_per_minute| Limits {
            requests_per_minute,
            ..Limits::default()
        };
        Caller {
            allowance: Allowance {
                tenant: of(Some(tenant)),
                account: of(account),
            },
            ..Caller::anybody()
        }
    }

    #[test]
    fn a_window_lasts_a_minute_and_says_what_is_left() {
        let windows = Windows::default();
        let ask = |now| windows.count(&caller(2, None), now);
        let said = |standing: &Standing| {
            let headers: HeaderMap = standing.headers().into_iter().collect();
            headers["ratelimit"].to_str().unwrap().to_owned()
        };
        let first = ask(1_000_000);
        assert!(first.refusal().is_none());
        assert_eq!(said(&first), "\"tenant-requests\";r=1;t=60");
        assert_eq!(said(&ask(1_000_500)), "\"tenant-requests\";r=0;t=60");
        let refused = ask(1_030_000);
        assert_eq!(said(&refused), "\"tenant-requests\";r=0;t=30");
        assert_eq!(refused.refusal().unwrap().code(), Code::RateLimited);
        assert!(ask(1_059_999).refusal().is_some());
        assert!(ask(1_060_000).refusal().is_none());
        // Set back.
        assert!(ask(0).refusal().is_none() && ask(0).refusal().is_none());
        assert!(ask(0).refusal().is_some());
    }

    #[test]
    fn the_tighter_one_of_two_refuses_and_is_named() {
        let windows = Windows::default();
        let both = caller(9, Some(1));
        assert!(windows.count(&both, 0).refusal().is_none());
        let standing = windows.count(&both, 0);
        let body = standing.refusal().unwrap().body(None);
        let body = serde_json::to_value(body).unwrap();
        assert_eq!(body["violated-policies"], json!(["key-requests"]));
        let headers: HeaderMap = standing.headers().into_iter().collect();
        assert_eq!(
            headers["ratelimit-policy"],
            "\"tenant-requests\";q=9;w=60, \"key-requests\";q=1;w=60"
        );
        assert!(
            caller(9, None)
                .allowance
                .policies(Measure::Stored)
                .next()
                .is_none()
        );
    }
}
