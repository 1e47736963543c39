//! What stays of erased jobs, batches, clouds and uploads.

use super::row::Columns;
use crate::identity::Tenant;
use crate::jobs::store::sql::{On, query};
use crate::jobs::store::{Records, Store, Transaction};
use crate::jobs::{BatchId, CloudId, Reason, Result, Tombstone, UploadId};

impl Records<'_> {
    /// What stays of a cloud, if it was here and was erased.
    pub async fn cloud_tombstone(self, id: &CloudId) -> Result<Option<Tombstone>> {
        find(self.readers(), self.tenant, id.as_str()).await
    }

    /// What stays of a batch, if it was here and was erased.
    pub async fn batch_tombstone(self, id: &BatchId) -> Result<Option<Tombstone>> {
        find(self.readers(), self.tenant, id.as_str()).await
    }

    /// What stays of an upload, if it was here and was erased.
    pub async fn upload_tombstone(self, id: &UploadId) -> Result<Option<Tombstone>> {
        find(self.readers(), self.tenant, id.as_str()).await
    }
}

impl Store {
    /// Names of what was erased at this time or later, of all tenants, with the times of their ends.
    pub async fn erased_since(&self, time: i64) -> Result<Vec<(String, i64)>> {
        let select = "SELECT id, deleted_at FROM tombstones WHERE deleted_at >= ?1";
        let rows = query(select).bind(time).fetch_all(self.readers()).await?;
        rows.iter()
            .map(|row| Ok((row.at(0)?, row.at(1)?)))
            .collect()
    }
}

impl Transaction<'_> {
    /// Leaves a tombstone for the job, batch, cloud or upload of the given name.
    pub(in crate::jobs::store) async fn leave_tombstone(
        &mut self,
        tenant: &Tenant,
        id: &str,
        reason: Reason,
    ) -> Result<()> {
        let insert =
            "INSERT INTO tombstones (id, deleted_at, reason, tenant) VALUES (?1, ?2, ?3, ?4)";
        query(insert)
            .bind(id)
            .bind(self.now)
            .bind(reason.name())
            .bind(tenant.as_str())
            .execute(&mut self.db)
            .await?;
        Ok(())
    }
}

/// The tombstone of the tenant's job or cloud of the given name.
pub(in crate::jobs::store) async fn find<'e>(
    db: impl Into<On<'e>>,
    tenant: &Tenant,
    id: &str,
) -> Result<Option<Tombstone>> {
    let row = query("SELECT * FROM tombstones WHERE id = ?1 AND tenant = ?2")
        .bind(id)
        .bind(tenant.as_str())
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
