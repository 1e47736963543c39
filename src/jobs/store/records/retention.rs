//! How long clouds and jobs are kept, what holds them, and how they go: by a client's wish, or because
//! their time is over. Rows first, in one transaction with tombstone and audit row; a server that dies
//! after it leaves bytes without a row, which the next one removes.

use std::str::FromStr;

use super::act::Act;
use super::clouds::cloud_of;
use super::idempotency::Subject;
use super::jobs::{find_job, find_tombstone};
use super::row::Columns;
use crate::identity::{Caller, Tenant};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Row, query, scalar};
use crate::jobs::store::{Acts, Store};
use crate::jobs::{
    Cloud, CloudDeletion, CloudId, Error, JobId, Keep, KeepChange, Lookup, Reason, Result,
};

/// How long a job stays after its mesh was fetched whole, where it goes with that: for a client whose
/// connection broke at the last moment.
const GRACE_MS: i64 = 60_000;

impl Acts<'_> {
    /// Erases a job in whatever state, with everything that belongs to it, and leaves a tombstone;
    /// a worker that runs it finds its claim lost. The answer is what was known before.
    ///
    /// # Errors
    /// `Held` if it is held.
    pub async fn delete_job(self, id: &JobId) -> Result<Lookup> {
        self.erase_job(id, Reason::Deleted).await
    }

    /// The same for a job whose time is over.
    ///
    /// # Errors
    /// `Stale` if it is not due, or held.
    pub async fn expire_job(self, id: &JobId) -> Result<Lookup> {
        self.erase_job(id, Reason::Expired).await
    }

    async fn erase_job(self, id: &JobId, reason: Reason) -> Result<Lookup> {
        let erased = self.store.erase(|| {
            let (id, caller) = (id.clone(), self.caller.clone());
            Box::new(move |mut tx| {
                Box::pin(async move { tx.erase_job(&id, &caller, reason).await })
            })
        });
        let erased = erased.await?;
        self.store.bury().await;
        Ok(erased)
    }

    /// [`Acts::delete_job`], and in the same transaction its cloud, unless another
    /// job names that or it is held. `None` where the cloud stays.
    ///
    /// # Errors
    /// `Held` if the job is held.
    pub async fn erase_job_and_cloud(self, id: &JobId) -> Result<(Lookup, Option<Cloud>)> {
        let erased = self.store.erase(|| {
            let (id, caller) = (id.clone(), self.caller.clone());
            Box::new(move |mut tx| {
                Box::pin(async move {
                    let erased = tx.erase_job(&id, &caller, Reason::Deleted).await?;
                    let Lookup::Found(job) = &erased else {
                        return Ok((erased, None));
                    };
                    let cloud = job.cloud_id.clone();
                    let cloud = tx.erase_unnamed_cloud(&cloud, &caller).await?;
                    Ok((erased, cloud))
                })
            })
        });
        let erased = erased.await?;
        self.store.bury().await;
        Ok(erased)
    }

    /// Erases a cloud's row unless a job that has not ended needs it, and leaves a tombstone. Jobs
    /// that have ended keep its name and know that it is gone.
    ///
    /// # Errors
    /// `Held` if it is held, or a job that names it is.
    pub async fn delete_cloud(self, id: &CloudId) -> Result<CloudDeletion> {
        self.erase_cloud(id, Reason::Deleted).await
    }

    /// The same for a cloud whose time is over.
    ///
    /// # Errors
    /// `Stale` if it is not due, or held.
    pub async fn expire_cloud(self, id: &CloudId) -> Result<CloudDeletion> {
        self.erase_cloud(id, Reason::Expired).await
    }

    async fn erase_cloud(self, id: &CloudId, reason: Reason) -> Result<CloudDeletion> {
        let erased = self.store.erase(|| {
            let (id, caller) = (id.clone(), self.caller.clone());
            Box::new(move |mut tx| {
                Box::pin(async move { tx.erase_cloud(&id, &caller, reason).await })
            })
        });
        let deletion = erased.await?;
        self.store.bury().await;
        Ok(deletion)
    }

    /// Changes how long a job is kept, counted from now where it has ended, whether it is held, and its
    /// priority. The answer is the job afterwards.
    pub async fn keep_job(self, id: &JobId, change: KeepChange) -> Result<Lookup> {
        let (id, caller) = (id.clone(), self.caller.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let Some(job) = find_job(&mut tx.db, &id, &caller.tenant).await? else {
                        return find_tombstone(&mut tx.db, &id, &caller.tenant).await;
                    };
                    let keep = change.keep.unwrap_or(job.keep);
                    let ends = match change.keep {
                        Some(keep) if job.status.is_final() => keep.ms.map(|ms| tx.now + ms),
                        _ => job.expires_at,
                    };
                    query(
                        "UPDATE jobs SET hold = ?2, keep_ms = ?3, once = ?4, expires_at = ?5,
                                         priority = ?6
                         WHERE id = ?1",
                    )
                    .bind(id.as_str())
                    .bind(change.hold.unwrap_or(job.hold))
                    .bind(keep.ms)
                    .bind(keep.once)
                    .bind(ends)
                    .bind(change.priority.unwrap_or(job.priority))
                    .execute(&mut tx.db)
                    .await?;
                    let act = match change.hold {
                        Some(true) => Act::JobHold,
                        Some(false) => Act::JobRelease,
                        None => Act::JobKeep,
                    };
                    tx.witness(&caller, act, id.as_str()).await?;
                    Ok(Lookup::Found(Box::new(tx.load_job(&id).await?)))
                })
            })
            .await
    }

    /// Changes how long a cloud is kept, counted from now, and whether it is held. The answer is the
    /// cloud afterwards; none if it is not here.
    pub async fn keep_cloud(self, id: &CloudId, change: KeepChange) -> Result<Option<Cloud>> {
        let (id, caller) = (id.clone(), self.caller.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let row = query(
                        "UPDATE clouds SET hold = COALESCE(?3, hold),
                             expires_at = CASE WHEN ?4 = 1 THEN ?5 + ?6 ELSE expires_at END
                         WHERE id = ?1 AND tenant = ?2 RETURNING *",
                    )
                    .bind(id.as_str())
                    .bind(caller.tenant.as_str())
                    .bind(change.hold)
                    .bind(change.keep.is_some())
                    .bind(tx.now)
                    .bind(change.keep.and_then(|keep| keep.ms))
                    .fetch_optional(&mut tx.db)
                    .await?;
                    let Some(row) = row else { return Ok(None) };
                    let act = match change.hold {
                        Some(true) => Act::CloudHold,
                        Some(false) => Act::CloudRelease,
                        None => Act::CloudKeep,
                    };
                    tx.witness(&caller, act, id.as_str()).await?;
                    cloud_of(&row).map(Some)
                })
            })
            .await
    }

    /// Notes that the bytes of a cloud were uploaded once more: it is kept for the longer of the two
    /// times.
    pub async fn match_cloud(self, id: &CloudId, keep_ms: Option<i64>) -> Result<()> {
        let (id, caller) = (id.clone(), self.caller.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    // MAX of NULL, which is for ever, is NULL.
                    let update = "UPDATE clouds SET expires_at = MAX(expires_at, ?3 + ?4)
                                  WHERE id = ?1 AND tenant = ?2";
                    query(update)
                        .bind(id.as_str())
                        .bind(caller.tenant.as_str())
                        .bind(tx.now)
                        .bind(keep_ms)
                        .execute(&mut tx.db)
                        .await?;
                    tx.witness(&caller, Act::CloudMatch, id.as_str()).await
                })
            })
            .await
    }
}

