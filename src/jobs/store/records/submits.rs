//! Jobs as they are put into the queue: those that are submitted while others are written come together,
//! with as many statements as one of them.

use std::collections::{HashMap, HashSet};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::oneshot;

use super::act::Act;
use super::idempotency::{Idempotency, Subject};
use super::jobs::job_of;
use super::queue::cost_ms;
use super::quotas::limits_jobs;
use super::row::{Columns, ids, of_ids, to_json};
use crate::identity::Caller;
use crate::jobs::store::sql::{either, many, query};
use crate::jobs::store::{Acts, Store, Transaction};
use crate::jobs::{BatchId, Error, Job, JobId, NewEvent, NewJob, Result};

/// Jobs that are written together at most: who submits another kind of thing waits for all of them.
const TOGETHER: usize = 64;

/// Submits that wait for their transaction.
#[derive(Default)]
pub(in crate::jobs::store) struct Submits {
    waiting: Mutex<Vec<(Arc<Submit>, Reply)>>,
    /// Who writes: the others wait, and find theirs written.
    turn: tokio::sync::Mutex<()>,
}

type Reply = oneshot::Sender<Result<Job>>;

struct Submit {
    new: NewJob,
    caller: Caller,
    idempotency: Option<Idempotency>,
}

impl Submits {
    /// Those that wait, oldest first.
    fn take(&self) -> Vec<(Arc<Submit>, Reply)> {
        let mut waiting = self.lock();
        let count = waiting.len().min(TOGETHER);
        waiting.drain(..count).collect()
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<(Arc<Submit>, Reply)>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Acts<'_> {
    /// Puts a job into the queue, writes its `job.queued` event and, under the client's key, the
    /// answer; all in one transaction. An answer means that the job is on disk.
    ///
    /// # Errors
    /// `QueueFull`, `CloudMissing`, `Quota`.
    pub async fn submit(self, new: NewJob, idempotency: Option<Idempotency>) -> Result<Job> {
        let (reply, answer) = oneshot::channel();
        let submit = Arc::new(Submit {
            new,
            caller: self.caller.clone(),
            idempotency,
        });
        self.store.inner.submits.lock().push((submit, reply));
        // Not by this future: if it is dropped, the others that it writes still get their answers.
        tokio::spawn(self.store.clone().write_submits());
        answer.await.unwrap_or(Err(Error::Closed))
    }
}

impl Store {
    /// Writes the submits that wait, if there are any left.
    async fn write_submits(self) {
        let submits = &self.inner.submits;
        let _turn = submits.turn.lock().await;
        let (asked, replies): (Vec<_>, Vec<_>) = submits.take().into_iter().unzip();
        match self.submit_together(asked.clone()).await {
            Ok(made) => {
                for (reply, job) in replies.into_iter().zip(made) {
                    // Whoever asked may have gone away; the job stays.
                    drop(reply.send(job));
                }
            }
            // Nothing was written, for a reason that any of them may have been.
            Err(error) if asked.len() > 1 && !has_common_cause(&error) => {
                for (reply, asked) in replies.into_iter().zip(asked) {
                    let made = self.submit_together(vec![asked]).await;
                    let job = made.and_then(|mut made| made.pop().unwrap_or(Err(Error::Closed)));
                    drop(reply.send(job));
                }
            }
            Err(error) => {
                for reply in replies {
                    drop(reply.send(Err(error.clone())));
                }
            }
        }
    }

