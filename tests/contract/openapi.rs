//! `openapi.yaml` against the code: operations, problems, settings, examples.

use std::collections::BTreeSet;
use std::sync::LazyLock;

use meshway::http::error::CATALOGUE;
use meshway::http::{OPENAPI, operations};
use meshway::reconstruction::Preset;
use meshway::reconstruction::settings::{BOUNDS, CHOICES};
use serde_json::{Value, json};

static CONTRACT: LazyLock<Value> = LazyLock::new(|| yaml_serde::from_str(OPENAPI).unwrap());

const METHODS: [&str; 6] = ["get", "post", "put", "patch", "delete", "options"];

fn schema(name: &str) -> &'static Value {
    &CONTRACT["components"]["schemas"][name]
}

#[test]
fn it_has_the_operations_of_the_router() {
    let mut written = BTreeSet::new();
    for (path, item) in CONTRACT["paths"].as_object().unwrap() {
        for method in METHODS.iter().filter(|method| item.get(**method).is_some()) {
            written.insert(format!("{} {path}", method.to_uppercase()));
        }
    }
    let routed: BTreeSet<String> = operations()
        .into_iter()
        .map(|(method, path, _)| format!("{method} {path}"))
        .collect();
    assert_eq!(written, routed);
}

#[test]
fn operations_need_the_scopes_of_the_router() {
    for (method, path, scope) in operations() {
        let operation = &CONTRACT["paths"][path][method.to_lowercase()];
        let mut expected = scope.map_or(json!([]), |scope| json!([{"key": [scope.name()]}]));
        if (method.as_str(), path) == ("POST", "/v1/session") {
            // The one place where a password is taken.
            let password = json!({"password": ["read"]});
            expected.as_array_mut().unwrap().push(password);
        }
        assert_eq!(operation["security"], expected, "{method} {path}");
        for status in ["401", "403"] {
            let listed = operation["responses"].get(status).is_some();
            assert_eq!(listed, scope.is_some(), "{method} {path} {status}");
        }
    }
}

#[test]
fn operations_are_named_once_and_say_what_can_go_wrong() {
    let mut names = BTreeSet::new();
    for (path, item) in CONTRACT["paths"].as_object().unwrap() {
        for method in METHODS {
            let Some(operation) = item.get(method) else {
                continue;
            };
            let name = operation["operationId"].as_str().unwrap();
            assert!(names.insert(name), "{name} is there twice");
            assert!(operation["summary"].is_string(), "{name}");
            let responses = operation["responses"].as_object().unwrap();
            assert!(responses.contains_key("default"), "{name}");
            if path.contains("{id}") {
                assert!(responses.contains_key("404"), "{name}");
            }
        }
    }
}

#[test]
fn it_lists_every_problem() {
    let listed = schema("ProblemCode")["enum"].as_array().unwrap();
    let listed: Vec<_> = listed.iter().map(|code| code.as_str().unwrap()).collect();
    let codes: Vec<_> = CATALOGUE.iter().map(|entry| entry.name).collect();
    assert_eq!(listed, codes);
}

#[test]
fn settings_are_those_of_the_presets_with_their_bounds() {
    let settings = serde_json::to_value(Preset::Balanced.settings()).unwrap();
    let groups = schema("Settings")["properties"].as_object().unwrap();
    let names = |value: &Value| -> BTreeSet<String> {
        value.as_object().unwrap().keys().cloned().collect()
    };
    assert_eq!(names(&schema("Settings")["properties"]), names(&settings));
    for (group, written) in groups {
        let properties = &written["properties"];
        assert_eq!(names(properties), names(&settings[group]), "{group}");
        assert_eq!(written["additionalProperties"], false);
    }
    for bound in BOUNDS {
        let place = bound.pointer.replace('/', "/properties/");
        let written = schema("Settings").pointer(&place).unwrap();
        assert_eq!(written["minimum"].as_f64(), Some(bound.min), "{place}");
        assert_eq!(written["maximum"].as_f64(), Some(bound.max), "{place}");
    }
    for choice in CHOICES {
        let place = choice.pointer.replace('/', "/properties/");
        let written = schema("Settings").pointer(&place).unwrap();
        assert_eq!(written["enum"], json!(choice.names), "{place}");
    }
    let presets: Vec<_> = Preset::ALL.iter().map(|preset| preset.name()).collect();
    assert_eq!(schema("PresetName")["enum"], json!(presets));
    for preset in Preset::ALL {
        expect_schema(
            "Settings",
            &serde_json::to_value(preset.settings()).unwrap(),
        );
    }
}

#[test]
fn all_schemas_compile_and_their_examples_fit() {
    for (name, schema) in CONTRACT["components"]["schemas"].as_object().unwrap() {
        let examples = schema["examples"].as_array().into_iter().flatten();
        validator(name);
        for example in examples {
            expect_schema(name, example);
        }
    }
}

#[test]
fn examples_of_bodies_fit() {
    let mut checked = 0;
    for (path, item) in CONTRACT["paths"].as_object().unwrap() {
        for operation in METHODS.iter().filter_map(|method| item.get(*method)) {
            let responses = operation["responses"].as_object().unwrap().values();
            let bodies = responses.chain([&operation["requestBody"]]);
            for media in bodies.filter_map(|body| body["content"].get("application/json")) {
                let name = media["schema"]["$ref"].as_str().unwrap_or_default();
                let name = name.rsplit('/').next().unwrap();
                if let Some(example) = media.get("example") {
                    assert!(
                        !name.is_empty(),
                        "{path}: an example without a named schema"
                    );
                    expect_schema(name, example);
                    checked += 1;
                }
            }
        }
    }
    assert!(checked >= 3, "{checked} examples: were they renamed?");
}

#[test]
fn every_reference_leads_somewhere() {
    fn check(value: &Value) {
        match value {
            Value::Object(members) => {
                if let Some(Value::String(reference)) = members.get("$ref") {
                    let pointer = reference.strip_prefix('#').unwrap();
                    assert!(CONTRACT.pointer(pointer).is_some(), "{reference}");
                }
                members.values().for_each(check);
            }
            Value::Array(items) => items.iter().for_each(check),
            _ => {}
        }
    }
    check(&CONTRACT);
}

fn validator(name: &str) -> jsonschema::Validator {
    jsonschema::validator_for(&json!({
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$ref": format!("#/components/schemas/{name}"),
        "components": CONTRACT["components"],
    }))
    .unwrap()
}

#[track_caller]
fn expect_schema(name: &str, value: &Value) {
    let errors: Vec<String> = validator(name)
        .iter_errors(value)
        .map(|error| format!("{}: {error}", error.instance_path()))
        .collect();
    assert!(errors.is_empty(), "{name}: {}\n{value}", errors.join("\n"));
}
