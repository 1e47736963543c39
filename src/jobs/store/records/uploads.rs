//! Rows of uploads that may go on after they were cut. Where there is no object store the files are the
//! caller's: in place before the row, removed after it; and bytes are on the disk before the row counts
//! them. With one they are objects.

use std::path::Path;

use tempfile::NamedTempFile;

use super::act::Act;
use super::row::{Columns, integer, to_json};
use crate::identity::Tenant;
use crate::jobs::store::sql::{Row, query, scalar};
use crate::jobs::store::{Acts, Records, Store, Transaction};
use crate::jobs::{CloudId, Error, NewUpload, Reason, Result, Step, Upload, UploadEnd, UploadId};
use crate::reconstruction::cloud::Format;

impl Acts<'_> {
    /// Begins an upload; none if the tenant has as many as `most` that are not complete.
    pub async fn begin_upload(self, new: NewUpload, most: u32) -> Result<Option<Upload>> {
        let caller = self.caller.clone();
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let count = "SELECT COUNT(*) FROM uploads WHERE tenant = ?1 AND complete = 0";
                    let open: i64 = scalar(count)
                        .bind(caller.tenant.as_str())
                        .fetch_one(&mut tx.db)
                        .await?;
                    if open >= i64::from(most) {
                        return Ok(None);
                    }
                    let row = query(
                        "INSERT INTO uploads (id, tenant, length, format, assume_orientation,
                             created_at, expires_at)
                         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?6 + ?7) RETURNING *",
                    )
                    .bind(new.id.as_str())
                    .bind(caller.tenant.as_str())
                    .bind(new.length.map(integer))
                    .bind(new.hint.map(Format::name))
                    .bind(new.assume_orientation)
                    .bind(tx.now)
                    .bind(new.keep_ms)
                    .fetch_one(&mut tx.db)
                    .await?;
                    tx.witness(&caller, Act::UploadCreate, new.id.as_str())
                        .await?;
                    upload_of(&row).map(Some)
                })
            })
            .await
    }

    /// Counts further bytes, which are on the disk.
    ///
    /// # Errors
    /// `Stale` if the upload is gone, complete, or at another place than it was.
    pub async fn advance_upload(self, id: &UploadId, step: Step) -> Result<Upload> {
        let (id, tenant) = (id.clone(), self.caller.tenant.clone());
        self.store
            .write(move |mut tx| Box::pin(async move { tx.advance(&id, &tenant, step).await }))
            .await
    }

    /// Puts further bytes, a file, into the object store and counts them.
    ///
    /// # Errors
    /// As [`Acts::advance_upload`]; `ContentUnavailable` without the object store.
    pub async fn append_part(self, id: &UploadId, step: Step, part: &Path) -> Result<Upload> {
        let (id, tenant) = (id.clone(), self.caller.tenant.clone());
        let kept = self.store.put_file(part).await?;
        let named = kept.clone();
        self.store
            .name(&[&kept], move |mut tx| {
                Box::pin(async move {
                    tx.may_name(&named).await?;
                    let upload = tx.advance(&id, &tenant, step).await?;
                    query(
                        "INSERT INTO upload_parts (upload_id, at, bytes, object)
                         VALUES (?1, ?2, ?3, ?4)",
                    )
                    .bind(id.as_str())
                    .bind(integer(step.from))
                    .bind(integer(step.to - step.from))
                    .bind(named.key)
                    .execute(&mut tx.db)
                    .await?;
                    Ok(upload)
                })
            })
            .await
    }

    /// Keeps what came of a complete upload. Its file may go afterwards.
    ///
    /// # Errors
    /// `Stale` if the upload is gone, or something came of it before.
    pub async fn end_upload(self, id: &UploadId, end: UploadEnd) -> Result<()> {
        let (id, tenant) = (id.clone(), self.caller.tenant.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let (cloud, error) = match &end {
                        UploadEnd::Cloud(id) => (Some(id.as_str()), None),
                        UploadEnd::Refused(problem) => (None, Some(to_json(problem))),
                    };
                    let ended = query(
                        "UPDATE uploads SET cloud_id = ?3, error = ?4
                         WHERE id = ?1 AND tenant = ?2 AND complete = 1
                           AND cloud_id IS NULL AND error IS NULL",
                    )
                    .bind(id.as_str())
                    .bind(tenant.as_str())
                    .bind(cloud)
                    .bind(error)
                    .execute(&mut tx.db)
                    .await?;
                    if ended.rows_affected() == 0 {
                        return Err(Error::Stale);
                    }
                    tx.bury_parts(&id).await
                })
            })
            .await?;
        self.store.bury().await;
        Ok(())
    }

    /// Erases the row of an upload and leaves a tombstone; whether there was one. What came of it
    /// stays.
    pub async fn erase_upload(self, id: &UploadId, reason: Reason) -> Result<bool> {
        let erased = self
            .store
            .erase(|| {
                let (id, caller) = (id.clone(), self.caller.clone());
                Box::new(move |mut tx| {
                    Box::pin(async move {
                        let select = "SELECT id FROM uploads WHERE id = ?1 AND tenant = ?2";
                        let found: Option<String> = scalar(select)
                            .bind(id.as_str())
                            .bind(caller.tenant.as_str())
                            .fetch_optional(&mut tx.db)
                            .await?;
                        if found.is_none() {
                            return Ok(false);
                        }
                        tx.bury_parts(&id).await?;
                        query("DELETE FROM uploads WHERE id = ?1")
                            .bind(id.as_str())
                            .execute(&mut tx.db)
                            .await?;
                        tx.leave_tombstone(&caller.tenant, id.as_str(), reason)
                            .await?;
                        tx.witness(&caller, Act::UploadDelete, id.as_str()).await?;
                        Ok(true)
                    })
                })
            })
            .await?;
        self.store.bury().await;
        Ok(erased)
    }
}

