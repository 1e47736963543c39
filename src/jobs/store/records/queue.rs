//! Whose job is next, and how much was worked for whom.
//!
//! Tenants take turns, weighed by the estimated cost of their jobs; the view `queue` of the database
//! is the one definition of the order (migrations 0011, 0017 and 0018 have the rule). What is claimed moves its tenant
//! on by its cost. Within a tenant a higher priority goes first, then what was submitted first.

use std::collections::HashMap;

use super::outcome::Fence;
use super::row::{Columns, integer};
use super::stands::stands;
use crate::identity::Tenant;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{On, Row, query, scalar};
use crate::jobs::store::{Records, Store};
use crate::jobs::{JobId, Place, Result};

/// Days that worked time is kept.
const COMPUTE_DAYS: i64 = 40;

/// Longest time between two countings, in milliseconds: a renewal is due long before. A clock that
/// was set forward must not use up the day of a tenant.
const LONGEST_COUNT_MS: i64 = 60_000;

/// Days of worked time are those of UTC.
pub(in crate::jobs::store) const DAY_MS: i64 = 24 * 60 * 60 * 1_000;

impl Records<'_> {
    /// Where a waiting job of the tenant stands; none when it does not wait.
    pub async fn place(self, id: &JobId) -> Result<Option<Place>> {
        let select = "SELECT EXISTS (SELECT 1 FROM jobs WHERE id = ?1 AND tenant = ?2)";
        let own: bool = scalar(select)
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_one(self.readers())
            .await?;
        if !own {
            return Ok(None);
        }
        let mut at_once = self.readers().begin().await?;
        let Some(stand) = stands(&mut at_once.db(), &[id]).await?.remove(id) else {
            return Ok(None);
        };
        let running_ms = running_ms(&mut at_once.db()).await?;
        Ok(Some(Place {
            position: stand.position,
            before_ms: running_ms + stand.upto_ms - stand.cost_ms,
            cost_ms: stand.cost_ms,
        }))
    }

    /// The places of the waiting jobs of the tenant, for lists: looking for each of them would read
    /// the queue as often.
    pub async fn places(self) -> Result<HashMap<JobId, Place>> {
        let mut before_ms = running_ms(self.readers()).await?;
        let rows = query("SELECT id, tenant, cost_ms FROM queue ORDER BY turn, created_at, id")
            .fetch_all(self.readers())
            .await?;
        let mut places = HashMap::new();
        for (position, row) in (1..).zip(&rows) {
            let columns = Columns::new("jobs", row);
            let cost_ms = columns.count("cost_ms")?;
            if columns.get::<&str>("tenant")? == self.tenant.as_str() {
                let place = Place {
                    position,
                    before_ms,
                    cost_ms,
                };
                places.insert(columns.parsed("id")?, place);
            }
            before_ms += cost_ms;
        }
        Ok(places)
    }
}

/// Jobs of a tenant that wait, of one size.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Waiting {
    /// Whose they are.
    pub tenant: Tenant,
    /// How long the work is estimated to take.
    pub size: &'static str,
    /// How many there are.
    pub jobs: u64,
    /// When the first of them was submitted, in milliseconds since the epoch.
    pub oldest_at: i64,
}

impl Store {
    /// What waits, by tenant and by the time that the work is estimated to take: `short` below a minute,
    /// `medium` below ten, `long`.
    pub async fn waiting(&self) -> Result<Vec<Waiting>> {
        let select = "SELECT tenant, COUNT(*) AS jobs, MIN(created_at) AS oldest_at,
                          CASE WHEN cost_ms < 60000 THEN 'short' WHEN cost_ms < 600000 THEN 'medium'
                               ELSE 'long' END AS size
                      FROM jobs WHERE status = 'queued' GROUP BY 1, 4";
        let rows = query(select).fetch_all(self.readers()).await?;
        let waiting = |row: &Row| {
            let columns = Columns::new("jobs", row);
            Ok(Waiting {
                tenant: columns.parsed("tenant")?,
                size: match columns.get("size")? {
                    "short" => "short",
                    "medium" => "medium",
                    _ => "long",
                },
                jobs: columns.count("jobs")?,
                oldest_at: columns.get("oldest_at")?,
            })
        };
        rows.iter().map(waiting).collect()
    }

    /// Forgets worked time that no limit looks at any more.
    pub async fn forget_compute(&self) -> Result<()> {
        self.write(|mut tx| {
            Box::pin(async move {
                query("DELETE FROM compute WHERE day < ?1")
                    .bind(tx.now.div_euclid(DAY_MS) - COMPUTE_DAYS)
                    .execute(&mut tx.db)
                    .await?;
                Ok(())
            })
        })
        .await
    }
}

