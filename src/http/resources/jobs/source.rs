//! Which part of a medical file a job is about.

use serde_json::{Value, json};

use crate::http::wire::error::{ApiError, Code};
use crate::http::wire::extract;
use crate::reconstruction::cloud;
use crate::reconstruction::medical::{Choice, Parts};

/// What is said of several parts where one is needed.
const SEVERAL: &str =
    "names several parts, and a job makes one surface: POST /v1/batches makes a job of each";

/// Why a choice is none where there is nothing to choose.
pub(super) fn no_parts() -> ApiError {
    let detail = "the cloud has no parts to choose from; leave the choice out";
    ApiError::fault(Code::SourceUnknown, "/source", detail)
}

/// Why a choice is none, with the parts that there are.
pub(super) fn not_chosen(parts: &Parts, error: &cloud::Error) -> ApiError {
    ApiError::fault(Code::from_name(error.code()), "/source", error.to_string())
        .with("kind", json!(parts.kind))
        .with("choices", json!(parts.items))
}

/// The one part that a job is about.
///
/// # Errors
/// What is wrong with the value.
pub(super) fn one_source(value: Value) -> Result<Choice, String> {
    let several = match &value {
        Value::Array(_) => true,
        Value::String(text) => Choice::parse_several(text).is_ok_and(|choices| choices.len() != 1),
        _ => false,
    };
    if several {
        return Err(SEVERAL.to_owned());
    }
    extract::json(value)
}

/// The one part that an address names.
///
/// # Errors
/// What is wrong with the text.
pub(in crate::http) fn source_named(text: &str) -> Result<Choice, String> {
    match <[Choice; 1]>::try_from(Choice::parse_several(text)?) {
        Ok([only]) => Ok(only),
        Err(_) => Err(SEVERAL.to_owned()),
    }
}
