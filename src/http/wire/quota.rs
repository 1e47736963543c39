//! What is said of limits in headers and problems (draft-ietf-httpapi-ratelimit-headers:
//! `RateLimit-Policy`, `RateLimit`, `violated-policies`).

use std::fmt::Write;

use axum::http::{HeaderMap, HeaderName, HeaderValue};
use serde_json::json;

use crate::http::wire::error::{ApiError, Code};
use crate::identity::{Holder, Measure, Policy};

const POLICY: HeaderName = HeaderName::from_static("ratelimit-policy");
const LEFT: HeaderName = HeaderName::from_static("ratelimit");

/// How a request stands to the limits that it counts for.
#[derive(Debug, Default)]
pub(in crate::http) struct Standing(pub(in crate::http) Vec<(Policy, Left)>);

/// What is left of a limit.
#[derive(Debug, Clone, Copy)]
pub(in crate::http) struct Left {
    /// Nothing where it was used up before.
    pub(in crate::http) units: Option<u64>,
    /// Seconds until it begins anew.
    pub(in crate::http) reset: Option<u32>,
}

impl Standing {
    /// Why the request is refused, if it is.
    pub(in crate::http) fn refusal(&self) -> Option<ApiError> {
        let over = self.0.iter().filter(|(_, left)| left.units.is_none());
        let names: Vec<_> = over.clone().map(|(policy, _)| policy.name()).collect();
        let wait = over.clone().filter_map(|(_, left)| left.reset).max()?;
        let (policy, _) = over.clone().next()?;
        let detail = format!(
            "{} requests in a minute are allowed; there are more in {wait} s",
            policy.quota
        );
        let error = ApiError::new(Code::RateLimited, detail)
            .retry_after(wait)
            .with("violated-policies", json!(names));
        Some(
            self.headers()
                .into_iter()
                .fold(error, |error, (name, value)| error.with_header(name, value)),
        )
    }

    /// Says in an answer what is left.
    pub(in crate::http) fn mark(&self, headers: &mut HeaderMap) {
        headers.extend(self.headers());
    }

    /// `RateLimit-Policy` and `RateLimit`.
    pub(in crate::http) fn headers(&self) -> Vec<(HeaderName, HeaderValue)> {
        if self.0.is_empty() {
            return Vec::new();
        }
        let (mut policies, mut left) = (Vec::new(), Vec::new());
        for (policy, rest) in &self.0 {
            let mut text = format!("\"{}\";q={}", policy.name(), policy.quota);
            if policy.measure != Measure::Requests {
                let _ = write!(text, ";qu=\"{}\"", policy.unit());
            }
            if let Some(window) = policy.window() {
                let _ = write!(text, ";w={window}");
            }
            policies.push(text);
            let mut text = format!("\"{}\";r={}", policy.name(), rest.units.unwrap_or(0));
            if let Some(reset) = rest.reset {
                let _ = write!(text, ";t={reset}");
            }
            left.push(text);
        }
        let all = [(POLICY, policies), (LEFT, left)].into_iter();
        let value = |texts: Vec<String>| HeaderValue::try_from(texts.join(", ")).ok();
        all.filter_map(|(name, texts)| Some((name, value(texts)?)))
            .collect()
    }
}

/// The problem of a quota that is used up.
pub(in crate::http) fn used_up(policy: Policy, retry_seconds: u32) -> ApiError {
    let whose = match policy.holder {
        Holder::Tenant => "the tenant",
        Holder::Account => "the key",
    };
    let (quota, unit) = (policy.quota, policy.unit());
    let detail = match policy.measure {
        Measure::Requests => format!("{whose} may ask {quota} times in a minute"),
        Measure::Queued => format!("{whose} may have {quota} waiting jobs; let some end"),
        Measure::Stored => format!("{whose} may store {quota} bytes; erase jobs or clouds"),
        Measure::Compute => {
            format!(
                "{whose} may use {quota} seconds of workers a day; the next one begins at 0:00 UTC"
            )
        }
    };
    let left = Left {
        units: None,
        reset: policy.window().map(|_| retry_seconds),
    };
    let error = ApiError::new(Code::Quota, detail)
        .retry_after(retry_seconds)
        .with("violated-policies", json!([policy.name()]))
        .with("quota", json!({"limit": quota, "unit": unit}));
    let standing = Standing(vec![(policy, left)]);
    standing
        .headers()
        .into_iter()
        .fold(error, |error, (name, value)| error.with_header(name, value))
}
