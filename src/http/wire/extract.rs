//! Extractors that fail with our own problems; the rejections of axum are plain text.

use std::collections::BTreeMap;
use std::str::FromStr;
use std::time::Duration;

use axum::extract::{FromRequestParts, RawPathParams};
use axum::http::request::Parts;
use axum::http::{HeaderMap, HeaderName};
use serde::de::DeserializeOwned;
use serde_json::value::RawValue;
use serde_json::{Map, Value};

use crate::http::AppState;
use crate::http::wire::error::{ApiError, Code, Result};
use crate::jobs::Fault;
use crate::nearest::did_you_mean;

/// The id of the path, `{id}`. Anything else is answered as a resource that does not exist.
#[derive(Debug, Clone)]
pub(in crate::http) struct Id<T>(pub(in crate::http) T);

impl<T: FromStr> FromRequestParts<AppState> for Id<T> {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, state: &AppState) -> Result<Self> {
        let parameters = RawPathParams::from_request_parts(parts, state).await;
        parameters
            .ok()
            .and_then(|all| {
                let (_, id) = all.iter().find(|(name, _)| *name == "id")?;
                id.parse().ok()
            })
            .map(Self)
            .ok_or_else(|| ApiError::not_found("resource"))
    }
}

/// Named values of a query or a JSON object. Each is taken once, what is left is refused, and all
/// faults are reported together.
#[derive(Debug)]
pub(in crate::http) struct Fields<V> {
    values: BTreeMap<String, V>,
    /// Names that were asked for.
    known: Vec<String>,
    faults: Vec<Fault>,
}

/// A value that can mean "absent".
pub(in crate::http) trait Given {
    /// Whether it means that.
    fn is_absent(&self) -> bool {
        false
    }
}

impl Given for String {}

/// Typed clients send null for what they leave out.
impl Given for Value {
    fn is_absent(&self) -> bool {
        self.is_null()
    }
}

impl Given for &RawValue {
    fn is_absent(&self) -> bool {
        self.get() == "null"
    }
}

impl<V: Given> Fields<V> {
    /// Of these values.
    pub(in crate::http) fn new(values: BTreeMap<String, V>) -> Self {
        Self {
            values,
            known: Vec::new(),
            faults: Vec::new(),
        }
    }

    /// An optional value. Also `None` for a faulty one, which [`Fields::finish`] reports.
    pub(in crate::http) fn take<T>(
        &mut self,
        name: &str,
        parse: impl FnOnce(V) -> std::result::Result<T, String>,
    ) -> Option<T> {
        self.known.push(name.to_owned());
        let value = self.values.remove(name);
        match parse(value.filter(|value| !value.is_absent())?) {
            Ok(value) => Some(value),
            Err(detail) => {
                self.fault(name, detail);
                None
            }
        }
    }

    /// A value that must be there.
    pub(in crate::http) fn required<T>(
        &mut self,
        name: &str,
        parse: impl FnOnce(V) -> std::result::Result<T, String>,
    ) -> Option<T> {
        if !self.has(name) {
            self.fault(name, "is missing".to_owned());
        }
        self.take(name, parse)
    }

    /// Notes what is wrong with a value.
    pub(in crate::http) fn fault(&mut self, name: &str, detail: String) {
        self.faults.push(Fault {
            pointer: pointer(name),
            detail,
        });
    }

    /// Notes what is wrong with a part of a value.
    pub(in crate::http) fn fault_within(&mut self, name: &str, part: &str, detail: String) {
        self.faults.push(Fault {
            pointer: pointer(name) + &pointer(part),
            detail,
        });
    }

    /// Whether the value is there and was not taken yet.
    pub(in crate::http) fn has(&self, name: &str) -> bool {
        let value = self.values.get(name);
        value.is_some_and(|value| !value.is_absent())
    }