impl Records<'_> {
    /// The upload of the given name.
    pub async fn upload(self, id: &UploadId) -> Result<Option<Upload>> {
        let row = query("SELECT * FROM uploads WHERE id = ?1 AND tenant = ?2")
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(upload_of).transpose()
    }
}

impl Store {
    /// Bytes that uploads of all tenants have announced and not sent yet.
    pub async fn announced_bytes(&self) -> Result<u64> {
        let select = "SELECT CAST(COALESCE(SUM(MAX(length - bytes, 0)), 0) AS BIGINT) FROM uploads
                      WHERE complete = 0 AND length IS NOT NULL";
        let bytes: i64 = scalar(select).fetch_one(self.readers()).await?;
        Ok(bytes.unsigned_abs())
    }

    /// Complete uploads of all tenants of which nothing came yet: their server died meanwhile.
    pub async fn unsettled_uploads(&self) -> Result<Vec<Upload>> {
        let select = "SELECT * FROM uploads
                      WHERE complete = 1 AND cloud_id IS NULL AND error IS NULL ORDER BY id";
        let rows = query(select).fetch_all(self.readers()).await?;
        rows.iter().map(upload_of).collect()
    }

    /// Uploads of all tenants whose time is over, at most so many, with their tenants.
    pub async fn expired_uploads(&self, limit: u32) -> Result<Vec<(UploadId, Tenant)>> {
        let select = "SELECT id, tenant FROM uploads WHERE expires_at <= ?1
                      ORDER BY expires_at LIMIT ?2";
        self.due("uploads", select, limit).await
    }

    /// Names of the uploads of all tenants that have files: one with another name is an orphan.
    pub async fn uploads_with_files(&self) -> Result<Vec<String>> {
        let select = "SELECT id FROM uploads WHERE cloud_id IS NULL AND error IS NULL ORDER BY id";
        scalar(select).fetch_all(self.readers()).await
    }
}

impl Store {
    /// The bytes of an upload that are in the object store, as a temporary file, and their SHA-256.
    ///
    /// # Errors
    /// `ContentUnavailable` without the object store; `Full` if there is no room; `Inconsistent` if some are
    /// not there.
    pub async fn upload_file(&self, id: &UploadId) -> Result<(NamedTempFile, String)> {
        let select = "SELECT object, bytes FROM upload_parts WHERE upload_id = ?1 ORDER BY at";
        let rows = query(select)
            .bind(id.as_str())
            .fetch_all(self.readers())
            .await?;
        let mut parts = Vec::with_capacity(rows.len());
        for row in &rows {
            let columns = Columns::new("upload_parts", row);
            parts.push(columns.object()?);
        }
        let fetched = self.fetch(&parts).await?;
        fetched.ok_or_else(|| Error::Inconsistent {
            table: "upload_parts",
            column: "object",
            detail: format!("bytes of {id} are not there"),
        })
    }
}

impl Transaction<'_> {
    async fn advance(&mut self, id: &UploadId, tenant: &Tenant, step: Step) -> Result<Upload> {
        let row = query(
            "UPDATE uploads SET bytes = ?4, length = ?5, complete = ?6, expires_at = ?7 + ?8
             WHERE id = ?1 AND tenant = ?2 AND bytes = ?3 AND complete = 0 RETURNING *",
        )
        .bind(id.as_str())
        .bind(tenant.as_str())
        .bind(integer(step.from))
        .bind(integer(step.to))
        .bind(step.length.map(integer))
        .bind(step.complete)
        .bind(self.now)
        .bind(step.keep_ms)
        .fetch_optional(&mut self.db)
        .await?;
        upload_of(&row.ok_or(Error::Stale)?)
    }

    async fn bury_parts(&mut self, id: &UploadId) -> Result<()> {
        let statements = [
            "INSERT INTO graves (key) SELECT object FROM upload_parts WHERE upload_id = ?1",
            "DELETE FROM upload_parts WHERE upload_id = ?1",
        ];
        self.run_each(&statements, id.as_str()).await
    }
}

fn upload_of(row: &Row) -> Result<Upload> {
    let columns = Columns::new("uploads", row);
    let cloud: Option<CloudId> = columns.name("cloud_id")?;
    let refused = columns.optional_json("error")?;
    let end = cloud.map(UploadEnd::Cloud);
    let length: Option<i64> = columns.get("length")?;
    Ok(Upload {
        id: columns.parsed("id")?,
        tenant: columns.parsed("tenant")?,
        length: length.map(i64::unsigned_abs),
        bytes: columns.count("bytes")?,
        complete: columns.get::<i64>("complete")? != 0,
        hint: columns.name("format")?,
        assume_orientation: columns.get::<i64>("assume_orientation")? != 0,
        end: end.or(refused.map(UploadEnd::Refused)),
        created_at: columns.get("created_at")?,
        expires_at: columns.get("expires_at")?,
    })
}
