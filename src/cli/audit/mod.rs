//! `meshway audit`: the trail of who did what, checked and handed on.

mod export;

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};

use super::Failure;
use super::files::Sink;
use crate::config::DatabaseUrl;
use crate::identity::Tenant;
use crate::jobs::{AuditHead, AuditRow, Store, store};
use export::Format;

/// Rows that are read at once.
const PAGE: u32 = 1_000;

/// Arguments of `meshway audit`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(subcommand)]
    what: What,
    /// Folder of the service, which may run meanwhile.
    #[arg(
        long,
        global = true,
        env = "MESHWAY_DATA_DIR",
        default_value = "meshway-data"
    )]
    data_dir: PathBuf,
    /// Postgres database of the service, as `serve --database` names it.
    #[arg(long, global = true, env = "MESHWAY_DATABASE", hide_env_values = true)]
    database: Option<DatabaseUrl>,
    /// Say that a pooler in transaction mode stands before the database.
    #[arg(long, global = true, env = "MESHWAY_DATABASE_POOLED", num_args = 0..=1,
          require_equals = true, default_value_t = false, default_missing_value = "true",
          action = clap::ArgAction::Set)]
    database_pooled: bool,
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
    let runtime = tokio::runtime::Runtime::new()
        .map_err(|error| Failure::Output(format!("no runtime: {error}")))?;
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
    let folder = arguments.data_dir.as_path();
    let failed = |error| Failure::input(folder, error);
    let options = store::Options {
        rows_only: true,
        database: arguments
            .database
            .as_ref()
            .map(|url| url.secret().to_owned()),
        database_pooled: arguments.database_pooled,
        ..store::Options::default()
    };
    if let Some(database) = &arguments.database {
        // Of the rows alone nothing is in a folder of the service; what the store makes in one goes.
        let made = tempfile::tempdir();
        let folder =
            made.map_err(|error| Failure::Output(format!("no temporary folder: {error}")))?;
        let opened = Store::open(folder.path(), options).await;
        return opened.map_err(|error| Failure::Output(format!("--database {database}: {error}")));
    }
    if !store::is_ours(folder).await.map_err(failed)? {
        let detail = "no service has worked in this folder; name the one of `serve --data-dir`";
        return Err(Failure::input(folder, detail));
    }
    Store::open(folder, options).await.map_err(failed)
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
