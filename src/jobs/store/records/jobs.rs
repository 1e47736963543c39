//! Jobs as clients see them: found, listed, cancelled.

use super::act::Act;
use super::outcome::{Fence, Outcome};
use super::retention::keep_of;
use super::row::Columns;
use super::tombstones;
use crate::identity::{Caller, Tenant};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{On, Row, query, scalar};
use crate::jobs::store::{Acts, Records, Store};
use crate::jobs::{
    BatchId, CloudId, Counts, Error, Job, JobFilter, JobId, Lookup, Result, Status, Verdict,
};

/// A page of jobs by the filters, in the order of `$id`. `$from` is found by an index, whatever else is asked:
/// a page must not take the longer the more jobs there are.
macro_rules! list {
    ($from:literal, $id:literal) => {
        concat!(
            "SELECT jobs.* FROM ",
            $from,
            " AND ",
            $id,
            " < COALESCE(?1, '~')
              AND (?2 IS NULL OR status = ?2)
              AND (?3 IS NULL OR cloud_id = ?3)
              AND (?4 IS NULL OR created_at > ?4)
              AND (?8 IS NULL OR json_extract(report, '$.verdict') = ?8)
              AND (?10 IS NULL OR batch_id = ?10)
              AND (?5 IS NULL OR EXISTS (SELECT 1 FROM job_labels AS own
                                         WHERE own.job_id = jobs.id AND key = ?5 AND value = ?6))
              ORDER BY ",
            $id,
            " DESC LIMIT ?7"
        )
    };
}

/// How a page is found: by what leaves the fewest.
fn listed(filter: &JobFilter) -> &'static str {
    if filter.batch_id.is_some() {
        list!("jobs WHERE tenant = ?9 AND batch_id = ?10", "id")
    } else if filter.label.is_some() {
        list!(
            "job_labels CROSS JOIN jobs WHERE jobs.id = job_labels.job_id
             AND job_labels.tenant = ?9 AND job_labels.key = ?5 AND job_labels.value = ?6",
            "job_labels.job_id"
        )
    } else if filter.cloud_id.is_some() {
        list!("jobs WHERE tenant = ?9 AND cloud_id = ?3", "id")
    } else if filter.verdict.is_some() {
        // The expression of the index.
        list!(
            "jobs WHERE tenant = ?9 AND report IS NOT NULL
             AND json_extract(report, '$.verdict') = ?8",
            "id"
        )
    } else if filter.status.is_some() {
        list!("jobs WHERE tenant = ?9 AND status = ?2", "id")
    } else {
        list!("jobs WHERE tenant = ?9", "id")
    }
}

impl Acts<'_> {
    /// Asks a job to end: a waiting one is cancelled at once, a running one is marked for its
    /// worker, one that has ended stays as it is. The answer is the job afterwards.
    pub async fn request_cancel(self, id: &JobId) -> Result<Lookup> {
        let (id, caller) = (id.clone(), self.caller.clone());
        self.store
            .write(move |mut tx| Box::pin(async move { tx.request_cancel(&id, &caller).await }))
            .await
    }
}

impl Records<'_> {
    /// What is known about a job id.
    pub async fn job(self, id: &JobId) -> Result<Lookup> {
        // A job that is erased between the two reads has its tombstone: both are one transaction.
        match find_job(self.readers(), id, self.tenant).await? {
            Some(job) => Ok(Lookup::Found(Box::new(job))),
            None => find_tombstone(self.readers(), id, self.tenant).await,
        }
    }

    /// A page of jobs, newest first; `before` is the last one of the page before it.
    pub async fn list_jobs(
        self,
        filter: &JobFilter,
        before: Option<&JobId>,
        limit: u32,
    ) -> Result<Vec<Job>> {
        let (label, value) = filter
            .label
            .as_ref()
            .map(|(k, v)| (k.as_str(), v.as_str()))
            .unzip();
        query(listed(filter))
            .bind(before.map(JobId::as_str))
            .bind(filter.status.map(Status::name))
            .bind(filter.cloud_id.as_ref().map(CloudId::as_str))
            .bind(filter.created_after)
            .bind(label)
            .bind(value)
            .bind(limit)
            .bind(filter.verdict.map(Verdict::name))
            .bind(self.tenant.as_str())
            .bind(filter.batch_id.as_ref().map(BatchId::as_str))
            .fetch_all(self.readers())
            .await?
            .iter()
            .map(job_of)
            .collect()
    }

    /// Number of the tenant's jobs in each state.
    pub async fn counts(self) -> Result<Counts> {
        let select = "SELECT status, jobs FROM totals WHERE tenant = ?1";
        let rows = query(select).bind(self.tenant.as_str());
        counts_of(&rows.fetch_all(self.readers()).await?)
    }
}

impl Store {
    /// Number of the jobs of all tenants in each state.
    pub async fn counts(&self) -> Result<Counts> {
        let rows =
            query("SELECT status, CAST(SUM(jobs) AS BIGINT) AS jobs FROM totals GROUP BY status");
        counts_of(&rows.fetch_all(self.readers()).await?)
    }

