//! Batches: made with all their jobs or not at all, found, listed, cancelled, and gone with their last
//! job.

use super::act::Act;
use super::idempotency::{Idempotency, Subject};
use super::row::{Columns, integer};
use crate::identity::Caller;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Row, query};
use crate::jobs::store::{Acts, Records};
use crate::jobs::{Batch, BatchId, BatchJob, NewJob, Reason, Result, Status, Track, Verdict};

impl Acts<'_> {
    /// Puts all jobs into the queue as a batch, with their events and, under the client's key, the
    /// answer; all in one transaction.
    ///
    /// # Errors
    /// `QueueFull`, `CloudMissing`, `Quota`.
    pub async fn submit_batch(
        self,
        jobs: Vec<NewJob>,
        idempotency: Option<Idempotency<BatchId>>,
    ) -> Result<BatchId> {
        let caller = self.caller.clone();
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let id = BatchId::at(tx.now);
                    tx.insert_batch(&id, jobs.len() as u64, &caller).await?;
                    let wanted: Vec<_> = jobs.iter().map(|new| (new, &caller)).collect();
                    for job in tx.insert_jobs(&wanted, Some(&id)).await? {
                        tx.witness(&caller, Act::JobCreate, job?.id.as_str())
                            .await?;
                    }
                    if let Some(idempotency) = idempotency {
                        let subject = Subject::Batch(id.clone());
                        tx.keep_answer(&idempotency, (&id, subject), &caller.tenant)
                            .await?;
                    }
                    Ok(id)
                })
            })
            .await
    }

    /// Asks all jobs of a batch to end that have not, as [`Acts::request_cancel`]. Whether it is here.
    pub async fn cancel_batch(self, id: &BatchId) -> Result<bool> {
        let (id, caller) = (id.clone(), self.caller.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let select = "SELECT id, finished_at IS NULL AS open FROM jobs
                                  WHERE batch_id = ?1 AND tenant = ?2 ORDER BY id";
                    let jobs = query(select)
                        .bind(id.as_str())
                        .bind(caller.tenant.as_str())
                        .fetch_all(&mut tx.db)
                        .await?;
                    if jobs.is_empty() {
                        return Ok(false);
                    }
                    tx.witness(&caller, Act::BatchCancel, id.as_str()).await?;
                    for row in &jobs {
                        let columns = Columns::new("jobs", row);
                        if columns.get("open")? {
                            tx.request_cancel(&columns.parsed("id")?, &caller).await?;
                        }
                    }
                    Ok(true)
                })
            })
            .await
    }
}

