//! The training series and the gradient histograms.

use super::row::{Columns, integer, of_tenant, to_json};
use crate::jobs::store::Records;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Row, query};
use crate::jobs::{Error, JobId, Result};
use crate::reconstruction::training::{GradientHistogram, Metrics};

impl Records<'_> {
    /// Accepted iterations after the given evaluation, in order.
    pub async fn metrics(
        self,
        id: &JobId,
        after_evaluation: u64,
        limit: u32,
    ) -> Result<Vec<Metrics>> {
        let rows = query(of_tenant!(
            "SELECT * FROM metrics WHERE job_id = ?1 AND evaluation > ?3",
            "ORDER BY evaluation LIMIT ?4"
        ))
        .bind(id.as_str())
        .bind(self.tenant.as_str())
        .bind(integer(after_evaluation))
        .bind(limit)
        .fetch_all(self.readers())
        .await?;
        if rows.is_empty() {
            let history = self.history(id).await?;
            let mut metrics = history.map_or_else(Vec::new, |history| history.metrics);
            metrics.retain(|metrics| metrics.evaluation > after_evaluation);
            metrics.truncate(limit as usize);
            return Ok(metrics);
        }
        rows.iter().map(metrics_of).collect()
    }

    /// All gradient histograms of a job, in the order of their evaluations.
    pub async fn gradients(self, id: &JobId) -> Result<Vec<GradientHistogram>> {
        let rows = query(of_tenant!(
            "SELECT * FROM gradients WHERE job_id = ?1",
            "ORDER BY evaluation"
        ))
        .bind(id.as_str())
        .bind(self.tenant.as_str())
        .fetch_all(self.readers())
        .await?;
        if rows.is_empty() {
            let history = self.history(id).await?;
            return Ok(history.map_or_else(Vec::new, |history| history.gradients));
        }
        rows.iter().map(histogram_of).collect()
    }
}

impl Transaction<'_> {
    /// Adds rows to the `present` ones of a job, up to the limit; one that is there stays. How many there are then.
    pub(in crate::jobs::store) async fn insert_metrics(
        &mut self,
        id: &JobId,
        present: i64,
        rows: &[Metrics],
    ) -> Result<i64> {
        let mut count = present;
        for metrics in rows {
            if count >= self.options.metrics_limit {
                break;
            }
            let weight_norms: Vec<u8> = metrics
                .weight_norms
                .iter()
                .flat_map(|norm| norm.to_le_bytes())
                .collect();
            let inserted = query(
                "INSERT INTO metrics (job_id, evaluation, iteration, loss, validation_loss,
                     gradient_norm, step_length, weight_norms, blocks)
                 VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)
                 ON CONFLICT (job_id, evaluation) DO NOTHING",
            )
            .bind(id.as_str())
            .bind(integer(metrics.evaluation))
            .bind(integer(metrics.iteration))
            .bind(metrics.loss)
            .bind(metrics.validation_loss)
            .bind(metrics.gradient_norm)
            .bind(metrics.step_length)
            .bind(weight_norms)
            .bind(metrics.blocks.map(integer))
            .execute(&mut self.db)
            .await?;
            count += inserted.rows_affected() as i64;
        }
        Ok(count)
    }

    /// Adds histograms; one that is there stays.
    pub(in crate::jobs::store) async fn insert_gradients(
        &mut self,
        id: &JobId,
        histograms: &[GradientHistogram],
    ) -> Result<()> {
        for histogram in histograms {
            query(
                "INSERT INTO gradients (job_id, evaluation, data) VALUES (?1, ?2, ?3)
                 ON CONFLICT (job_id, evaluation) DO NOTHING",
            )
            .bind(id.as_str())
            .bind(integer(histogram.evaluation))
            .bind(to_json(&histogram.layers))
            .execute(&mut self.db)
            .await?;
        }
        Ok(())
    }
}

pub(super) fn histogram_of(row: &Row) -> Result<GradientHistogram> {
    let columns = Columns::new("gradients", row);
    Ok(GradientHistogram {
        evaluation: columns.count("evaluation")?,
        layers: columns.json("data")?,
    })
}

pub(super) fn metrics_of(row: &Row) -> Result<Metrics> {
    let columns = Columns::new("metrics", row);
    let weight_norms: Vec<u8> = columns.get("weight_norms")?;
    let (norms, rest) = weight_norms.as_chunks::<8>();
    if !rest.is_empty() {
        return Err(Error::inconsistent("metrics", "weight_norms")(
            "is no sequence of 64-bit numbers",
        ));
    }
    Ok(Metrics {
        iteration: columns.count("iteration")?,
        evaluation: columns.count("evaluation")?,
        loss: columns.float("loss")?,
        validation_loss: columns.get("validation_loss")?,
        gradient_norm: columns.float("gradient_norm")?,
        step_length: columns.float("step_length")?,
        weight_norms: norms.iter().map(|norm| f64::from_le_bytes(*norm)).collect(),
        blocks: columns
            .get::<Option<i64>>("blocks")?
            .map(|count| count as u64),
    })
}
