//! What a worker writes while it holds a job, and the one transaction that makes it a success.

use bytes::Bytes;
use futures_util::future::BoxFuture;

use super::outcome::{Fence, Outcome};
use super::row::integer;
use crate::jobs::assessment::Assessment;
use crate::jobs::attempt::sha256_hex;
use crate::jobs::store::Store;
use crate::jobs::store::Transaction;
use crate::jobs::store::content::objects::Kept;
use crate::jobs::store::sql::{query, scalar};
use crate::jobs::{Claim, Error, JobId, NewEvent, NewMesh, Record, Result, Success};
use crate::reconstruction::Phase;

impl Store {
    /// Writes progress, events, metrics and histograms together, or nothing.
    ///
    /// # Errors
    /// `Stale` if the claim is over.
    pub async fn record(&self, claim: &Claim, record: Record) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.write(move |mut tx| Box::pin(async move { tx.record(&id, attempt, &record).await }))
            .await
    }

    /// Writes the surface at an evaluation, in the place of an earlier one at the same evaluation,
    /// and the event `job.snapshot`.
    ///
    /// # Errors
    /// `SnapshotAtZero`; `Stale` if the claim is over.
    pub async fn put_snapshot(&self, claim: &Claim, evaluation: u64, mesh: NewMesh) -> Result<()> {
        if evaluation == 0 {
            return Err(Error::SnapshotAtZero);
        }
        let id = claim.job.id.clone();
        self.put_for(claim, mesh.data.clone(), move |mut tx, named| {
            Box::pin(async move {
                tx.put_mesh(&id, evaluation, &mesh, &named).await?;
                let event = NewEvent::Snapshot {
                    evaluation,
                    vertices: mesh.vertices,
                    triangles: mesh.triangles,
                    bytes: mesh.data.len() as u64,
                    verdict: mesh.verdict,
                };
                tx.append_event(&id, &event).await
            })
        })
        .await
    }

    /// Puts content of an attempt into its place, and has `work` name it.
    ///
    /// # Errors
    /// `Stale` if the claim is over; nothing is kept then, nor if `work` fails.
    pub(super) async fn put_for<F>(&self, claim: &Claim, content: Bytes, work: F) -> Result<()>
    where
        F: for<'c> FnOnce(Transaction<'c>, Kept) -> BoxFuture<'c, Result<()>> + Send + 'static,
    {
        self.check_held(claim).await?;
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        let object = self.put_object(content).await?;
        let named = object.clone();
        self.name(&[&object], move |mut tx| {
            Box::pin(async move {
                tx.held(&id, attempt).await?;
                tx.may_name(&named).await?;
                work(tx, named).await
            })
        })
        .await
    }

    /// Ends the job with its result: mesh, report, model, last metrics, event and status in one
    /// transaction. A cancellation that was asked for meanwhile has lost the race.
    ///
    /// # Errors
    /// `Stale` if the claim is over; the job runs on as it was then.
    pub async fn succeed(&self, claim: &Claim, success: Success) -> Result<()> {
        self.check_held(claim).await?;
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        let Success {
            mesh,
            report,
            model,
            last,
        } = success;
        let hash = sha256_hex(&model);
        let surface = self.put_object(mesh.data.clone()).await?;
        let network = match self.put_object(model.into()).await {
            Ok(network) => network,
            Err(error) => {
                self.discard(vec![surface.key]).await;
                return Err(error);
            }
        };
        let named = (surface.clone(), network.clone());
        self.name(&[&surface, &network], move |mut tx| {
            Box::pin(async move {
                let (surface, network) = named;
                tx.record(&id, attempt, &last).await?;
                tx.may_name(&surface).await?;
                tx.may_name(&network).await?;
                tx.put_mesh(&id, 0, &mesh, &surface).await?;
                tx.put_model(&id, hash, &network).await?;
                let event = NewEvent::Succeeded {
                    assessment: Assessment::of(Some(&report)),
                    vertices: mesh.vertices,
                    triangles: mesh.triangles,
                    bytes: mesh.data.len() as u64,
                };
                let outcome = Outcome::Succeeded { report, event };
                tx.leave(Fence::running(&id, attempt), outcome).await
            })
        })
        .await
    }
}

impl Transaction<'_> {
    async fn record(&mut self, id: &JobId, attempt: i64, record: &Record) -> Result<()> {
        let found = query(
            "SELECT events, metrics, tenant FROM jobs
             WHERE id = ?1 AND attempt = ?2 AND status = 'running'",
        )
        .bind(id.as_str())
        .bind(attempt)
        .fetch_optional(&mut self.db)
        .await?;
        let found = found.ok_or(Error::Stale)?;
        let (mut events, metrics) = (found.at::<i64>(0)?, found.at::<i64>(1)?);
        let tenant: &str = found.at(2)?;
        for event in &record.events {
            if event.kind().repeats() && events >= self.options.events_limit {
                continue;
            }
            events += 1;
            self.insert_event((id, tenant), (events, attempt), event)
                .await?;
        }
        let metrics = self.insert_metrics(id, metrics, &record.metrics).await?;
        // COALESCE keeps what is there: a number that is not one is bound as NULL, too.
        query(
            "UPDATE jobs SET phase = COALESCE(?2, phase), progress = COALESCE(?3, progress),
                 eta_seconds = COALESCE(?4, eta_seconds), evaluations = COALESCE(?5, evaluations),
                 loss = COALESCE(?6, loss), events = ?7, metrics = ?8
             WHERE id = ?1",
        )
        .bind(id.as_str())
        .bind(record.phase.map(phase_name))
        .bind(record.progress)
        .bind(record.eta_seconds)
        .bind(record.evaluations.map(integer))
        .bind(record.loss)
        .bind(events)
        .bind(metrics)
        .execute(&mut self.db)
        .await?;
        self.insert_gradients(id, &record.gradients).await
    }

    /// Erases what an earlier attempt wrote after its last checkpoint, or all of it without one.
    pub(in crate::jobs::store) async fn forget_after_checkpoint(
        &mut self,
        id: &JobId,
    ) -> Result<()> {
        let evaluation: i64 = scalar("SELECT evaluation FROM checkpoints WHERE job_id = ?1")
            .bind(id.as_str())
            .fetch_optional(&mut self.db)
            .await?
            .unwrap_or(0);
        for statement in [
            "DELETE FROM metrics WHERE job_id = ?1 AND evaluation > ?2",
            "DELETE FROM gradients WHERE job_id = ?1 AND evaluation > ?2",
            "INSERT INTO graves (key)
                 SELECT object FROM meshes WHERE job_id = ?1 AND evaluation > ?2",
            "DELETE FROM meshes WHERE job_id = ?1 AND evaluation > ?2",
            "UPDATE jobs SET evaluations = ?2,
                 metrics = (SELECT COUNT(*) FROM metrics WHERE job_id = ?1) WHERE id = ?1",
        ] {
            query(statement)
                .bind(id.as_str())
                .bind(evaluation)
                .execute(&mut self.db)
                .await?;
        }
        Ok(())
    }
}

/// Its name in the database: the same as in JSON.
fn phase_name(phase: Phase) -> &'static str {
    match phase {
        Phase::Sampling => "sampling",
        Phase::Training => "training",
        Phase::Surface => "surface",
        Phase::Report => "report",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_are_named_as_in_json() {
        for phase in [
            Phase::Sampling,
            Phase::Training,
            Phase::Surface,
            Phase::Report,
        ] {
            assert_eq!(serde_json::to_value(phase).unwrap(), phase_name(phase));
        }
    }
}