    /// Refuses all that is faulty or unknown.
    ///
    /// # Errors
    /// [`Code::RequestInvalid`] with every fault.
    pub(in crate::http) fn finish(mut self) -> Result<()> {
        for name in std::mem::take(&mut self.values).into_keys() {
            let detail = match self.known.as_slice() {
                [] => "is unknown; none is known here".to_owned(),
                known => {
                    let meant = did_you_mean(&name, known.iter().map(String::as_str));
                    format!("is unknown; known are: {}{meant}", known.join(", "))
                }
            };
            self.fault(&name, detail);
        }
        if self.faults.is_empty() {
            return Ok(());
        }
        Err(ApiError::faults(Code::RequestInvalid, self.faults))
    }
}

/// Parameters that are lists: with commas, or given again and again.
const LISTS: [&str; 1] = ["fields"];

/// The parameters of a query.
pub(in crate::http) type Query = Fields<String>;

impl FromRequestParts<AppState> for Query {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, _: &AppState) -> Result<Self> {
        let pairs = axum::extract::Query::<Vec<(String, String)>>::try_from_uri(&parts.uri)
            .map_err(|error| ApiError::fault(Code::RequestInvalid, "", error.body_text()))?;
        let mut query = Self::new(BTreeMap::new());
        for (name, value) in pairs.0 {
            match query.values.get_mut(&name) {
                Some(list) if LISTS.contains(&name.as_str()) => {
                    list.push(',');
                    list.push_str(&value);
                }
                Some(_) => query.fault(&name, "is given twice".to_owned()),
                None => drop(query.values.insert(name, value)),
            }
        }
        Ok(query)
    }
}

/// For resources without parameters: a query that has any is refused.
#[derive(Debug, Clone, Copy)]
pub(in crate::http) struct NoQuery;

impl FromRequestParts<AppState> for NoQuery {
    type Rejection = ApiError;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Self> {
        let query = Query::from_request_parts(parts, app).await?;
        query.finish().map(|()| Self)
    }
}

/// The members of a JSON object.
pub(in crate::http) type Members = Fields<Value>;

impl Members {
    /// The members of a body.
    ///
    /// # Errors
    /// [`Code::MalformedJson`], also for nesting deeper than 128; [`Code::RequestInvalid`] for
    /// another value than an object.
    pub(in crate::http) fn of(body: &[u8]) -> Result<Self> {
        Self::of_part("the body", body)
    }

    /// The members of a part of a form, which problems name.
    ///
    /// # Errors
    /// As [`Members::of`].
    pub(in crate::http) fn of_part(part: &str, body: &[u8]) -> Result<Self> {
        if body.trim_ascii().is_empty() {
            let detail = format!("{part} is empty: a JSON object is needed");
            return Err(ApiError::new(Code::MalformedJson, detail));
        }
        let value: Value = serde_json::from_slice(body)
            .map_err(|error| ApiError::new(Code::MalformedJson, format!("{part}: {error}")))?;
        let Value::Object(object) = value else {
            let detail = format!("{part} must be an object");
            return Err(ApiError::fault(Code::RequestInvalid, "", detail));
        };
        Ok(object.into())
    }
}

impl From<Map<String, Value>> for Members {
    fn from(object: Map<String, Value>) -> Self {
        Self::new(object.into_iter().collect())
    }
}

/// For [`Query::take`]: anything with a text form.
#[expect(
    clippy::needless_pass_by_value,
    reason = "the shape that take asks for"
)]
pub(in crate::http) fn text<T: FromStr>(value: String) -> std::result::Result<T, String>
where
    T::Err: std::fmt::Display,
{
    value.parse().map_err(|error: T::Err| error.to_string())
}

/// For [`Query::take`]: a whole number from 0 to 2⁵³ - 1, the largest that every client has exactly.
#[expect(
    clippy::needless_pass_by_value,
    reason = "the shape that take asks for"
)]
pub(in crate::http) fn whole(value: String) -> std::result::Result<u64, String> {
    let most = (1 << 53) - 1;
    match value.parse() {
        Ok(number) if number <= most => Ok(number),
        _ => Err(format!("must be a whole number from 0 to {most}")),
    }
}

/// For [`Members::take`]: anything with a JSON form.
pub(in crate::http) fn json<T: DeserializeOwned>(value: Value) -> std::result::Result<T, String> {
    serde_json::from_value(value).map_err(|error| error.to_string())
}