impl Store {
    /// The mesh of a job was sent whole: one that goes with that goes soon.
    pub async fn fetched(&self, id: &JobId, tenant: &Tenant) -> Result<()> {
        let (id, tenant) = (id.clone(), tenant.clone());
        self.write(move |mut tx| {
            Box::pin(async move {
                let soon = tx.now + GRACE_MS;
                let update = "UPDATE jobs SET expires_at = MIN(COALESCE(expires_at, ?3), ?3)
                              WHERE id = ?1 AND tenant = ?2 AND once = 1";
                query(update)
                    .bind(id.as_str())
                    .bind(tenant.as_str())
                    .bind(soon)
                    .execute(&mut tx.db)
                    .await?;
                Ok(())
            })
        })
        .await
    }

    /// Jobs of all tenants whose time is over and that nothing holds, at most so many.
    pub async fn due_jobs(&self, limit: u32) -> Result<Vec<(JobId, Tenant)>> {
        let select = "SELECT id, tenant FROM jobs WHERE expires_at <= ?1 AND hold = 0
                      ORDER BY expires_at LIMIT ?2";
        self.due("jobs", select, limit).await
    }

    /// Clouds of all tenants whose time is over and that nothing holds or needs, at most so many.
    pub async fn due_clouds(&self, limit: u32) -> Result<Vec<(CloudId, Tenant)>> {
        let select = "SELECT id, tenant FROM clouds WHERE expires_at <= ?1 AND hold = 0
                      AND NOT EXISTS (SELECT 1 FROM jobs WHERE cloud_id = clouds.id
                                      AND (hold = 1 OR status IN ('queued', 'running')))
                      ORDER BY expires_at LIMIT ?2";
        self.due("clouds", select, limit).await
    }

    /// What a statement finds of a table, given now and the most rows, with the tenants.
    pub(super) async fn due<T>(
        &self,
        table: &'static str,
        select: &'static str,
        limit: u32,
    ) -> Result<Vec<(T, Tenant)>>
    where
        T: FromStr<Err: ToString>,
    {
        let rows = query(select).bind(self.now()).bind(limit);
        let rows = rows.fetch_all(self.readers()).await?;
        let named = |row: &Row| {
            let columns = Columns::new(table, row);
            Ok((columns.parsed("id")?, columns.parsed("tenant")?))
        };
        rows.iter().map(named).collect()
    }
}

