//! What a tenant and a key have taken of what they may, counted from the rows at the moment that it
//! is asked: so it holds over restarts, and two requests at once cannot both take the last of it.

use std::borrow::Cow;

use super::queue::DAY_MS;
use crate::identity::{Caller, Holder, Measure, Policy};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::scalar;
use crate::jobs::{Error, Result};

/// Seconds after which it is worth to try again where nothing tells when there will be room.
const WHEN_JOBS_END: u32 = 10;
const WHEN_SPACE_IS_MADE: u32 = 60;

/// What is counted before a job is taken.
const OF_A_JOB: [Measure; 3] = [Measure::Queued, Measure::Compute, Measure::Stored];

/// Whether any quota tells how many jobs the caller may submit.
pub(in crate::jobs::store) fn limits_jobs(caller: &Caller) -> bool {
    let mut policies = OF_A_JOB
        .into_iter()
        .flat_map(|measure| caller.allowance.policies(measure));
    policies.next().is_some()
}

impl Transaction<'_> {
    /// Whether the caller may put another job into the queue.
    ///
    /// # Errors
    /// `Quota`.
    pub(in crate::jobs::store) async fn check_job(&mut self, caller: &Caller) -> Result<()> {
        for measure in OF_A_JOB {
            self.check_quota(caller, measure, 1).await?;
        }
        Ok(())
    }

    /// Whether the caller may store so many bytes more.
    ///
    /// # Errors
    /// `Quota`.
    pub(in crate::jobs::store) async fn check_bytes(
        &mut self,
        caller: &Caller,
        bytes: u64,
    ) -> Result<()> {
        self.check_quota(caller, Measure::Stored, bytes).await
    }

    async fn check_quota(&mut self, caller: &Caller, measure: Measure, more: u64) -> Result<()> {
        for policy in caller.allowance.policies(measure) {
            if self.taken(caller, policy).await?.saturating_add(more) > policy.quota {
                let day_left = DAY_MS - self.now.rem_euclid(DAY_MS);
                let retry_seconds = match measure {
                    Measure::Compute => (day_left / 1_000 + 1) as u32,
                    Measure::Stored => WHEN_SPACE_IS_MADE,
                    Measure::Queued | Measure::Requests => WHEN_JOBS_END,
                };
                return Err(Error::Quota {
                    policy,
                    retry_seconds,
                });
            }
        }
        Ok(())
    }

    async fn taken(&mut self, caller: &Caller, policy: Policy) -> Result<u64> {
        let statement = match policy.measure {
            Measure::Requests => return Ok(0),
            Measure::Queued => {
                "SELECT COUNT(*) FROM jobs
                 WHERE status = 'queued' AND tenant = ?1 AND (?2 = '' OR account = ?2)"
            }
            Measure::Compute => {
                "SELECT CAST(COALESCE(SUM(ms), 0) AS BIGINT) / 1000 FROM compute
                 WHERE day = ?3 AND tenant = ?1 AND (?2 = '' OR account = ?2)"
            }
            // Clouds of all keys of the tenant are shared, so they are the tenant's alone.
            Measure::Stored => {
                "SELECT CAST((SELECT COALESCE(SUM(bytes), 0) FROM clouds WHERE tenant = ?1)
                      + (SELECT COALESCE(SUM(meshes.bytes), 0) FROM jobs
                         JOIN meshes ON meshes.job_id = jobs.id WHERE jobs.tenant = ?1)
                      + (SELECT COALESCE(SUM(models.bytes), 0) FROM jobs
                         JOIN models ON models.job_id = jobs.id WHERE jobs.tenant = ?1)
                      AS BIGINT)"
            }
        };
        let account = match policy.holder {
            Holder::Tenant => Cow::Borrowed(""),
            Holder::Account => caller.account(),
        };
        let taken: i64 = scalar(statement)
            .bind(caller.tenant.as_str())
            .bind(account)
            .bind(self.now.div_euclid(DAY_MS))
            .fetch_one(&mut self.db)
            .await?;
        Ok(taken.max(0) as u64)
    }
}
