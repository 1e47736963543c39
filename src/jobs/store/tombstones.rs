//! What stays of erased jobs and clouds.

use sqlx::Executor;
use sqlx::sqlite::Sqlite;

use super::Store;
use super::row::Columns;
use super::writer::Transaction;
use crate::jobs::{CloudId, Result, Tombstone};

impl Store {
    /// What stays of a cloud, if it was here and was erased.
    ///
    /// # Errors
    /// As every read: `Busy`, `Closed`, `Inconsistent`, `Database`.
    pub async fn cloud_tombstone(&self, id: &CloudId) -> Result<Option<Tombstone>> {
        find(self.readers(), id.as_str()).await
    }
}

impl Transaction<'_> {
    /// Leaves a tombstone for the job or the cloud of the given name.
    pub(super) async fn bury(&mut self, id: &str, reason: &'static str) -> Result<()> {
        sqlx::query("INSERT INTO tombstones (id, deleted_at, reason) VALUES (?1, ?2, ?3)")
            .bind(id)
            .bind(self.now)
            .bind(reason)
            .execute(&mut *self.db)
            .await?;
        Ok(())
    }
}

/// The tombstone of the job or the cloud of the given name.
pub(super) async fn find<'e>(
    db: impl Executor<'e, Database = Sqlite>,
    id: &str,
) -> Result<Option<Tombstone>> {
    let row = sqlx::query("SELECT * FROM tombstones WHERE id = ?1")
        .bind(id)
        .fetch_optional(db)
        .await?;
    let tombstone = row.map(|row| {
        let columns = Columns::new("tombstones", &row);
        Ok(Tombstone {
            deleted_at: columns.get("deleted_at")?,
            reason: columns.get("reason")?,
        })
    });
    tombstone.transpose()
}
