//! Where waiting jobs stand in the queue.

use std::collections::{BTreeMap, HashMap};

use serde_json::{Value, json};

use super::row::{Columns, ids, of_ids, to_json};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Db, Row, query};
use crate::jobs::{Job, JobId, Result};

/// Where a waiting job stands.
#[derive(Debug)]
pub(super) struct Stand {
    /// Its number in the queue.
    pub(super) position: u64,
    /// The estimated work up to its end.
    pub(super) upto_ms: u64,
    /// The estimated work that it is.
    pub(super) cost_ms: u64,
    /// What tells the others before it from those behind it, where jobs of other tenants wait, too.
    among_others: Option<Value>,
}

/// Where each of these jobs stands that waits.
///
/// A submit asks for this, so that it must not cost more the more jobs wait. What is before a job of
/// its own tenant are the sums without the jobs behind it, of which a new one has none; and the jobs
/// of others are looked at only where there are any.
pub(super) async fn stands(db: &mut Db<'_>, ids: &[&JobId]) -> Result<HashMap<JobId, Stand>> {
    let mut stands = own_stands(db, ids).await?;
    add_others(db, &mut stands).await?;
    Ok(stands)
}

/// The same among the jobs of its own tenant.
async fn own_stands(db: &mut Db<'_>, asked: &[&JobId]) -> Result<HashMap<JobId, Stand>> {
    let rows = query(of_ids!(
        "SELECT id, tenant, created_at, cost_ms, jobs - jobs_behind AS position,
                upto_ms - ms_behind AS upto_ms, served + upto_ms - ms_behind - cost_ms AS turn, others
         FROM (SELECT own.id, own.tenant, own.created_at, own.cost_ms,
                   (SELECT CAST(SUM(waiting.jobs) AS BIGINT) FROM waiting
                    WHERE waiting.tenant = own.tenant AND waiting.priority >= own.priority) AS jobs,
                   (SELECT CAST(SUM(waiting.cost_ms) AS BIGINT) FROM waiting
                    WHERE waiting.tenant = own.tenant AND waiting.priority >= own.priority) AS upto_ms,
                   (SELECT COUNT(*) FROM jobs AS later INDEXED BY jobs_waiting
                    WHERE later.status = 'queued' AND later.tenant = own.tenant
                      AND later.priority = own.priority
                      AND (later.created_at, later.id) > (own.created_at, own.id)) AS jobs_behind,
                   (SELECT CAST(COALESCE(SUM(later.cost_ms), 0) AS BIGINT)
                    FROM jobs AS later INDEXED BY jobs_waiting
                    WHERE later.status = 'queued' AND later.tenant = own.tenant
                      AND later.priority = own.priority
                      AND (later.created_at, later.id) > (own.created_at, own.id)) AS ms_behind,
                   MAX(COALESCE((SELECT served_ms FROM turns WHERE turns.tenant = own.tenant), 0),
                       (SELECT turn FROM now_served)) AS served,
                   EXISTS (SELECT 1 FROM waiting WHERE waiting.tenant <> own.tenant) AS others
               FROM jobs AS own WHERE own.id",
        " AND own.status = 'queued') AS found"
    ))
    .bind(ids(asked.iter().map(|id| id.as_str())))
    .fetch_all(db)
    .await?;
    let stand = |row: &Row| {
        let own = Columns::new("jobs", row);
        let mut among_others = None;
        if own.get("others")? {
            among_others = Some(json!({
                "tenant": own.get::<&str>("tenant")?,
                "created_at": own.get::<i64>("created_at")?,
                "turn": own.get::<i64>("turn")?,
            }));
        }
        let stand = Stand {
            position: own.count("position")?,
            upto_ms: own.count("upto_ms")?,
            cost_ms: own.count("cost_ms")?,
            among_others,
        };
        Ok((own.parsed("id")?, stand))
    };
    rows.iter().map(stand).collect()
}

/// Adds the jobs of other tenants that are before each.
async fn add_others(db: &mut Db<'_>, stands: &mut HashMap<JobId, Stand>) -> Result<()> {
    let asked = stands.iter().filter_map(|(id, stand)| {
        let among_others = stand.among_others.as_ref()?;
        Some((id.as_str(), among_others))
    });
    let asked: BTreeMap<&str, &Value> = asked.collect();
    if asked.is_empty() {
        return Ok(());
    }
    let rows = query(
        "WITH waiting_now AS MATERIALIZED (SELECT * FROM queue),
              own AS MATERIALIZED
                  (SELECT key AS id, json_extract(value, '$.tenant') AS tenant,
                          CAST(json_extract(value, '$.created_at') AS BIGINT) AS created_at,
                          CAST(json_extract(value, '$.turn') AS BIGINT) AS turn
                   FROM json_each(?1))
         SELECT own.id, COUNT(*) AS position, CAST(SUM(other.cost_ms) AS BIGINT) AS upto_ms
         FROM own JOIN waiting_now AS other ON other.tenant <> own.tenant
              AND (other.turn, other.created_at, other.id) <= (own.turn, own.created_at, own.id)
         GROUP BY own.id",
    )
    .bind(to_json(&asked))
    .fetch_all(db)
    .await?;
    for row in &rows {
        let others = Columns::new("jobs", row);
        if let Some(stand) = stands.get_mut(&others.parsed::<JobId>("id")?) {
            stand.position += others.count("position")?;
            stand.upto_ms += others.count("upto_ms")?;
        }
    }
    Ok(())
}

impl Transaction<'_> {
    /// Number of a waiting job in the queue, 1 for the next one.
    pub(in crate::jobs::store) async fn queue_position(
        &mut self,
        id: &JobId,
    ) -> Result<Option<u64>> {
        let stand = stands(&mut self.db, &[id]).await?.remove(id);
        Ok(stand.map(|stand| stand.position))
    }

    /// The same of jobs that were written just now, oldest first.
    pub(in crate::jobs::store) async fn positions_of_new(
        &mut self,
        jobs: &[&Job],
    ) -> Result<HashMap<JobId, u64>> {
        // Each stands right before the next one of its tenant and priority, where no other tenant has jobs
        // that come in between.
        let mut rows: BTreeMap<_, Vec<&JobId>> = BTreeMap::new();
        for job in jobs {
            let row = rows.entry((job.tenant.as_str(), job.priority));
            row.or_default().push(&job.id);
        }
        let last: Vec<&JobId> = rows
            .values()
            .filter_map(|row| row.last().copied())
            .collect();
        let mut known = own_stands(&mut self.db, &last).await?;
        if known.values().any(|stand| stand.among_others.is_some()) {
            if last.len() < jobs.len() {
                let all: Vec<&JobId> = jobs.iter().map(|job| &job.id).collect();
                known = own_stands(&mut self.db, &all).await?;
            }
            add_others(&mut self.db, &mut known).await?;
        }
        let mut positions = HashMap::new();
        for row in rows.values() {
            let last = row.last().and_then(|id| known.get(*id));
            for (behind, id) in (0..).zip(row.iter().rev()) {
                let own = known.get(*id).map(|stand| stand.position);
                let position = own.or_else(|| last?.position.checked_sub(behind));
                positions.extend(position.map(|position| ((*id).clone(), position)));
            }
        }
        Ok(positions)
    }
}
