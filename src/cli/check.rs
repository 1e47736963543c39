//! `meshway check`: whether all bytes are there that the rows of a service name.

use std::fmt::Write as _;
use std::path::Path;

use clap::Args;
use serde_json::{Value, json};

use super::Failure;
use super::files::Sink;
use super::rows::Rows;
use crate::config::ObjectsUrl;
use crate::jobs::Store;
use crate::jobs::store::{Checked, Damage, Finding, Named, Options};

/// Findings of a kind that people are told one by one.
const TOLD: usize = 20;

/// Arguments of `meshway check`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    rows: Rows,
    /// Object store of the service, where it is not at the address at which the service last used it.
    #[arg(long, env = "MESHWAY_OBJECTS")]
    objects: Option<ObjectsUrl>,
    /// Read clouds, meshes and networks, too, and compare their SHA-256.
    #[arg(long)]
    hashes: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let runtime = super::runtime()?;
    let checked = runtime.block_on(check(arguments))?;
    let text = if arguments.json {
        format!("{:#}\n", as_json(&checked))
    } else {
        table(&checked)
    };
    Sink::new(Path::new("-"))?.write(|out| out.write_all(text.as_bytes()))?;
    match checked.findings.len() {
        0 => Ok(()),
        rows => Err(Failure::Output(format!(
            "bytes are missing or damaged: {rows} rows name them"
        ))),
    }
}

async fn check(arguments: &Arguments) -> Result<Checked, Failure> {
    let rows = &arguments.rows;
    rows.check_folder().await?;
    let failed = |error| rows.failed(&error);
    let options = Options {
        objects: arguments.objects.clone(),
        ..rows.options()
    };
    let schema = Store::schema(&rows.data_dir, &options).await;
    let schema = schema.map_err(failed)?;
    if !schema.is_current() {
        return Err(Failure::Output(format!(
            "the tables are at migration {}; bring them to {} with `meshway migrate` first",
            schema.found, schema.known
        )));
    }
    let checked = Store::check(&rows.data_dir, options, arguments.hashes).await;
    checked.map_err(failed)
}

fn name(named: Named) -> &'static str {
    match named {
        Named::Cloud => "cloud",
        Named::Mesh => "mesh",
        Named::Model => "model",
        Named::Checkpoint => "checkpoint",
        Named::History => "history",
        Named::Part => "part",
        Named::Share => "share",
    }
}

/// What to do about one that is missing or damaged.
fn remedy(named: Named) -> &'static str {
    match named {
        Named::Cloud => {
            "put the file or object back from a backup; or erase the cloud (DELETE /v1/clouds/{id}) and \
             send it again"
        }
        Named::Mesh => {
            "put the object back from a backup; or submit the job again and erase this one (DELETE \
             /v1/jobs/{id})"
        }
        Named::Model => {
            "put the object back from a backup; the mesh of the job does not need it, the field and a \
             second extraction do"
        }
        Named::Checkpoint => {
            "nothing: the job begins anew, unless the object comes back from a backup"
        }
        Named::History => {
            "put the object back from a backup; mesh and report do not need it, events and series of the \
             job do"
        }
        Named::Part => "erase the upload (DELETE /v1/uploads/{id}) and send it again",
        Named::Share => "nothing: the worker of the job fits these blocks itself",
    }
}

fn word(damage: &Damage) -> &'static str {
    match damage {
        Damage::Missing => "missing",
        Damage::Size { .. } => "size",
        Damage::Hash { .. } => "hash",
    }
}

fn table(checked: &Checked) -> String {
    let mut text = format!(
        "{:<12}{:>10}{:>18}{:>10}{:>10}\n",
        "", "rows", "bytes", "missing", "damaged"
    );
    for named in Named::ALL {
        let (rows, bytes) = checked.rows.get(&named).copied().unwrap_or_default();
        let own = || checked.findings.iter().filter(|found| found.named == named);
        let missing = own()
            .filter(|found| found.damage == Damage::Missing)
            .count();
        let damaged = own().count() - missing;
        let name = name(named);
        let _ = writeln!(
            text,
            "{name:<12}{rows:>10}{bytes:>18}{missing:>10}{damaged:>10}"
        );
    }
    for named in Named::ALL {
        let own: Vec<&Finding> = checked
            .findings
            .iter()
            .filter(|f| f.named == named)
            .collect();
        if own.is_empty() {
            continue;
        }
        let _ = writeln!(text, "\n{}: {}", name(named), remedy(named));
        for found in own.iter().take(TOLD) {
            let _ = writeln!(text, "  {}: {}", found.of, sentence(found));
        }
        more(&mut text, own.len());
    }
    if !checked.left_over.is_empty() {
        let bytes: u64 = checked.left_over.iter().map(|(_, bytes)| bytes).sum();
        let _ = writeln!(
            text,
            "\nleft over: {} objects or files, {bytes} bytes, that no row names; the service removes them",
            checked.left_over.len()
        );
        for (place, bytes) in checked.left_over.iter().take(TOLD) {
            let _ = writeln!(text, "  {place}: {bytes} bytes");
        }
        more(&mut text, checked.left_over.len());
    }
    text
}

fn more(text: &mut String, all: usize) {
    if all > TOLD {
        let _ = writeln!(text, "  and {} more (--json tells all)", all - TOLD);
    }
}

fn sentence(found: &Finding) -> String {
    let Finding { place, bytes, .. } = found;
    match &found.damage {
        Damage::Missing => format!("{place} is missing"),
        Damage::Size { found } => format!("{place} has {found} bytes of {bytes}"),
        Damage::Hash { found } => format!("{place} holds other bytes, of SHA-256 {found}"),
    }
}

fn as_json(checked: &Checked) -> Value {
    let rows = Named::ALL.map(|named| {
        let (rows, bytes) = checked.rows.get(&named).copied().unwrap_or_default();
        json!({"kind": name(named), "rows": rows, "bytes": bytes})
    });
    let finding = |found: &Finding| {
        json!({
            "kind": name(found.named),
            "of": found.of,
            "place": found.place,
            "bytes": found.bytes,
            "damage": word(&found.damage),
            "found_bytes": match found.damage {
                Damage::Size { found } => Some(found),
                _ => None,
            },
            "remedy": remedy(found.named),
        })
    };
    let left_over = |(place, bytes): &(String, u64)| json!({"place": place, "bytes": bytes});
    json!({
        "rows": rows,
        "findings": checked.findings.iter().map(finding).collect::<Vec<_>>(),
        "left_over": checked.left_over.iter().map(left_over).collect::<Vec<_>>(),
    })
}