impl Transaction<'_> {
    async fn erase_job(&mut self, id: &JobId, caller: &Caller, reason: Reason) -> Result<Lookup> {
        let Some(job) = find_job(&mut self.db, id, &caller.tenant).await? else {
            return find_tombstone(&mut self.db, id, &caller.tenant).await;
        };
        self.check_erasable(job.hold, job.expires_at, reason)?;
        // Foreign keys are enforced: if a table were missing here, the last statement would fail.
        let statements = [
            "INSERT INTO graves (key) SELECT object FROM meshes WHERE job_id = ?1",
            "INSERT INTO graves (key) SELECT object FROM models WHERE job_id = ?1",
            "INSERT INTO graves (key) SELECT object FROM checkpoints WHERE job_id = ?1",
            "INSERT INTO graves (key) SELECT object FROM histories WHERE job_id = ?1",
            "INSERT INTO graves (key) SELECT object FROM shares WHERE job_id = ?1",
            "DELETE FROM shares WHERE job_id = ?1",
            "DELETE FROM histories WHERE job_id = ?1",
            "DELETE FROM job_labels WHERE job_id = ?1",
            "DELETE FROM meshes WHERE job_id = ?1",
            "DELETE FROM models WHERE job_id = ?1",
            "DELETE FROM checkpoints WHERE job_id = ?1",
            "DELETE FROM metrics WHERE job_id = ?1",
            "DELETE FROM gradients WHERE job_id = ?1",
            "DELETE FROM events WHERE job_id = ?1",
            "DELETE FROM jobs WHERE id = ?1",
        ];
        self.run_each(&statements, id.as_str()).await?;
        self.empty_answers(&Subject::Job(id.clone())).await?;
        self.leave_tombstone(&caller.tenant, id.as_str(), reason)
            .await?;
        self.witness(caller, Act::JobDelete, id.as_str()).await?;
        if let Some(batch) = &job.batch_id {
            self.leave_batch(batch, caller, reason).await?;
        }
        Ok(Lookup::Found(Box::new(job)))
    }

    async fn erase_cloud(
        &mut self,
        id: &CloudId,
        caller: &Caller,
        reason: Reason,
    ) -> Result<CloudDeletion> {
        let row = query("SELECT * FROM clouds WHERE id = ?1 AND tenant = ?2")
            .bind(id.as_str())
            .bind(caller.tenant.as_str())
            .fetch_optional(&mut self.db)
            .await?;
        let Some(row) = row else {
            return Ok(CloudDeletion::Missing);
        };
        let cloud = cloud_of(&row)?;
        let held: bool = scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE cloud_id = ?1 AND tenant = ?2 AND hold = 1)",
        )
        .bind(id.as_str())
        .bind(caller.tenant.as_str())
        .fetch_one(&mut self.db)
        .await?;
        self.check_erasable(cloud.hold || held, cloud.expires_at, reason)?;
        let in_use: bool = scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs
             WHERE cloud_id = ?1 AND tenant = ?2 AND status IN ('queued', 'running'))",
        )
        .bind(id.as_str())
        .bind(caller.tenant.as_str())
        .fetch_one(&mut self.db)
        .await?;
        if in_use {
            return Ok(CloudDeletion::InUse);
        }
        let statements = [
            "INSERT INTO graves (key) SELECT object FROM clouds WHERE id = ?1 AND object IS NOT NULL",
            "DELETE FROM clouds WHERE id = ?1",
            "UPDATE jobs SET cloud_erased = 1 WHERE cloud_id = ?1",
        ];
        self.run_each(&statements, id.as_str()).await?;
        self.empty_answers(&Subject::Cloud(id.clone())).await?;
        self.leave_tombstone(&caller.tenant, id.as_str(), reason)
            .await?;
        self.witness(caller, Act::CloudDelete, id.as_str()).await?;
        Ok(CloudDeletion::Deleted(Box::new(cloud)))
    }

    /// Erases a cloud that no job names and nothing holds; none if it stays.
    async fn erase_unnamed_cloud(
        &mut self,
        id: &CloudId,
        caller: &Caller,
    ) -> Result<Option<Cloud>> {
        let named: bool = scalar(
            "SELECT EXISTS (SELECT 1 FROM jobs WHERE cloud_id = ?1)
                 OR EXISTS (SELECT 1 FROM clouds WHERE id = ?1 AND hold = 1)",
        )
        .bind(id.as_str())
        .fetch_one(&mut self.db)
        .await?;
        if named {
            return Ok(None);
        }
        match self.erase_cloud(id, caller, Reason::Deleted).await? {
            CloudDeletion::Deleted(cloud) => Ok(Some(*cloud)),
            CloudDeletion::InUse | CloudDeletion::Missing => Ok(None),
        }
    }

    fn check_erasable(&self, hold: bool, expires_at: Option<i64>, reason: Reason) -> Result<()> {
        let due = expires_at.is_some_and(|at| at <= self.now);
        match reason {
            Reason::Expired if hold || !due => Err(Error::Stale),
            _ if hold => Err(Error::Held),
            _ => Ok(()),
        }
    }
}

/// What the columns of a job tell of how long it is kept.
pub(in crate::jobs::store) fn keep_of(columns: Columns<'_>) -> Result<Keep> {
    Ok(Keep {
        ms: columns.get("keep_ms")?,
        once: columns.get::<i64>("once")? != 0,
    })
}
