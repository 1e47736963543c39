//! Rows of uploaded clouds. Their files are the caller's: in place before the row, removed after it.
//! With an object store their bytes are objects as others.

use std::path::Path;

use super::act::Act;
use super::row::{Columns, integer, to_json};
use crate::jobs::store::content::objects::Kept;
use crate::jobs::store::sql::{Row, query, scalar};
use crate::jobs::store::{Acts, Records, Store};
use crate::jobs::{Cloud, CloudId, NewCloud, Result};

impl Acts<'_> {
    /// Writes the row of a cloud. If the tenant has one with the same bytes, returns that and `false`.
    ///
    /// # Errors
    /// `Quota`.
    pub async fn insert_cloud(self, new: NewCloud) -> Result<(Cloud, bool)> {
        self.write_cloud(new, None).await
    }

    /// The same for one whose file is written into the object store before.
    ///
    /// # Errors
    /// `Quota`.
    pub async fn upload_cloud(self, new: NewCloud, file: &Path) -> Result<(Cloud, bool)> {
        let object = self.store.put_file(file).await?;
        self.write_cloud(new, Some(object)).await
    }

    async fn write_cloud(self, new: NewCloud, object: Option<Kept>) -> Result<(Cloud, bool)> {
        let caller = self.caller.clone();
        let objects: Vec<Kept> = object.clone().into_iter().collect();
        let objects: Vec<&Kept> = objects.iter().collect();
        self.store
            .name(&objects, move |mut tx| {
                Box::pin(async move {
                    let id = CloudId::at(tx.now);
                    if let Some(object) = &object {
                        tx.may_name(object).await?;
                        // The new object takes the place of the one before.
                        let bury = "INSERT INTO graves (key) SELECT object FROM clouds
                                    WHERE tenant = ?1 AND sha256 = ?2 AND object IS NOT NULL";
                        query(bury)
                            .bind(caller.tenant.as_str())
                            .bind(&new.sha256)
                            .execute(&mut tx.db)
                            .await?;
                    }
                    // The one that is there is kept for the longer of the two times; NULL is for ever. It is
                    // read as the last upload asked for.
                    let row = query(
                    "INSERT INTO clouds (id, sha256, bytes, format, points, summary, created_at,
                         tenant, expires_at, object)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?7 + ?9, ?10)
                     ON CONFLICT (tenant, sha256)
                     DO UPDATE SET summary = excluded.summary,
                         object = COALESCE(excluded.object, clouds.object),
                         expires_at = MAX(clouds.expires_at, excluded.expires_at)
                     RETURNING *",
                )
                .bind(id.as_str())
                .bind(&new.sha256)
                .bind(integer(new.bytes))
                .bind(new.summary.format.name())
                .bind(integer(new.summary.points))
                .bind(to_json(&new.summary))
                .bind(tx.now)
                .bind(caller.tenant.as_str())
                .bind(new.keep_ms)
                .bind(object.map(|object| object.key))
                .fetch_one(&mut tx.db)
                .await?;
                    let cloud = cloud_of(&row)?;
                    let created = cloud.id == id;
                    if created {
                        // It is among the stored bytes already.
                        tx.check_bytes(&caller, 0).await?;
                    }
                    let act = if created {
                        Act::CloudCreate
                    } else {
                        Act::CloudMatch
                    };
                    tx.witness(&caller, act, cloud.id.as_str()).await?;
                    Ok((cloud, created))
                })
            })
            .await
    }
}

impl Records<'_> {
    /// The cloud of the given name.
    pub async fn cloud(self, id: &CloudId) -> Result<Option<Cloud>> {
        let row = query("SELECT * FROM clouds WHERE id = ?1 AND tenant = ?2")
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(cloud_of).transpose()
    }

    /// The cloud with the given bytes.
    pub async fn cloud_by_sha256(self, sha256: &str) -> Result<Option<Cloud>> {
        let row = query("SELECT * FROM clouds WHERE sha256 = ?1 AND tenant = ?2")
            .bind(sha256)
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(cloud_of).transpose()
    }

    /// A page of clouds, newest first; `before` is the last one of the page before it.
    pub async fn list_clouds(self, before: Option<&CloudId>, limit: u32) -> Result<Vec<Cloud>> {
        let select = "SELECT * FROM clouds WHERE tenant = ?1 AND (?2 IS NULL OR id < ?2)
                      ORDER BY id DESC LIMIT ?3";
        query(select)
            .bind(self.tenant.as_str())
            .bind(before.map(CloudId::as_str))
            .bind(limit)
            .fetch_all(self.readers())
            .await?
            .iter()
            .map(cloud_of)
            .collect()
    }
}

impl Store {
    /// Whether a cloud of any tenant has these bytes in the folder: their file is one for all, and
    /// goes with the last of them.
    pub async fn holds_sha256(&self, sha256: &str) -> Result<bool> {
        let select = "SELECT EXISTS (SELECT 1 FROM clouds WHERE sha256 = ?1 AND object IS NULL)";
        scalar(select).bind(sha256).fetch_one(self.readers()).await
    }

    /// The hashes of the clouds of all tenants in the folder: a file with another name is an orphan.
    pub async fn sha256s(&self) -> Result<Vec<String>> {
        let select = "SELECT DISTINCT sha256 FROM clouds WHERE object IS NULL ORDER BY sha256";
        scalar(select).fetch_all(self.readers()).await
    }
}

pub(in crate::jobs::store) fn cloud_of(row: &Row) -> Result<Cloud> {
    let columns = Columns::new("clouds", row);
    Ok(Cloud {
        id: columns.parsed("id")?,
        sha256: columns.get("sha256")?,
        bytes: columns.count("bytes")?,
        object: columns.get("object")?,
        summary: columns.json("summary")?,
        created_at: columns.get("created_at")?,
        expires_at: columns.get("expires_at")?,
        hold: columns.get::<i64>("hold")? != 0,
    })
}
