//! Where training can go on after an interruption: at most one a job, erased when the job ends.

use bytes::Bytes;

use super::row::{Columns, integer, of_tenant};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::query;
use crate::jobs::store::{Records, Store};
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
    /// `Stale` if the claim is over.
    pub async fn put_checkpoint(
        &self,
        claim: &Claim,
        evaluation: u64,
        data: impl Into<Bytes>,
    ) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.put_for(claim, data.into(), move |mut tx, named| {
            Box::pin(async move {
                tx.bury_checkpoint(&id).await?;
                query(
                    "INSERT INTO checkpoints (job_id, attempt, evaluation, object, bytes,
                         created_at)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
                )
                .bind(id.as_str())
                .bind(attempt)
                .bind(integer(evaluation))
                .bind(&named.key)
                .bind(integer(named.bytes))
                .bind(tx.now)
                .execute(&mut tx.db)
                .await?;
                Ok(())
            })
        })
        .await
    }
}

impl Records<'_> {
    /// The last saved state of a job that has not ended.
    pub async fn checkpoint(self, id: &JobId) -> Result<Option<Checkpoint>> {
        let row = query(of_tenant!("SELECT * FROM checkpoints WHERE job_id = ?1"))
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let columns = Columns::new("checkpoints", &row);
        let data = self.objects().whole(&columns.object()?).await?;
        let Some(data) = data else {
            return Ok(None);
        };
        Ok(Some(Checkpoint {
            attempt: columns.get("attempt")?,
            evaluation: columns.count("evaluation")?,
            data,
            created_at: columns.get("created_at")?,
        }))
    }
}

impl Transaction<'_> {
    /// Removes the saved state of a job, if there is one.
    pub(in crate::jobs::store) async fn bury_checkpoint(&mut self, id: &JobId) -> Result<()> {
        let statements = [
            "INSERT INTO graves (key) SELECT object FROM checkpoints WHERE job_id = ?1",
            "DELETE FROM checkpoints WHERE job_id = ?1",
        ];
        self.run_each(&statements, id.as_str()).await
    }
}
