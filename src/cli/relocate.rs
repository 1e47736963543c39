//! `meshway move`: from a folder with `SQLite` to Postgres, and perhaps to an object store.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::Args;

use super::Failure;
use super::data_folder::DataFolder;
use super::files::Sink;
use crate::config::Backend;
use crate::jobs::store::{Moved, Options};
use crate::jobs::{Error, Store, store};

/// Arguments of `meshway move`.
#[derive(Debug, Args)]
pub(super) struct Arguments {
    /// Folder of the service, which must not run. It stays the one with uploads under way, and without
    /// --objects the one with the bytes.
    #[arg(long, value_name = "DIR")]
    from: PathBuf,
    #[command(flatten)]
    to: Backend,
    /// Move nothing: let the folder be served again as it was when it was moved.
    #[arg(long)]
    take_back: bool,
}

pub(super) fn run(arguments: &Arguments) -> Result<(), Failure> {
    let runtime = super::runtime()?;
    let told = runtime.block_on(relocate(arguments))?;
    Sink::new(Path::new("-"))?.write(|out| out.write_all(told.as_bytes()))
}

async fn relocate(arguments: &Arguments) -> Result<String, Failure> {
    let folder = arguments.from.as_path();
    let refused = |error: Error| Failure::Output(format!("--from {}: {error}", folder.display()));
    if !store::is_ours(folder).await.map_err(refused)? {
        let detail = "no service has worked in this folder; name the one of `serve --data-dir`";
        return Err(Failure::input(folder, detail));
    }
    let _held = DataFolder::take(folder).await?;
    if arguments.take_back {
        Store::take_back(folder).await.map_err(refused)?;
        return Ok("the folder can be served again, as it was when it was moved\n".to_owned());
    }
    let exposures = arguments.to.exposures();
    if !exposures.is_empty() {
        return Err(Failure::Usage(exposures.join("\n")));
    }
    let database = arguments.to.database.as_ref().ok_or_else(|| {
        let detail = "--database is missing: where the rows are to go";
        Failure::Usage(detail.to_owned())
    })?;
    let options = Options {
        database: Some(database.secret().to_owned()),
        database_pooled: arguments.to.database_pooled,
        objects: arguments.to.objects.clone(),
        ..Options::default()
    };
    let moved = Store::relocate(folder, &options, &database.to_string()).await;
    let failed = |error| Failure::Output(format!("--database {database}: {error}"));
    Ok(report(&moved.map_err(failed)?, folder, &arguments.to))
}

fn report(moved: &Moved, folder: &Path, to: &Backend) -> String {
    let mut text = String::new();
    if moved.before {
        text += "the rows were there already, from an earlier try\n";
    }
    if moved.objects.objects > 0 {
        let store::MovedBytes { objects, bytes } = moved.objects;
        let _ = writeln!(text, "{objects} objects, {bytes} bytes, put and read back");
    }
    for (name, sum) in &moved.tables {
        let _ = writeln!(text, "{name:<14}{:>10} rows  {}", sum.rows, sum.sha256);
    }
    if !moved.before {
        text += "each table reads the same on both sides\n";
    }
    let _ = write!(
        text,
        "serve it by\n  meshway serve --data-dir {}",
        folder.display()
    );
    if let Some(database) = &to.database {
        let _ = write!(text, " --database '{database}'");
    }
    if to.database_pooled {
        text += " --database-pooled";
    }
    if let Some(objects) = &to.objects {
        let _ = write!(text, " --objects '{objects}'");
    }
    text += "\n";
    text
}
