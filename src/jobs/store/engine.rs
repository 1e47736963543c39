//! The database of the rows: `SQLite` in the data folder, or Postgres.

use std::time::Duration;

use sqlx::SqliteConnection;

use crate::jobs::Result;
use crate::jobs::store::postgres::Session as PostgresSession;
use crate::jobs::store::sql::{Db, query};
use crate::jobs::store::sqlite::writer::{give_back, shrink};
use crate::jobs::store::writer::{self, Session};

/// The connection that writes rows.
pub(in crate::jobs::store) enum Engine {
    Sqlite(SqliteConnection),
    Postgres(Box<PostgresSession>),
}

/// The writing task of the rows.
pub(in crate::jobs::store) type Writer = writer::Writer<Engine>;

/// A transaction that writes rows.
pub(in crate::jobs::store) type Transaction<'c> = writer::Transaction<'c, Engine>;

impl Session for Engine {
    type Db<'c> = Db<'c>;

    fn db(&mut self) -> Db<'_> {
        match self {
            Self::Sqlite(db) => Db::Sqlite(db),
            Self::Postgres(session) => session.rows(),
        }
    }

    async fn begin(&mut self, patience: Duration) -> Result<()> {
        match self {
            Self::Sqlite(db) => db.begin(patience).await,
            Self::Postgres(session) => session.begin(patience).await,
        }
    }

    async fn run(&mut self, statement: &'static str) -> Result<()> {
        match self {
            Self::Sqlite(db) => db.run(statement).await,
            Self::Postgres(session) => session.run(statement).await,
        }
    }

    async fn commit(&mut self) -> Result<()> {
        match self {
            Self::Sqlite(db) => db.commit().await,
            Self::Postgres(session) => session.commit().await,
        }
    }

    async fn roll_back(&mut self) {
        match self {
            Self::Sqlite(db) => db.roll_back().await,
            Self::Postgres(session) => session.roll_back().await,
        }
    }

    async fn close(self) -> Result<()> {
        match self {
            Self::Sqlite(db) => Session::close(db).await,
            Self::Postgres(session) => session.close().await,
        }
    }
}

impl Writer {
    /// Gives free pages back to the file system until no more than so many are left. Postgres sees to
    /// that itself.
    pub(in crate::jobs::store) async fn vacuum(&self, keep: i64) -> Result<()> {
        shrink(keep, || {
            self.write(move |tx| {
                Box::pin(async move {
                    match tx.db {
                        Db::Sqlite(db) => give_back(db, keep).await,
                        Db::Postgres(..) => Ok(keep),
                    }
                })
            })
        })
        .await
    }
}

impl writer::Transaction<'_, Engine> {
    /// Runs statements about what has this id, which is their parameter `?1`, one after the other.
    pub(in crate::jobs::store) async fn run_each(
        &mut self,
        statements: &[&'static str],
        id: &str,
    ) -> Result<()> {
        for statement in statements {
            query(*statement).bind(id).execute(&mut self.db).await?;
        }
        Ok(())
    }
}