/// For [`Query::take`]: a switch.
#[expect(
    clippy::needless_pass_by_value,
    reason = "the shape that take asks for"
)]
pub(in crate::http) fn switch(value: String) -> std::result::Result<bool, String> {
    match value.as_str() {
        "true" | "1" | "" => Ok(true),
        "false" | "0" => Ok(false),
        _ => Err("must be true or false".to_owned()),
    }
}

/// For [`Query::take`]: what is taken over of a file besides its geometry, which may be `identifiers`.
#[expect(
    clippy::needless_pass_by_value,
    reason = "the shape that take asks for"
)]
pub(in crate::http) fn kept(value: String) -> std::result::Result<bool, String> {
    match value.as_str() {
        "identifiers" => Ok(true),
        _ => Err("must be identifiers: patient and study of a DICOM file".to_owned()),
    }
}

/// JSON pointer of a top-level name (RFC 6901).
fn pointer(name: &str) -> String {
    format!("/{}", name.replace('~', "~0").replace('/', "~1"))
}

/// The text of a header, if it is there.
///
/// # Errors
/// [`Code::BadHeader`] for one that is no text.
pub(in crate::http) fn header<'h>(
    headers: &'h HeaderMap,
    name: &HeaderName,
) -> Result<Option<&'h str>> {
    headers
        .get(name)
        .map(|value| {
            value.to_str().map_err(|_| {
                ApiError::new(Code::BadHeader, format!("{name} must be visible ASCII"))
            })
        })
        .transpose()
}

/// Longest wait that `Prefer: wait` may ask for, in seconds.
pub(in crate::http) const MAX_WAIT_SECONDS: u64 = 60;

/// How long the client prefers to wait; longer wishes are cut to the longest. Preferences that are
/// unknown or malformed are ignored, as RFC 7240 asks.
pub(in crate::http) fn preferred_wait(headers: &HeaderMap) -> Option<Duration> {
    let values = headers.get_all("prefer").iter();
    values
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split([',', ';']))
        .find_map(|preference| {
            let (name, seconds) = preference.split_once('=')?;
            let seconds = seconds.trim().trim_matches('"').parse::<u64>().ok()?;
            let is_wait = name.trim().eq_ignore_ascii_case("wait");
            is_wait.then(|| Duration::from_secs(seconds.min(MAX_WAIT_SECONDS)))
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_faults_are_told_at_once() {
        let mut members = Members::of(br#"{"a": 1, "b": "x", "c/d": 0}"#).unwrap();
        assert_eq!(members.take("a", json::<u8>), Some(1));
        assert_eq!(members.take("b", json::<u8>), None);
        assert_eq!(members.required("e", json::<u8>), None);
        let problem = members.finish().unwrap_err().body(None);
        let errors = problem.errors.iter();
        let pointers: Vec<_> = errors.map(|fault| fault.pointer.as_str()).collect();
        assert_eq!(pointers, ["/b", "/e", "/c~1d"]);
    }

    #[test]
    fn null_is_absent_but_not_unknown() {
        let mut members = Members::of(br#"{"a": null, "b": null, "c": null}"#).unwrap();
        assert_eq!(members.take("a", json::<u8>), None);
        assert!(!members.has("b"));
        assert_eq!(members.required("b", json::<u8>), None);
        let problem = members.finish().unwrap_err().body(None);
        assert_eq!(problem.errors[0].detail, "is missing");
        assert_eq!(problem.errors[1].pointer, "/c");
    }

    #[test]
    fn deep_nesting_is_malformed() {
        let body = [vec![b'['; 100_000], vec![b']'; 100_000]].concat();
        let error = Members::of(&body).unwrap_err();
        assert_eq!(error.code(), Code::MalformedJson);
    }

    #[test]
    fn the_preferred_wait_is_found_and_cut() {
        let wait = |value: &str| {
            let mut headers = HeaderMap::new();
            headers.insert("prefer", value.parse().unwrap());
            preferred_wait(&headers).map(|wait| wait.as_secs())
        };
        assert_eq!(wait("wait=10"), Some(10));
        assert_eq!(wait("respond-async, Wait = 600"), Some(60));
        assert_eq!(wait("return=minimal"), None);
        assert_eq!(wait("wait=soon"), None);
    }
}
