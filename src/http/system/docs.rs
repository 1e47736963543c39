//! The pages for people: the start page, and the contract written out. Plain HTML without scripts
//! or anything from elsewhere, made once.

use std::fmt::Write;
use std::sync::LazyLock;

use serde_json::Value;

/// The contract, as it is committed.
pub const OPENAPI: &str = include_str!("../../../openapi.yaml");

const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;\
padding:0 1rem;color:#222;background:#fff}code,pre{font:14px/1.5 ui-monospace,monospace;\
background:#f4f4f4;border-radius:4px}code{padding:.1em .3em}pre{padding:1rem;overflow:auto}\
table{border-collapse:collapse;width:100%}td,th{text-align:left;vertical-align:top;\
padding:.3rem .6rem;border-bottom:1px solid #ddd}summary{cursor:pointer;padding:.3rem 0}\
.m{display:inline-block;min-width:4.5rem;font-weight:600}\
@media(prefers-color-scheme:dark){body{color:#ddd;background:#181818}code,pre{background:#262626}\
td,th{border-color:#444}a{color:#8ab4f8}}";

/// The start page.
pub(in crate::http) fn start() -> &'static str {
    static PAGE: LazyLock<String> = LazyLock::new(|| {
        let body = "<h1>Meshway</h1><p>Point clouds in, watertight meshes out.</p>\
<pre>curl -fsS --data-binary @cloud.ply -H 'Prefer: wait=60' -H 'Accept: model/obj' \\\n  \
'localhost:8080/v1/jobs?preset=fast' -o mesh.obj</pre><ul>\
<li><a href=\"/docs\">The API</a>, and the same <a href=\"/openapi.yaml\">for machines</a></li>\
<li><a href=\"/v1/jobs\">Jobs</a>, <a href=\"/v1/clouds\">clouds</a></li>\
<li><a href=\"/v1/presets\">Presets</a>, <a href=\"/v1/limits\">limits</a>, \
<a href=\"/v1/version\">version</a></li>\
<li><a href=\"/readyz\">Ready?</a> <a href=\"/metrics\">Metrics</a> for Prometheus</li></ul>";
        document("Meshway", body)
    });
    &PAGE
}

/// The contract for people.
pub(in crate::http) fn reference() -> &'static str {
    static PAGE: LazyLock<String> = LazyLock::new(|| {
        let contract = contract();
        let mut body = String::new();
        // Writing to a string does not fail.
        let _ = write_reference(&contract, &mut body);
        document("Meshway API", &body)
    });
    &PAGE
}

/// The contract as JSON; null if it is not YAML, which a test excludes.
pub(in crate::http) fn contract() -> Value {
    yaml_serde::from_str(OPENAPI).unwrap_or_default()
}

fn document(title: &str, body: &str) -> String {
    format!(
        "<!doctype html><html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\
<meta name=\"viewport\" content=\"width=device-width\"><style>{STYLE}</style></head>\
<body>{body}</body></html>\n"
    )
}

fn write_reference(contract: &Value, out: &mut String) -> std::fmt::Result {
    write!(
        out,
        "<h1>{}</h1><p>{}</p><p><a href=\"/openapi.yaml\">openapi.yaml</a></p>",
        text(&contract["info"]["title"]),
        text(&contract["info"]["description"])
    )?;
    for tag in items(&contract["tags"]) {
        write!(
            out,
            "<h2>{}</h2><p>{}</p>",
            text(&tag["name"]),
            text(&tag["description"])
        )?;
        for (path, operations) in members(&contract["paths"]) {
            for (method, operation) in members(operations) {
                if operation["tags"][0] == tag["name"] {
                    write_operation(contract, (path, method, operation), out)?;
                }
            }
        }
    }
    out.push_str("<h2>Schemas</h2>");
    for (name, schema) in members(&contract["components"]["schemas"]) {
        let schema = serde_json::to_string_pretty(schema).unwrap_or_default();
        write!(
            out,
            "<details id=\"{name}\"><summary><code>{name}</code></summary><pre>{}</pre></details>",
            escaped(&schema)
        )?;
    }
    Ok(())
}

fn write_operation(
    contract: &Value,
    (path, method, operation): (&str, &str, &Value),
    out: &mut String,
) -> std::fmt::Result {
    write!(
        out,
        "<details><summary><span class=\"m\">{}</span> <code>{}</code> {}</summary><p>{}</p>",
        method.to_uppercase(),
        escaped(path),
        text(&operation["summary"]),
        text(&operation["description"])
    )?;
    let parameters = contract["paths"][path]["parameters"].as_array().into_iter();
    let parameters = parameters
        .chain(operation["parameters"].as_array())
        .flatten();
    let rows: Vec<String> = parameters
        .map(|parameter| {
            let parameter = resolved(contract, parameter);
            let place = format!("{} ({})", text(&parameter["name"]), text(&parameter["in"]));
            format!(
                "<tr><td><code>{place}</code></td><td>{}</td></tr>",
                text(&parameter["description"])
            )
        })
        .collect();
    write!(out, "<table>{}", rows.concat())?;
    for (status, response) in members(&operation["responses"]) {
        let response = resolved(contract, response);
        let types: Vec<&str> = members(&response["content"])
            .map(|(name, _)| name)
            .collect();
        write!(
            out,
            "<tr><td>{status}</td><td>{} {}</td></tr>",
            text(&response["description"]),
            escaped(&types.join(", "))
        )?;
    }
    out.push_str("</table></details>");
    Ok(())
}

/// What a `$ref` of the contract points at, else the value itself.
fn resolved<'a>(contract: &'a Value, value: &'a Value) -> &'a Value {
    let pointer = value["$ref"].as_str().and_then(|r| r.strip_prefix('#'));
    pointer
        .and_then(|pointer| contract.pointer(pointer))
        .unwrap_or(value)
}

fn items(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

fn members(value: &Value) -> impl Iterator<Item = (&str, &Value)> {
    let members = value.as_object().into_iter().flatten();
    members.map(|(name, value)| (name.as_str(), value))
}

fn text(value: &Value) -> String {
    escaped(value.as_str().unwrap_or_default())
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
