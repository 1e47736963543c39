//! What the report of a job says in short: is the mesh any good, why not, what is it.
//!
//! The report is the one place where these are kept. Reports of earlier versions have no verdict,
//! and what is missing in a report is null here.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::intake::Notice;
use crate::reconstruction::report::Verdict;
use crate::reconstruction::space::{Frame, Unit};

/// What a report says in short.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Assessment {
    /// How far the mesh can be relied on.
    pub verdict: Option<Verdict>,
    /// What speaks against it.
    pub verdict_reasons: Option<Vec<Notice>>,
    /// What the user should know.
    pub warnings: Option<Vec<Notice>>,
    /// What the mesh is.
    pub mesh: Option<MeshSummary>,
    /// What was made of the slices of a segmentation.
    pub slices: Option<Map<String, Value>>,
    /// Which way the axes of its coordinates point in a patient.
    pub frame: Option<Frame>,
    /// Unit of its coordinates.
    pub unit: Option<Unit>,
}

/// A mesh in a few numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MeshSummary {
    /// Number of vertices.
    pub vertices: u64,
    /// Number of triangles.
    pub triangles: u64,
    /// Number of connected pieces.
    pub components: Option<u64>,
    /// Whether it has no border.
    pub closed: Option<bool>,
    /// Number of handles, where it is closed.
    pub genus: Option<i64>,
    /// Enclosed volume, where it is closed.
    pub volume: Option<f64>,
    /// Share of its area without points near by.
    pub unsupported_area_percent: Option<f64>,
    /// How sure the directions of the normals are.
    pub orientation_confidence: Option<f64>,
}

impl Assessment {
    /// That of a report; all null without one.
    pub fn of(report: Option<&Value>) -> Self {
        let report = report.unwrap_or(&Value::Null);
        Self {
            verdict: Verdict::of(report),
            verdict_reasons: notices(&report["verdict_reasons"]),
            warnings: notices(&report["warnings"]),
            mesh: MeshSummary::of(report),
            slices: report["slices"].as_object().cloned(),
            frame: Frame::deserialize(&report["frame"]).ok(),
            unit: Unit::deserialize(&report["unit"]).ok(),
        }
    }
}

impl MeshSummary {
    fn of(report: &Value) -> Option<Self> {
        let measured = &report["mesh"];
        Some(Self {
            vertices: measured["vertices"].as_u64()?,
            triangles: measured["triangles"].as_u64()?,
            components: measured["components"].as_u64(),
            closed: measured["closed"].as_bool(),
            genus: measured["genus"].as_i64(),
            volume: measured["volume"].as_f64(),
            unsupported_area_percent: report["surface"]["unsupported_area_percent"].as_f64(),
            orientation_confidence: report["cloud"]["orientation_confidence"].as_f64(),
        })
    }
}

fn notices(list: &Value) -> Option<Vec<Notice>> {
    let notice = |item: &Value| {
        let text = |name: &str| item[name].as_str().unwrap_or_default().to_owned();
        Notice {
            code: text("code"),
            message: text("message"),
        }
    };
    Some(list.as_array()?.iter().map(notice).collect())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

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
        let nothing = json!(Assessment::of(None));
        let members = nothing.as_object().unwrap();
        assert!(members.len() == 7 && members.values().all(Value::is_null));
        for report in [
            json!({}),
            json!(null),
            json!({"verdict": "splendid", "verdict_reasons": {}, "warnings": 1, "mesh": [], "slices": 2}),
            json!({"verdict": null, "mesh": {"closed": true}}),
        ] {
            assert_eq!(json!(Assessment::of(Some(&report))), nothing, "{report}");
        }
    }
}
