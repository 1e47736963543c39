//! What is done with jobs whose workers are gone together with their service.

use crate::jobs::store::Store;
use crate::jobs::store::sql::query;
use crate::jobs::{JobId, Requeue, Result};

use super::outcome::{Fence, Outcome};
use super::row::Columns;

impl Store {
    /// Gives all running jobs back into the queue, without a failed attempt; one that shall end is
    /// cancelled. Their number.
    pub async fn release_all(&self) -> Result<u64> {
        self.write(|mut tx| {
            Box::pin(async move {
                let select = "SELECT id, attempt, cancel_requested FROM jobs
                              WHERE status = 'running' ORDER BY created_at, id";
                let rows = query(select).fetch_all(&mut tx.db).await?;
                for row in &rows {
                    let columns = Columns::new("jobs", row);
                    let id: JobId = columns.parsed("id")?;
                    let outcome = match columns.get::<i64>("cancel_requested")? {
                        0 => Outcome::Requeued(Requeue::Released),
                        _ => Outcome::Cancelled,
                    };
                    let fence = Fence::running(&id, columns.get("attempt")?);
                    tx.leave(fence, outcome).await?;
                }
                Ok(rows.len() as u64)
            })
        })
        .await
    }
}