impl Records<'_> {
    /// The batch of the given name.
    pub async fn batch(self, id: &BatchId) -> Result<Option<Batch>> {
        let row = query("SELECT * FROM batch_states WHERE id = ?1 AND tenant = ?2")
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        match row {
            Some(row) => {
                let batch = self.with_jobs(&row).await?;
                // Its last job may have been erased between the two reads.
                Ok(Some(batch).filter(|batch| !batch.jobs.is_empty()))
            }
            None => Ok(None),
        }
    }

    /// A page of batches, newest first; `before` is the last one of the page before it.
    pub async fn list_batches(self, before: Option<&BatchId>, limit: u32) -> Result<Vec<Batch>> {
        let select = "SELECT * FROM batch_states WHERE tenant = ?1 AND (?2 IS NULL OR id < ?2)
                      ORDER BY id DESC LIMIT ?3";
        let rows = query(select)
            .bind(self.tenant.as_str())
            .bind(before.map(BatchId::as_str))
            .bind(limit)
            .fetch_all(self.readers())
            .await?;
        let mut batches = Vec::new();
        for row in &rows {
            batches.push(self.with_jobs(row).await?);
        }
        // As in [`Records::batch`].
        batches.retain(|batch| !batch.jobs.is_empty());
        Ok(batches)
    }

    /// Which events the jobs of a batch have, in the order of the jobs; none if it is not here.
    pub async fn batch_tracks(self, id: &BatchId) -> Result<Vec<Track>> {
        // Ids of events start at 1 and have no gap.
        let select = "SELECT jobs.id, COALESCE(first.seq, first_seq) AS first,
                          COALESCE(last.seq, last_seq) AS last, finished_at IS NOT NULL AS ended
                      FROM jobs
                      LEFT JOIN events AS first ON first.job_id = jobs.id AND first.id = 1
                      LEFT JOIN events AS last ON last.job_id = jobs.id AND last.id = jobs.events
                      LEFT JOIN histories ON histories.job_id = jobs.id
                      WHERE batch_id = ?1 AND jobs.tenant = ?2 ORDER BY jobs.id";
        let rows = query(select)
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_all(self.readers())
            .await?;
        let track = |row: &Row| {
            let columns = Columns::new("jobs", row);
            Ok(Track {
                job: columns.parsed("id")?,
                first: columns.get("first")?,
                last: columns.get("last")?,
                ended: columns.get("ended")?,
            })
        };
        rows.iter().map(track).collect()
    }

    async fn with_jobs(self, row: &Row) -> Result<Batch> {
        let columns = Columns::new("batches", row);
        let id: BatchId = columns.parsed("id")?;
        let select = "SELECT id, cloud_id, source, preset, labels, status, progress,
                          json_extract(report, '$.verdict') AS verdict,
                          json_extract(error, '$.code') AS error
                      FROM jobs WHERE batch_id = ?1 ORDER BY id";
        let jobs = query(select).bind(id.as_str());
        let jobs = jobs.fetch_all(self.readers()).await?;
        Ok(Batch {
            id,
            made: columns.count("made")?,
            progress: columns.get("progress")?,
            created_at: columns.get("created_at")?,
            jobs: jobs.iter().map(job_of).collect::<Result<_>>()?,
        })
    }
}

impl Transaction<'_> {
    async fn insert_batch(&mut self, id: &BatchId, made: u64, caller: &Caller) -> Result<()> {
        let insert = "INSERT INTO batches (id, tenant, made, created_at) VALUES (?1, ?2, ?3, ?4)";
        query(insert)
            .bind(id.as_str())
            .bind(caller.tenant.as_str())
            .bind(integer(made))
            .bind(self.now)
            .execute(&mut self.db)
            .await?;
        self.witness(caller, Act::BatchCreate, id.as_str()).await
    }

    /// Lets a batch go whose last job went.
    pub(in crate::jobs::store) async fn leave_batch(
        &mut self,
        id: &BatchId,
        caller: &Caller,
        reason: Reason,
    ) -> Result<()> {
        let delete = "DELETE FROM batches WHERE id = ?1
                      AND NOT EXISTS (SELECT 1 FROM jobs WHERE batch_id = ?1)";
        let deleted = query(delete).bind(id.as_str());
        if deleted.execute(&mut self.db).await?.rows_affected() == 0 {
            return Ok(());
        }
        self.empty_answers(&Subject::Batch(id.clone())).await?;
        self.leave_tombstone(&caller.tenant, id.as_str(), reason)
            .await?;
        self.witness(caller, Act::BatchDelete, id.as_str()).await
    }
}

fn job_of(row: &Row) -> Result<BatchJob> {
    let columns = Columns::new("jobs", row);
    Ok(BatchJob {
        id: columns.parsed("id")?,
        cloud_id: columns.parsed("cloud_id")?,
        source: columns.optional_json("source")?,
        preset: columns.required(columns.name("preset")?, "preset")?,
        labels: columns.json("labels")?,
        status: columns.required(Status::from_name(columns.get("status")?), "status")?,
        progress: columns.get("progress")?,
        verdict: columns
            .get::<Option<&str>>("verdict")?
            .and_then(Verdict::from_name),
        error: columns.get("error")?,
    })
}