    /// Running jobs of all tenants, newest first.
    pub async fn running_jobs(&self, limit: u32) -> Result<Vec<Job>> {
        query("SELECT * FROM jobs WHERE status = 'running' ORDER BY id DESC LIMIT ?1")
            .bind(limit)
            .fetch_all(self.readers())
            .await?
            .iter()
            .map(job_of)
            .collect()
    }

    /// When the job that has waited longest was submitted, in milliseconds since the epoch.
    pub async fn oldest_queued(&self) -> Result<Option<i64>> {
        scalar("SELECT MIN(created_at) FROM jobs WHERE status = 'queued'")
            .fetch_one(self.readers())
            .await
    }
}

impl Transaction<'_> {
    pub(in crate::jobs::store) async fn request_cancel(
        &mut self,
        id: &JobId,
        caller: &Caller,
    ) -> Result<Lookup> {
        let Some(job) = find_job(&mut self.db, id, &caller.tenant).await? else {
            return find_tombstone(&mut self.db, id, &caller.tenant).await;
        };
        self.witness(caller, Act::JobCancel, id.as_str()).await?;
        if job.status.is_final() {
            return Ok(Lookup::Found(Box::new(job)));
        }
        query("UPDATE jobs SET cancel_requested = 1 WHERE id = ?1")
            .bind(id.as_str())
            .execute(&mut self.db)
            .await?;
        if job.status == Status::Queued {
            self.leave(Fence::of(&job), Outcome::Cancelled).await?;
        }
        Ok(Lookup::Found(Box::new(self.load_job(id).await?)))
    }

    /// A job that is known to be here.
    pub(in crate::jobs::store) async fn load_job(&mut self, id: &JobId) -> Result<Job> {
        let row = query("SELECT * FROM jobs WHERE id = ?1").bind(id.as_str());
        let row = row.fetch_optional(&mut self.db).await?;
        job_of(&row.ok_or(Error::Stale)?)
    }
}

pub(in crate::jobs::store) async fn find_job<'e>(
    db: impl Into<On<'e>>,
    id: &JobId,
    tenant: &Tenant,
) -> Result<Option<Job>> {
    let row = query("SELECT * FROM jobs WHERE id = ?1 AND tenant = ?2")
        .bind(id.as_str())
        .bind(tenant.as_str())
        .fetch_optional(db)
        .await?;
    row.as_ref().map(job_of).transpose()
}

pub(in crate::jobs::store) async fn find_tombstone<'e>(
    db: impl Into<On<'e>>,
    id: &JobId,
    tenant: &Tenant,
) -> Result<Lookup> {
    let tombstone = tombstones::find(db, tenant, id.as_str()).await?;
    Ok(tombstone.map_or(Lookup::Missing, Lookup::Gone))
}

fn counts_of(rows: &[Row]) -> Result<Counts> {
    let count = |row: &Row| {
        let columns = Columns::new("jobs", row);
        Ok((status_of(columns)?, columns.count("jobs")?))
    };
    rows.iter().map(count).collect()
}

fn status_of(columns: Columns<'_>) -> Result<Status> {
    columns.required(Status::from_name(columns.get("status")?), "status")
}

/// Reads a job from its row.
pub(in crate::jobs::store) fn job_of(row: &Row) -> Result<Job> {
    let columns = Columns::new("jobs", row);
    Ok(Job {
        id: columns.parsed("id")?,
        tenant: columns.parsed("tenant")?,
        cloud_id: columns.parsed("cloud_id")?,
        cloud_erased: columns.get::<i64>("cloud_erased")? != 0,
        status: status_of(columns)?,
        phase: columns.name("phase")?,
        preset: columns.required(columns.name("preset")?, "preset")?,
        settings: columns.json("settings")?,
        labels: columns.json("labels")?,
        source: columns.optional_json("source")?,
        derived_from: columns.name("derived_from")?,
        batch_id: columns.name("batch_id")?,
        priority: columns.get("priority")?,
        created_at: columns.get("created_at")?,
        started_at: columns.get("started_at")?,
        finished_at: columns.get("finished_at")?,
        keep: keep_of(columns)?,
        expires_at: columns.get("expires_at")?,
        hold: columns.get::<i64>("hold")? != 0,
        attempt: columns.get("attempt")?,
        failures: columns.get("failures")?,
        failure_reason: columns.optional_json("failure_reason")?,
        worker: columns.get("worker")?,
        lease_until: columns.get("lease_until")?,
        cancel_requested: columns.get::<i64>("cancel_requested")? != 0,
        progress: columns.get("progress")?,
        eta_seconds: columns.get("eta_seconds")?,
        evaluations: columns.count("evaluations")?,
        loss: columns.get("loss")?,
        error: columns.optional_json("error")?,
        report: columns.optional_json("report")?,
        events: columns.get("events")?,
        metrics: columns.get("metrics")?,
    })
}
