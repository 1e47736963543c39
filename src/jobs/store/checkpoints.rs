//! Where training can go on after an interruption: at most one a job, erased when the job ends.

use super::Store;
use super::row::{Columns, integer};
use crate::jobs::{Claim, JobId, Result};

/// A saved state of training.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Checkpoint {
    /// Attempt that wrote it.
    pub attempt: i64,
    /// Evaluations of loss and gradient when it was taken.
    pub evaluation: u64,
    /// What training needs to go on.
    pub data: Vec<u8>,
    /// When it was written, in milliseconds since the epoch.
    pub created_at: i64,
}

impl Store {
    /// Saves the state of training in the place of an earlier one.
    ///
    /// # Errors
    /// `Stale`, and as every write: `Busy`, `Full`, `Closed`, `Database`.
    pub async fn put_checkpoint(
        &self,
        claim: &Claim,
        evaluation: u64,
        data: Vec<u8>,
    ) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.write(move |mut tx| {
            Box::pin(async move {
                tx.held(&id, attempt).await?;
                sqlx::query(
                    "INSERT INTO checkpoints (job_id, attempt, evaluation, data, created_at)
                     VALUES (?1, ?2, ?3, ?4, ?5)
                     ON CONFLICT (job_id) DO UPDATE SET attempt = excluded.attempt,
                         evaluation = excluded.evaluation, data = excluded.data,
                         created_at = excluded.created_at",
                )
                .bind(id.as_str())
                .bind(attempt)
                .bind(integer(evaluation))
                .bind(data)
                .bind(tx.now)
                .execute(&mut *tx.db)
                .await?;
                Ok(())
            })
        })
        .await
    }

    /// The last saved state of a job that has not ended.
    ///
    /// # Errors
    /// As every read: `Busy`, `Closed`, `Inconsistent`, `Database`.
    pub async fn checkpoint(&self, id: &JobId) -> Result<Option<Checkpoint>> {
        let row = sqlx::query("SELECT * FROM checkpoints WHERE job_id = ?1")
            .bind(id.as_str())
            .fetch_optional(self.readers())
            .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let columns = Columns::new("checkpoints", &row);
        Ok(Some(Checkpoint {
            attempt: columns.get("attempt")?,
            evaluation: columns.count("evaluation")?,
            data: columns.get("data")?,
            created_at: columns.get("created_at")?,
        }))
    }
}
