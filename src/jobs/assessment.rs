//! What the report of a job says in short: is the mesh any good, why not, what is it.
//!
//! The report is the one place where these are kept. Reports of earlier versions have no verdict,
//! and what is missing in a report is null here.

use serde_json::{Map, Value, json};

use crate::reconstruction::report::Verdict;

/// The members of a job's JSON that its report gives: `verdict`, `verdict_reasons`, `warnings`, `mesh`, `slices`,
/// `frame` and `unit`, each null without a report and where the report has none.
pub fn members(report: Option<&Value>) -> Map<String, Value> {
    let report = report.unwrap_or(&Value::Null);
    let list = |name: &str| match &report[name] {
        Value::Array(items) => Value::Array(items.clone()),
        _ => Value::Null,
    };
    let members = [
        ("verdict", json!(Verdict::of(report))),
        ("verdict_reasons", list("verdict_reasons")),
        ("warnings", list("warnings")),
        ("mesh", mesh(report)),
        ("slices", slices(report)),
        ("frame", report["frame"].clone()),
        ("unit", report["unit"].clone()),
    ];
    let named = members.map(|(name, value)| (name.to_owned(), value));
    named.into_iter().collect()
}

/// What was made of the slices of a segmentation.
fn slices(report: &Value) -> Value {
    match &report["slices"] {
        Value::Object(slices) => Value::Object(slices.clone()),
        _ => Value::Null,
    }
}

/// What the mesh is, in a few numbers.
fn mesh(report: &Value) -> Value {
    let measured = &report["mesh"];
    if !measured["vertices"].is_u64() || !measured["triangles"].is_u64() {
        return Value::Null;
    }
    json!({
        "vertices": measured["vertices"],
        "triangles": measured["triangles"],
        "components": measured["components"],
        "closed": measured["closed"],
        "genus": measured["genus"],
        "volume": measured["volume"],
        "unsupported_area_percent": report["surface"]["unsupported_area_percent"],
        "orientation_confidence": report["cloud"]["orientation_confidence"],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_json() {
        for verdict in Verdict::ALL {
            assert_eq!(serde_json::to_value(verdict).unwrap(), verdict.name());
            assert_eq!(Verdict::of(&json!({"verdict": verdict})), Some(verdict));
        }
    }

    #[test]
    fn what_a_report_does_not_say_is_null() {
        let nothing = members(None);
        assert_eq!(nothing.len(), 7);
        for report in [
            json!({}),
            json!(null),
            json!({"verdict": "splendid", "verdict_reasons": {}, "warnings": 1, "mesh": [], "slices": 2}),
            json!({"verdict": null, "mesh": {"closed": true}}),
        ] {
            assert_eq!(members(Some(&report)), nothing, "{report}");
        }
        assert!(nothing.values().all(Value::is_null));
    }
}
