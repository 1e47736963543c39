//! `meshway migrate`: the tables of a service, brought up to date before it starts.

use std::path::Path;

use clap::Args;

use super::Failure;
use super::data_folder::DataFolder;
use super::files::Sink;
use super::rows::Rows;
use crate::jobs::Store;
use crate::jobs::store::Schema;

/// Arguments of `meshway migrate`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    #[command(flatten)]
    rows: Rows,
    /// Change nothing; exit code 1 where the tables are not up to date.
    #[arg(long)]
    check: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let runtime = super::runtime()?;
    let told = runtime.block_on(migrate(arguments))?;
    Sink::new(Path::new("-"))?.write(|out| writeln!(out, "{told}"))
}

async fn migrate(arguments: &Arguments) -> Result<String, Failure> {
    let rows = &arguments.rows;
    rows.check_folder().await?;
    let failed = |error| rows.failed(&error);
    if arguments.check {
        let schema = Store::schema(&rows.data_dir, &rows.options()).await;
        return check(schema.map_err(failed)?);
    }
    // In a folder nobody works with tables that change under it. A server has no folder to hold.
    let _folder = match rows.database {
        Some(_) => None,
        None => Some(DataFolder::take(&rows.data_dir).await?),
    };
    let before = Store::migrate(&rows.data_dir, &rows.options()).await;
    let before = before.map_err(failed)?;
    Ok(match before {
        before if before.is_current() => current(before),
        Schema { found: 0, known } => format!("the tables are made, up to migration {known}"),
        Schema { found, known } => {
            format!("the tables are brought from migration {found} to migration {known}")
        }
    })
}

fn check(schema: Schema) -> Result<String, Failure> {
    if schema.is_current() {
        return Ok(current(schema));
    }
    let Schema { found, known } = schema;
    Err(Failure::Output(format!(
        "the tables are at migration {found}, and this program works with migration {known}; \
         `meshway migrate` brings them there, and `meshway serve` does so when it starts"
    )))
}

fn current(Schema { found, known }: Schema) -> String {
    if found > known {
        format!(
            "the tables are at migration {found}, where a newer program brought them; this one knows \
             {known} and can work with them"
        )
    } else {
        format!("the tables are up to date, at migration {found}")
    }
}
