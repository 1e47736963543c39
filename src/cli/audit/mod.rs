//! `meshway audit`: the trail of who did what, checked and handed on.

mod export;

use std::path::Path;

use clap::{Args, Subcommand};

use super::Failure;
use super::files::Sink;
use super::rows::Rows;
use crate::identity::Tenant;
use crate::jobs::{AuditHead, AuditRow, Store};
use export::Format;

/// Rows that are read at once.
const PAGE: u32 = 1_000;

/// Arguments of `meshway audit`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
    #[command(flatten)]
    rows: Rows,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Check that no row was changed, removed or moved; exit code 1 when one was.
    Verify {
        /// A head that an earlier run or the log told, SEQ:HASH: it must still be in the trail.
        #[arg(long, value_name = "SEQ:HASH", value_parser = head)]
        head: Vec<AuditHead>,
    },
    /// Print the rows, oldest first.
    Export {
        /// Lines of JSON, a table, or a FHIR R4 bundle of `AuditEvent` resources.
        #[arg(long, value_enum, default_value_t = Format::Ndjson)]
        format: Format,
        /// Only rows of this tenant.
        #[arg(long)]
        tenant: Option<Tenant>,
    },
}

fn head(text: &str) -> Result<AuditHead, String> {
    let wrong = || "must be SEQ:HASH, as `meshway audit verify` prints it".to_owned();
    let (seq, hash) = text.split_once(':').ok_or_else(wrong)?;
    let seq = seq.parse().map_err(|_| wrong())?;
    if hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()) {
        let hash = hash.to_ascii_lowercase();
        Ok(AuditHead { seq, hash })
    } else {
        Err(wrong())
    }
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let runtime = super::runtime()?;
    runtime.block_on(async {
        let store = open(arguments).await?;
        let result = match &arguments.what {
            What::Verify { head } => verify(&store, head).await,
            What::Export { format, tenant } => export(&store, *format, tenant.as_ref()).await,
        };
        store.close().await;
        result
    })
}

async fn open(arguments: &Arguments) -> Result<Store, Failure> {
    let rows = &arguments.rows;
    if rows.database.is_some() {
        // Of the rows alone nothing is in a folder of the service; what the store makes in one goes.
        let made = tempfile::tempdir();
        let folder =
            made.map_err(|error| Failure::Output(format!("no temporary folder: {error}")))?;
        let opened = Store::open(folder.path(), rows.options()).await;
        return opened.map_err(|error| rows.failed(&error));
    }
    rows.check_folder().await?;
    let opened = Store::open(&rows.data_dir, rows.options()).await;
    opened.map_err(|error| Failure::input(&rows.data_dir, error))
}

async fn verify(store: &Store, known: &[AuditHead]) -> Result<(), Failure> {
    match store.audit_verify(known).await? {
        Ok(head) => Sink::new(Path::new("-"))?
            .write(|out| writeln!(out, "the trail is whole; head {}:{}", head.seq, head.hash)),
        Err(fault) => {
            let detail = format!(
                "the audit trail is broken at row {}: {}",
                fault.seq, fault.detail
            );
            Err(Failure::Output(detail))
        }
    }
}

async fn export(store: &Store, format: Format, tenant: Option<&Tenant>) -> Result<(), Failure> {
    let mut seq = 0;
    let mut writer = export::Writer::new(format);
    let mut text = writer.begin();
    loop {
        let rows = store.audit_after(seq, PAGE).await?;
        let wanted = |row: &&AuditRow| {
            tenant.is_none_or(|tenant| row.tenant.as_deref() == Some(tenant.as_str()))
        };
        for row in rows.iter().filter(wanted) {
            text += &writer.row(row);
        }
        match rows.last() {
            Some(last) => seq = last.seq,
            None => break,
        }
        print(&text)?;
        text.clear();
    }
    text += &writer.end();
    print(&text)
}

fn print(text: &str) -> Result<(), Failure> {
    Sink::new(Path::new("-"))?.write(|out| out.write_all(text.as_bytes()))
}