impl Transaction<'_> {
    /// The job that is next, and its turn: the first in the view `queue`. It is the first of its tenant,
    /// so that only those are compared.
    pub(in crate::jobs::store) async fn next_in_queue(&mut self) -> Result<Option<(JobId, i64)>> {
        let row = query(
            "SELECT first.id,
                 MAX(COALESCE((SELECT served_ms FROM turns WHERE turns.tenant = first.tenant), 0),
                     (SELECT turn FROM now_served)) AS turn
             FROM (SELECT DISTINCT tenant FROM waiting) AS tenants JOIN jobs AS first ON first.id =
                 (SELECT id FROM jobs INDEXED BY jobs_waiting
                  WHERE status = 'queued' AND tenant = tenants.tenant
                  ORDER BY priority DESC, created_at, id LIMIT 1)
             ORDER BY turn, created_at, first.id LIMIT 1",
        )
        .fetch_optional(&mut self.db)
        .await?;
        let Some(row) = row else {
            return Ok(None);
        };
        let columns = Columns::new("jobs", &row);
        Ok(Some((columns.parsed("id")?, columns.get("turn")?)))
    }

    /// Moves the service to the turn of a claimed job, and its tenant beyond it.
    pub(in crate::jobs::store) async fn take_turn(&mut self, id: &JobId, turn: i64) -> Result<()> {
        query("UPDATE now_served SET turn = ?1")
            .bind(turn)
            .execute(&mut self.db)
            .await?;
        query(
            "INSERT INTO turns (tenant, served_ms)
                 SELECT tenant, ?2 + cost_ms FROM jobs WHERE id = ?1
             ON CONFLICT (tenant) DO UPDATE SET served_ms = excluded.served_ms",
        )
        .bind(id.as_str())
        .bind(turn)
        .execute(&mut self.db)
        .await?;
        Ok(())
    }

    /// Gives a tenant its turn back: its job was interrupted through no fault of its own.
    pub(in crate::jobs::store) async fn give_turn_back(&mut self, id: &JobId) -> Result<()> {
        query(
            "UPDATE turns SET served_ms =
                 MAX(served_ms - (SELECT cost_ms FROM jobs WHERE id = ?1), 0)
             WHERE tenant = (SELECT tenant FROM jobs WHERE id = ?1)",
        )
        .bind(id.as_str())
        .execute(&mut self.db)
        .await?;
        Ok(())
    }

    /// Adds the time since it was last counted to what was worked for whom submitted a running job.
    pub(in crate::jobs::store) async fn count_work(&mut self, fence: Fence<'_>) -> Result<()> {
        query(
            "INSERT INTO compute (day, tenant, account, ms)
                 SELECT ?2, tenant, account, MIN(MAX(?3 - counted_at, 0), ?4) FROM jobs
                 WHERE id = ?1 AND attempt = ?5 AND counted_at IS NOT NULL
             ON CONFLICT (day, tenant, account) DO UPDATE SET ms = compute.ms + excluded.ms",
        )
        .bind(fence.id.as_str())
        .bind(self.now.div_euclid(DAY_MS))
        .bind(self.now)
        .bind(LONGEST_COUNT_MS)
        .bind(fence.attempt)
        .execute(&mut self.db)
        .await?;
        Ok(())
    }

    /// Adds what was worked for a job by another worker than the one that holds it.
    pub(in crate::jobs::store) async fn count_help(&mut self, id: &JobId, ms: u64) -> Result<()> {
        query(
            "INSERT INTO compute (day, tenant, account, ms)
                 SELECT ?2, tenant, account, ?3 FROM jobs WHERE id = ?1
             ON CONFLICT (day, tenant, account) DO UPDATE SET ms = compute.ms + excluded.ms",
        )
        .bind(id.as_str())
        .bind(self.now.div_euclid(DAY_MS))
        .bind(integer(ms))
        .execute(&mut self.db)
        .await?;
        Ok(())
    }
}

/// Estimated work that is left of the running jobs, in milliseconds.
async fn running_ms<'e>(db: impl Into<On<'e>>) -> Result<u64> {
    let row = query(
        "SELECT CAST(COALESCE(SUM(COALESCE(1000.0 * eta_seconds, cost_ms)), 0) AS DOUBLE PRECISION)
         FROM jobs
         WHERE status = 'running'",
    )
    .fetch_one(db)
    .await?;
    let left: f64 = row.at(0)?;
    Ok(left.max(0.0) as u64)
}

/// Estimated seconds as milliseconds, at least one: each job moves its tenant on.
pub(in crate::jobs::store) fn cost_ms(seconds: f64) -> i64 {
    integer((1_000.0 * seconds).clamp(1.0, 1e12) as u64)
}
