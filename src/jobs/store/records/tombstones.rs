//! What stays of erased jobs and clouds.

use sqlx::Executor;
use sqlx::sqlite::Sqlite;

use super::row::Columns;
use crate::jobs::store::Store;
use crate::jobs::store::sqlite::writer::Transaction;
use crate::jobs::{CloudId, Result, Tombstone};

/// Why a client's wish erased it: the only reason there is so far.
const DELETED: &str = "deleted";

impl Store {
    /// What stays of a cloud, if it was here and was erased.
    pub async fn cloud_tombstone(&self, id: &CloudId) -> Result<Option<Tombstone>> {
        find(self.readers(), id.as_str()).await
    }
}

impl Transaction<'_> {
    /// Leaves a tombstone for the job or the cloud of the given name.
    pub(in crate::jobs::store) async fn leave_tombstone(&mut self, id: &str) -> Result<()> {
        sqlx::query("INSERT INTO tombstones (id, deleted_at, reason) VALUES (?1, ?2, ?3)")
            .bind(id)
            .bind(self.now)
            .bind(DELETED)
            .execute(&mut *self.db)
            .await?;
        Ok(())
    }
}

/// The tombstone of the job or the cloud of the given name.
pub(in crate::jobs::store) async fn find<'e>(
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
