//! Where the rows of a service are, for commands that look at them beside it.

use std::path::PathBuf;

use clap::Args;

use super::Failure;
use crate::config::DatabaseUrl;
use crate::jobs::{Error, store};

/// The folder of a service, and the database where that is not in it.
#[derive(Debug, Args)]
pub(super) struct Rows {
    /// Folder of the service, which may run meanwhile.
    #[arg(
        long,
        global = true,
        env = "MESHWAY_DATA_DIR",
        default_value = "meshway-data"
    )]
    pub(super) data_dir: PathBuf,
    /// Postgres database of the service, as `serve --database` names it.
    #[arg(long, global = true, env = "MESHWAY_DATABASE", hide_env_values = true)]
    pub(super) database: Option<DatabaseUrl>,
    /// Say that a pooler in transaction mode stands before the database.
    #[arg(long, global = true, env = "MESHWAY_DATABASE_POOLED", num_args = 0..=1,
          require_equals = true, default_value_t = false, default_missing_value = "true",
          action = clap::ArgAction::Set)]
    database_pooled: bool,
}

impl Rows {
    /// How they are opened, to be read.
    pub(super) fn options(&self) -> store::Options {
        let secret = |url: &DatabaseUrl| url.secret().to_owned();
        store::Options {
            rows_only: true,
            database: self.database.as_ref().map(secret),
            database_pooled: self.database_pooled,
            ..store::Options::default()
        }
    }

    /// Finds that a service has worked in the folder, where the rows are there.
    ///
    /// # Errors
    /// `Input` if none has.
    pub(super) async fn check_folder(&self) -> Result<(), Failure> {
        if self.database.is_some() {
            return Ok(());
        }
        let folder = &self.data_dir;
        match store::is_ours(folder).await {
            Ok(true) => Ok(()),
            Ok(false) => Err(Failure::input(
                folder,
                "no service has worked in this folder; name the one of `serve --data-dir`",
            )),
            Err(error) => Err(Failure::input(folder, error)),
        }
    }

    /// Why nothing could be done, with the name of the place.
    pub(super) fn failed(&self, error: &Error) -> Failure {
        match &self.database {
            Some(database) => Failure::Output(format!("--database {database}: {error}")),
            None => Failure::Output(format!("--data-dir {}: {error}", self.data_dir.display())),
        }
    }
}
