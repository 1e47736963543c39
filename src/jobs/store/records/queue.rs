//! Whose job is next, and how much was worked for whom.
//!
//! Tenants take turns, weighed by the estimated cost of their jobs; the view `queue` of the database
//! is the one definition of the order (migrations 0011, 0017 and 0018 have the rule). What is claimed moves its tenant
//! on by its cost. Within a tenant a higher priority goes first, then what was submitted first.

use std::collections::HashMap;

use super::outcome::Fence;
use super::row::{Columns, integer};
use crate::identity::Tenant;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Db, On, Row, query, scalar};
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
        let Some((position, upto_ms, cost_ms)) = place(&mut at_once.db(), id).await? else {
            return Ok(None);
        };
        let running_ms = running_ms(&mut at_once.db()).await?;
        Ok(Some(Place {
            position,
            before_ms: running_ms + upto_ms - cost_ms,
            cost_ms,
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

    /// Number of a waiting job in the queue, 1 for the next one.
    pub(in crate::jobs::store) async fn queue_position(
        &mut self,
        id: &JobId,
    ) -> Result<Option<u64>> {
        let place = place(&mut self.db, id).await?;
        Ok(place.map(|(position, ..)| position))
    }
}

/// Number of a waiting job in the queue, the estimated work up to its end, and its own.
///
/// A submit asks for this, so that it must not cost more the more jobs wait. What is before a job of
/// its own tenant are the sums without the jobs behind it, of which a new one has none; and the jobs
/// of others are looked at only where there are any.
async fn place(db: &mut Db<'_>, id: &JobId) -> Result<Option<(u64, u64, u64)>> {
    let own = query(
        "WITH own AS (SELECT * FROM jobs WHERE id = ?1 AND status = 'queued'),
             upto AS (SELECT CAST(SUM(waiting.jobs) AS BIGINT) AS jobs,
                             CAST(SUM(waiting.cost_ms) AS BIGINT) AS cost_ms
                      FROM own JOIN waiting
                          ON waiting.tenant = own.tenant AND waiting.priority >= own.priority),
             behind AS (SELECT COUNT(*) AS jobs,
                               CAST(COALESCE(SUM(later.cost_ms), 0) AS BIGINT) AS cost_ms
                        FROM own JOIN jobs AS later INDEXED BY jobs_waiting
                            ON later.status = 'queued' AND later.tenant = own.tenant
                               AND later.priority = own.priority
                               AND (later.created_at, later.id) > (own.created_at, own.id))
         SELECT own.tenant, own.created_at, own.cost_ms,
                upto.jobs - behind.jobs AS position, upto.cost_ms - behind.cost_ms AS upto_ms,
                MAX(COALESCE((SELECT served_ms FROM turns WHERE turns.tenant = own.tenant), 0),
                    (SELECT turn FROM now_served))
                + upto.cost_ms - behind.cost_ms - own.cost_ms AS turn,
                EXISTS (SELECT 1 FROM waiting WHERE waiting.tenant <> own.tenant) AS others
         FROM own, upto, behind",
    )
    .bind(id.as_str())
    .fetch_optional(&mut *db)
    .await?;
    let Some(own) = own else {
        return Ok(None);
    };
    let own = Columns::new("jobs", &own);
    let mut place = (
        own.count("position")?,
        own.count("upto_ms")?,
        own.count("cost_ms")?,
    );
    let tenant = own.get::<&str>("tenant")?;
    if own.get("others")? {
        let others = query(
            "SELECT COUNT(*) AS position, CAST(COALESCE(SUM(cost_ms), 0) AS BIGINT) AS upto_ms
             FROM queue
             WHERE tenant <> ?1 AND (turn, created_at, id) <= (?2, ?3, ?4)",
        )
        .bind(tenant)
        .bind(own.get::<i64>("turn")?)
        .bind(own.get::<i64>("created_at")?)
        .bind(id.as_str())
        .fetch_one(db)
        .await?;
        let others = Columns::new("jobs", &others);
        place.0 += others.count("position")?;
        place.1 += others.count("upto_ms")?;
    }
    Ok(Some(place))
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
