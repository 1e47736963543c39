//! Rows of uploaded clouds. The files are the caller's: in place before the row, removed after it.

use sqlx::sqlite::SqliteRow;

use super::idempotency::Subject;
use super::row::{Columns, integer, to_json};
use crate::jobs::store::Store;
use crate::jobs::store::sqlite::writer::Transaction;
use crate::jobs::{Cloud, CloudDeletion, CloudId, NewCloud, Result};

impl Store {
    /// Writes the row of a cloud. If one with the same bytes exists, returns that and `false`.
    pub async fn insert_cloud(&self, new: NewCloud) -> Result<(Cloud, bool)> {
        self.write(move |tx| {
            Box::pin(async move {
                let inserted = sqlx::query(
                    "INSERT INTO clouds (id, sha256, bytes, format, points, summary, created_at)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7) ON CONFLICT (sha256) DO NOTHING",
                )
                .bind(CloudId::new().as_str())
                .bind(&new.sha256)
                .bind(integer(new.bytes))
                .bind(new.summary.format.name())
                .bind(integer(new.summary.points))
                .bind(to_json(&new.summary))
                .bind(tx.now)
                .execute(&mut *tx.db)
                .await?;
                let row = sqlx::query("SELECT * FROM clouds WHERE sha256 = ?1")
                    .bind(&new.sha256)
                    .fetch_one(&mut *tx.db)
                    .await?;
                Ok((cloud_of(&row)?, inserted.rows_affected() == 1))
            })
        })
        .await
    }

    /// The cloud of the given name.
    pub async fn cloud(&self, id: &CloudId) -> Result<Option<Cloud>> {
        let row = sqlx::query("SELECT * FROM clouds WHERE id = ?1")
            .bind(id.as_str())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(cloud_of).transpose()
    }

    /// The cloud with the given bytes.
    pub async fn cloud_by_sha256(&self, sha256: &str) -> Result<Option<Cloud>> {
        let row = sqlx::query("SELECT * FROM clouds WHERE sha256 = ?1")
            .bind(sha256)
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(cloud_of).transpose()
    }

    /// A page of clouds, newest first; `before` is the last one of the page before it.
    pub async fn list_clouds(&self, before: Option<&CloudId>, limit: u32) -> Result<Vec<Cloud>> {
        sqlx::query("SELECT * FROM clouds WHERE ?1 IS NULL OR id < ?1 ORDER BY id DESC LIMIT ?2")
            .bind(before.map(CloudId::as_str))
            .bind(limit)
            .fetch_all(self.readers())
            .await?
            .iter()
            .map(cloud_of)
            .collect()
    }

    /// Erases a cloud's row unless a job that has not ended needs it, and leaves a tombstone. Jobs
    /// that have ended keep its name and know that it is gone.
    pub async fn delete_cloud(&self, id: &CloudId) -> Result<CloudDeletion> {
        let erased = self.erase(|| {
            let id = id.clone();
            Box::new(move |mut tx| Box::pin(async move { tx.erase_cloud(&id).await }))
        });
        let deletion = erased.await?;
        self.bury().await;
        Ok(deletion)
    }

    /// The hashes of all clouds: a file with another name is an orphan.
    pub async fn sha256s(&self) -> Result<Vec<String>> {
        Ok(
            sqlx::query_scalar("SELECT sha256 FROM clouds ORDER BY sha256")
                .fetch_all(self.readers())
                .await?,
        )
    }
}

impl Transaction<'_> {
    async fn erase_cloud(&mut self, id: &CloudId) -> Result<CloudDeletion> {
        let in_use: bool = sqlx::query_scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs
             WHERE cloud_id = ?1 AND status IN ('queued', 'running'))",
        )
        .bind(id.as_str())
        .fetch_one(&mut *self.db)
        .await?;
        if in_use {
            return Ok(CloudDeletion::InUse);
        }
        let deleted = sqlx::query("DELETE FROM clouds WHERE id = ?1 RETURNING *")
            .bind(id.as_str())
            .fetch_optional(&mut *self.db)
            .await?;
        let Some(row) = deleted else {
            return Ok(CloudDeletion::Missing);
        };
        sqlx::query("UPDATE jobs SET cloud_erased = 1 WHERE cloud_id = ?1")
            .bind(id.as_str())
            .execute(&mut *self.db)
            .await?;
        self.empty_answers(&Subject::Cloud(id.clone())).await?;
        self.leave_tombstone(id.as_str()).await?;
        Ok(CloudDeletion::Deleted(cloud_of(&row)?))
    }
}

fn cloud_of(row: &SqliteRow) -> Result<Cloud> {
    let columns = Columns::new("clouds", row);
    Ok(Cloud {
        id: columns.parsed("id")?,
        sha256: columns.get("sha256")?,
        bytes: columns.count("bytes")?,
        summary: columns.json("summary")?,
        created_at: columns.get("created_at")?,
    })
}
