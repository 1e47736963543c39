//! Answers held against the schemas of `openapi.yaml`.

use std::sync::LazyLock;

use jsonschema::Validator;
use serde_json::{Value, json};

use crate::http::support::Answer;

static CONTRACT: LazyLock<Value> =
    LazyLock::new(|| yaml_serde::from_str(meshway::http::OPENAPI).unwrap());

/// Fails unless the answer's status and body are what the contract says of the operation.
#[track_caller]
pub(crate) fn expect_contract(answer: &Answer, method: &str, path: &str) {
    let operation = &CONTRACT["paths"][path][method];
    assert!(
        operation.is_object(),
        "{method} {path} is not in the contract"
    );
    let responses = &operation["responses"];
    let status = answer.status.as_str();
    let response = responses.get(status).unwrap_or(&responses["default"]);
    let response = resolved(response);
    if answer.body.is_empty() {
        return;
    }
    let media_type = answer.header("content-type");
    let media_type = media_type.split(';').next().unwrap();
    let content = &response["content"][media_type];
    assert!(
        content.is_object(),
        "{method} {path} {status} gives no {media_type}"
    );
    let is_json = media_type == "application/json" || media_type.ends_with("+json");
    if let Some(schema) = content.get("schema").filter(|_| is_json) {
        expect_schema(schema, &answer.json());
    }
}

/// Fails unless the value fits the schema of the given name.
#[track_caller]
pub(crate) fn expect_named(name: &str, value: &Value) {
    expect_schema(
        &json!({"$ref": format!("#/components/schemas/{name}")}),
        value,
    );
}

#[track_caller]
fn expect_schema(schema: &Value, value: &Value) {
    let validator = validator(schema);
    let errors: Vec<String> = validator
        .iter_errors(value)
        .map(|error| format!("{}: {error}", error.instance_path()))
        .collect();
    assert!(errors.is_empty(), "{}\n{value}", errors.join("\n"));
}

fn validator(schema: &Value) -> Validator {
    // The components come along, so that references within the document resolve.
    let mut document = schema.clone();
    document["components"] = CONTRACT["components"].clone();
    document["$schema"] = json!("https://json-schema.org/draft/2020-12/schema");
    jsonschema::validator_for(&document).unwrap()
}

fn resolved(value: &Value) -> &Value {
    let pointer = value["$ref"].as_str().and_then(|r| r.strip_prefix('#'));
    pointer.map_or(value, |pointer| CONTRACT.pointer(pointer).unwrap())
}