    /// What became of each, in their order. Of a job that is refused nothing is written, whatever becomes of
    /// the others.
    async fn submit_together(&self, asked: Vec<Arc<Submit>>) -> Result<Vec<Result<Job>>> {
        if asked.is_empty() {
            return Ok(Vec::new());
        }
        self.write(move |mut tx| {
            Box::pin(async move {
                let wanted: Vec<_> = asked
                    .iter()
                    .map(|asked| (&asked.new, &asked.caller))
                    .collect();
                let made = tx.insert_jobs(&wanted, None).await?;
                for (asked, job) in asked.iter().zip(&made) {
                    let Ok(job) = job else { continue };
                    tx.witness(&asked.caller, Act::JobCreate, job.id.as_str())
                        .await?;
                    if let Some(idempotency) = &asked.idempotency {
                        let subject = Subject::Job(job.id.clone());
                        tx.keep_answer(idempotency, (job, subject), &asked.caller.tenant)
                            .await?;
                    }
                }
                Ok(made)
            })
        })
        .await
    }
}

/// Whether the error has nothing to do with what was to be written.
fn has_common_cause(error: &Error) -> bool {
    matches!(error, Error::Busy | Error::Full(_) | Error::Closed)
}

/// A job and who wants it.
type Wanted<'w> = (&'w NewJob, &'w Caller);

impl Transaction<'_> {
    /// Puts jobs into the queue, of a batch or each alone, in their order; what became of each.
    pub(in crate::jobs::store) async fn insert_jobs(
        &mut self,
        wanted: &[Wanted<'_>],
        batch: Option<&BatchId>,
    ) -> Result<Vec<Result<Job>>> {
        let mut made = Vec::with_capacity(wanted.len());
        // A quota counts what is here, so that whoever has one comes after what was before.
        for some in wanted.chunk_by(|(_, one), (_, next)| !limits_jobs(one) && !limits_jobs(next)) {
            for some in some.chunks(TOGETHER) {
                made.extend(self.insert_together(some, batch).await?);
            }
        }
        Ok(made)
    }

    async fn insert_together(
        &mut self,
        wanted: &[Wanted<'_>],
        batch: Option<&BatchId>,
    ) -> Result<Vec<Result<Job>>> {
        let mut checked = self.check_together(wanted).await?;
        if let ([(_, caller)], [Ok(_)]) = (wanted, &*checked) {
            match self.check_job(caller).await {
                Err(error @ Error::Quota { .. }) => checked = vec![Err(error)],
                result => result?,
            }
        }
        let accepted = wanted.iter().zip(&checked);
        let accepted: Vec<(&JobId, Wanted<'_>)> = accepted
            .filter_map(|(wanted, id)| Some((id.as_ref().ok()?, *wanted)))
            .collect();
        let mut jobs = HashMap::new();
        if !accepted.is_empty() {
            jobs = self.insert_rows(&accepted, batch).await?;
            self.insert_labels(&accepted).await?;
            let in_order = accepted.iter().filter_map(|(id, _)| jobs.get(id));
            self.tell_that_they_wait(&in_order.collect::<Vec<_>>())
                .await?;
        }
        let made = checked.into_iter().map(|id| {
            id.and_then(|id| {
                jobs.remove(&id).ok_or_else(|| Error::Inconsistent {
                    table: "jobs",
                    column: "id",
                    detail: format!("{id} was written and is not there"),
                })
            })
        });
        Ok(made.collect())
    }

    /// An id for each whose cloud is here, and for which there is room in the queue.
    async fn check_together(&mut self, wanted: &[Wanted<'_>]) -> Result<Vec<Result<JobId>>> {
        let clouds: HashSet<&str> = wanted
            .iter()
            .map(|(new, _)| new.cloud_id.as_str())
            .collect();
        let rows = query(of_ids!(
            "SELECT id, tenant, (SELECT CAST(COALESCE(SUM(jobs), 0) AS BIGINT) FROM waiting) AS waiting
             FROM clouds WHERE id"
        ))
        .bind(ids(clouds))
        .fetch_all(&mut self.db)
        .await?;
        let (mut known, mut waiting) = (HashSet::new(), 0);
        for row in &rows {
            let columns = Columns::new("clouds", row);
            known.insert((columns.get::<&str>("id")?, columns.get::<&str>("tenant")?));
            waiting = columns.count("waiting")?;
        }
        let limit = self.options.queue_limit;
        let checked = wanted.iter().map(|(new, caller)| {
            if !known.contains(&(new.cloud_id.as_str(), caller.tenant.as_str())) {
                return Err(Error::CloudMissing(new.cloud_id.clone()));
            }
            if waiting >= limit {
                return Err(Error::QueueFull { limit });
            }
            waiting += 1;
            Ok(JobId::at(self.now))
        });
        Ok(checked.collect())
    }

    /// Writes the rows of jobs.
    async fn insert_rows(
        &mut self,
        accepted: &[(&JobId, Wanted<'_>)],
        batch: Option<&BatchId>,
    ) -> Result<HashMap<JobId, Job>> {
        // The first event is counted with each.
        let insert = either(
            "INSERT INTO jobs (status, events, id, cloud_id, preset, settings, labels, derived_from,
                 created_at, source, tenant, priority, cost_ms, account, keep_ms, once, batch_id)
             VALUES ('queued', 1, ?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12, ?13, ?14, ?15)
             RETURNING *",
            "INSERT INTO jobs (status, events, id, cloud_id, preset, settings, labels, derived_from,
                 created_at, source, tenant, priority, cost_ms, account, keep_ms, once, batch_id)
             SELECT 'queued', 1, * FROM unnest(CAST(?1 AS TEXT[]), CAST(?2 AS TEXT[]),
                 CAST(?3 AS TEXT[]), CAST(?4 AS TEXT[]), CAST(?5 AS TEXT[]), CAST(?6 AS TEXT[]),
                 CAST(?7 AS BIGINT[]), CAST(?8 AS TEXT[]), CAST(?9 AS TEXT[]), CAST(?10 AS BIGINT[]),
                 CAST(?11 AS BIGINT[]), CAST(?12 AS TEXT[]), CAST(?13 AS BIGINT[]),
                 CAST(?14 AS BIGINT[]), CAST(?15 AS TEXT[]))
             RETURNING *",
        );
        let mut inserted = many(insert);
        for (id, (new, caller)) in accepted {
            inserted.row([
                id.as_str().into(),
                new.cloud_id.as_str().into(),
                new.preset.name().into(),
                to_json(&new.settings).into(),
                to_json(&new.labels).into(),
                new.derived_from.as_ref().map(JobId::as_str).into(),
                self.now.into(),
                new.source.as_ref().map(to_json).into(),
                caller.tenant.as_str().into(),
                new.priority.into(),
                cost_ms(new.cost_seconds).into(),
                caller.account().into(),
                new.keep.ms.into(),
                new.keep.once.into(),
                batch.map(BatchId::as_str).into(),
            ]);
        }
        let rows = inserted.fetch_all(&mut self.db).await?;
        let job = |row| {
            let job = job_of(row)?;
            Ok((job.id.clone(), job))
        };
        rows.iter().map(job).collect()
    }

    async fn insert_labels(&mut self, accepted: &[(&JobId, Wanted<'_>)]) -> Result<()> {
        for (id, (new, caller)) in accepted {
            for (key, value) in &new.labels {
                let insert =
                    "INSERT INTO job_labels (tenant, key, value, job_id) VALUES (?1, ?2, ?3, ?4)";
                query(insert)
                    .bind(caller.tenant.as_str())
                    .bind(key)
                    .bind(value)
                    .bind(id.as_str())
                    .execute(&mut self.db)
                    .await?;
            }
        }
        Ok(())
    }

    /// Writes the first event of each.
    async fn tell_that_they_wait(&mut self, jobs: &[&Job]) -> Result<()> {
        let positions = self.positions_of_new(jobs).await?;
        let queued = jobs.iter().map(|job| {
            let position = positions.get(&job.id).copied();
            let reason = None;
            (*job, NewEvent::Queued { position, reason })
        });
        self.insert_first_events(&queued.collect::<Vec<_>>()).await
    }
}
