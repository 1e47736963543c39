//! The trail in the forms that others take.

use clap::ValueEnum;
use serde_json::{Value, json};
use time::OffsetDateTime;
use time::format_description::well_known::Rfc3339;

use crate::jobs::AuditRow;

/// The form of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// A JSON object a line, with all that a hash is made of.
    Ndjson,
    /// A table with a line of names.
    Csv,
    /// A FHIR R4 bundle of `AuditEvent` resources.
    Fhir,
}

/// Columns of the table.
const COLUMNS: [&str; 13] = [
    "seq", "at", "time", "tenant", "actor", "key", "address", "action", "event", "object",
    "outcome", "request", "hash",
];

/// Writes rows in a form, one after the other.
pub(super) struct Writer {
    format: Format,
    rows: u64,
}

impl Writer {
    pub(super) fn new(format: Format) -> Self {
        Self { format, rows: 0 }
    }

    /// What stands before the first row.
    pub(super) fn begin(&self) -> String {
        match self.format {
            Format::Ndjson => String::new(),
            Format::Csv => format!("{}\r\n", COLUMNS.join(",")),
            Format::Fhir => {
                "{\"resourceType\":\"Bundle\",\"type\":\"collection\",\"entry\":[".to_owned()
            }
        }
    }

    /// A row.
    pub(super) fn row(&mut self, row: &AuditRow) -> String {
        let first = self.rows == 0;
        self.rows += 1;
        match self.format {
            Format::Ndjson => format!("{}\n", json!(row)),
            Format::Csv => line(row),
            Format::Fhir => {
                let comma = if first { "" } else { "," };
                let entry = json!({
                    "fullUrl": format!("urn:meshway:audit:{}", row.seq),
                    "resource": event(row),
                });
                format!("{comma}\n{entry}")
            }
        }
    }

    /// What stands after the last row.
    pub(super) fn end(&self) -> String {
        match self.format {
            Format::Ndjson | Format::Csv => String::new(),
            Format::Fhir => "\n]}\n".to_owned(),
        }
    }
}

fn line(row: &AuditRow) -> String {
    let row_json = json!(row);
    let cells = COLUMNS.map(|column| match (column, &row_json[column]) {
        ("time", _) => time(row.at),
        (_, Value::String(text)) => cell(text),
        (_, Value::Null) => String::new(),
        (_, number) => number.to_string(),
    });
    format!("{}\r\n", cells.join(","))
}

/// A text as RFC 4180 has it. One that a spreadsheet would compute gets an apostrophe.
fn cell(text: &str) -> String {
    let guard = if text.starts_with(['=', '+', '-', '@']) {
        "'"
    } else {
        ""
    };
    if guard.is_empty() && !text.contains([',', '"', '\r', '\n']) {
        return text.to_owned();
    }
    format!("\"{guard}{}\"", text.replace('"', "\"\""))
}

/// A row as an `AuditEvent` of FHIR R4.
fn event(row: &AuditRow) -> Value {
    let kind = if row.event.starts_with("auth.") {
        json!({"system": "http://dicom.nema.org/resources/ontology/DCM", "code": "110114", "display": "User Authentication"})
    } else {
        json!({"system": "http://terminology.hl7.org/CodeSystem/audit-event-type", "code": "rest", "display": "RESTful Operation"})
    };
    let mut agent = json!({
        "who": {"display": row.actor.as_deref().unwrap_or("a stranger")},
        "requestor": true,
    });
    if let Some(key) = &row.key {
        agent["who"]["identifier"] = json!({"system": "urn:meshway:key", "value": key});
    }
    if let Some(address) = &row.address {
        agent["network"] = json!({"address": address, "type": "2"});
    }
    let mut source = json!({"observer": {"display": "Meshway"}});
    if let Some(tenant) = &row.tenant {
        source["site"] = json!(tenant);
    }
    json!({
        "resourceType": "AuditEvent",
        "id": row.seq.to_string(),
        "type": kind,
        "subtype": [{"system": "urn:meshway:audit", "code": row.event}],
        "action": row.action,
        "recorded": time(row.at),
        "outcome": row.outcome.to_string(),
        "agent": [agent],
        "source": source,
        "entity": [{
            "what": {"identifier": {"system": "urn:meshway:id", "value": row.object}},
            "detail": [
                {"type": "request", "valueString": row.request},
                {"type": "hash", "valueString": row.hash},
            ],
        }],
    })
}

fn time(at: i64) -> String {
    let time = OffsetDateTime::from_unix_timestamp_nanos(i128::from(at) * 1_000_000);
    let time = time.unwrap_or(OffsetDateTime::UNIX_EPOCH);
    time.format(&Rfc3339).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_quoted_and_are_no_formulas() {
        assert_eq!(cell("job_1"), "job_1");
        assert_eq!(cell("a,\"b\""), "\"a,\"\"b\"\"\"");
        assert_eq!(cell("=1+1"), "\"'=1+1\"");
    }

    #[test]
    fn times_are_in_utc() {
        assert_eq!(time(1_830_297_600_500), "2028-01-01T00:00:00.5Z");
    }
}
