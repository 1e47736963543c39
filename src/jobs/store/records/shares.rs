//! Shares: runs of blocks of a running job, which its worker offers to idle ones.
//!
//! A share needs no lease. Its networks are the same whoever fits them, and the worker of the job fits itself what
//! does not come back in time; so one that is begun by two, or by somebody who dies, costs time and nothing else.
//! Shares end with the attempt that offered them.

use bytes::Bytes;

use super::row::{Columns, integer};
use crate::jobs::store::content::objects::Kept;
use crate::jobs::store::sql::{Row, query, scalar};
use crate::jobs::store::{Store, Transaction};
use crate::jobs::{Claim, Error, JobId, Result};

/// A share that a worker has begun with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Share {
    /// The job.
    pub job: JobId,
    /// Its number in the attempt.
    pub number: usize,
    attempt: i64,
    input: Kept,
}

/// What became of a share that was offered.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Offered {
    /// Its number.
    pub number: usize,
    /// Whether somebody has begun with it.
    pub is_begun: bool,
    /// Its networks, once they are there.
    networks: Option<Kept>,
}

impl Offered {
    /// Whether its networks are there.
    pub fn is_fitted(&self) -> bool {
        self.networks.is_some()
    }
}

impl Store {
    /// Offers a share of the job to workers on such a processor.
    ///
    /// # Errors
    /// `Stale` if the claim is over.
    pub async fn offer_share(
        &self,
        claim: &Claim,
        number: usize,
        (processor, input): (String, Bytes),
    ) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.put_for(claim, input, move |mut tx, named| {
            Box::pin(async move {
                query(
                    "INSERT INTO shares (job_id, share, attempt, processor, object, bytes, created_at)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
                )
                .bind(id.as_str())
                .bind(integer(number as u64))
                .bind(attempt)
                .bind(&processor)
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

    /// The shares of the attempt that are offered.
    pub async fn offered_shares(&self, claim: &Claim) -> Result<Vec<Offered>> {
        let rows = query("SELECT * FROM shares WHERE job_id = ?1 AND attempt = ?2 ORDER BY share")
            .bind(claim.job.id.as_str())
            .bind(claim.attempt)
            .fetch_all(self.readers())
            .await?;
        let offered = |row: &Row| {
            let columns = Columns::new("shares", row);
            let is_fitted = columns.get::<i64>("fitted")? != 0;
            Ok(Offered {
                number: columns.count("share")? as usize,
                is_begun: columns.get::<Option<&str>>("helper")?.is_some(),
                networks: is_fitted.then(|| columns.object()).transpose()?,
            })
        };
        rows.iter().map(offered).collect()
    }

    /// The networks of a share; none if they are not there.
    pub async fn networks(&self, offered: &Offered) -> Result<Option<Vec<u8>>> {
        match &offered.networks {
            Some(networks) => self.inner.objects.whole(networks).await,
            None => Ok(None),
        }
    }

    /// Ends a share whose networks were read, or with which nobody shall begin any more: who has begun may go on.
    pub async fn close_share(&self, claim: &Claim, number: usize) -> Result<()> {
        let (id, attempt) = (claim.job.id.clone(), claim.attempt);
        self.write(move |mut tx| {
            Box::pin(async move {
                let closed: Option<String> = scalar(
                    "DELETE FROM shares WHERE job_id = ?1 AND share = ?2 AND attempt = ?3
                         AND (fitted = 1 OR helper IS NULL) RETURNING object",
                )
                .bind(id.as_str())
                .bind(integer(number as u64))
                .bind(attempt)
                .fetch_optional(&mut tx.db)
                .await?;
                match closed {
                    Some(object) => tx.bury_object(&object).await,
                    None => Ok(()),
                }
            })
        })
        .await
    }

    /// Takes the share that waits longest for a worker on such a processor.
    pub async fn take_share(&self, worker: &str, processor: &str) -> Result<Option<Share>> {
        // As for jobs: the usual case takes no lock.
        let waits: bool =
            scalar("SELECT EXISTS (SELECT 1 FROM shares WHERE helper IS NULL AND processor = ?1)")
                .bind(processor)
                .fetch_one(self.readers())
                .await?;
        if !waits {
            return Ok(None);
        }
        let (worker, processor) = (worker.to_owned(), processor.to_owned());
        self.write(move |mut tx| {
            Box::pin(async move {
                let row = query(
                    "UPDATE shares SET helper = ?1 WHERE (job_id, share) IN
                         (SELECT job_id, share FROM shares WHERE helper IS NULL AND processor = ?2
                          ORDER BY created_at, job_id, share LIMIT 1)
                     RETURNING *",
                )
                .bind(&worker)
                .bind(&processor)
                .fetch_optional(&mut tx.db)
                .await?;
                let share = |row: &Row| {
                    let columns = Columns::new("shares", row);
                    Ok(Share {
                        job: columns.parsed("job_id")?,
                        number: columns.count("share")? as usize,
                        attempt: columns.get("attempt")?,
                        input: columns.object()?,
                    })
                };
                row.as_ref().map(share).transpose()
            })
        })
        .await
    }

    /// The input of a share; none if nobody wants it any more.
    pub async fn share_input(&self, share: &Share) -> Result<Option<Vec<u8>>> {
        self.inner.objects.whole(&share.input).await
    }

    /// Whether the worker shall go on with a share: the job still wants it, and no job waits for a worker.
    pub async fn wants_share(&self, share: &Share, worker: &str) -> Result<bool> {
        scalar(
            "SELECT EXISTS (SELECT 1 FROM shares WHERE job_id = ?1 AND share = ?2 AND attempt = ?3
                                AND helper = ?4)
                AND NOT EXISTS (SELECT 1 FROM jobs WHERE status = 'queued')",
        )
        .bind(share.job.as_str())
        .bind(integer(share.number as u64))
        .bind(share.attempt)
        .bind(worker)
        .fetch_one(self.readers())
        .await
    }

    /// Writes the networks of a share in the place of its input, and counts how long its worker worked for the
    /// tenant of the job.
    ///
    /// # Errors
    /// `Stale` if nobody wants it any more.
    pub async fn finish_share(
        &self,
        (share, worker): (&Share, &str),
        networks: Bytes,
        worked_ms: u64,
    ) -> Result<()> {
        let (share, worker) = (share.clone(), worker.to_owned());
        let object = self.put_object(networks).await?;
        let named = object.clone();
        self.name(&[&object], move |mut tx| {
            Box::pin(async move {
                tx.may_name(&named).await?;
                let fitted = query(
                    "UPDATE shares SET object = ?5, bytes = ?6, fitted = 1
                     WHERE job_id = ?1 AND share = ?2 AND attempt = ?3 AND helper = ?4",
                )
                .bind(share.job.as_str())
                .bind(integer(share.number as u64))
                .bind(share.attempt)
                .bind(&worker)
                .bind(&named.key)
                .bind(integer(named.bytes))
                .execute(&mut tx.db)
                .await?;
                if fitted.rows_affected() != 1 {
                    return Err(Error::Stale);
                }
                tx.bury_object(&share.input.key).await?;
                tx.count_help(&share.job, worked_ms).await
            })
        })
        .await
    }

    /// Gives back the shares that a worker has begun with.
    pub async fn leave_shares(&self, worker: &str) -> Result<()> {
        let begun = "SELECT EXISTS (SELECT 1 FROM shares WHERE helper = ?1 AND fitted = 0)";
        if !scalar(begun).bind(worker).fetch_one(self.readers()).await? {
            return Ok(());
        }
        let worker = worker.to_owned();
        self.write(move |mut tx| {
            Box::pin(async move {
                let statement = "UPDATE shares SET helper = NULL WHERE helper = ?1 AND fitted = 0";
                tx.run_each(&[statement], &worker).await
            })
        })
        .await
    }

    /// The workers that fit a share.
    pub async fn helpers(&self) -> Result<Vec<String>> {
        let select = "SELECT DISTINCT helper FROM shares WHERE helper IS NOT NULL AND fitted = 0";
        scalar(select).fetch_all(self.readers()).await
    }

    /// How many workers hold no job, of so many where no other process has any: those that may fit shares. None
    /// while a job waits.
    pub async fn spare_workers(&self, own: u16) -> Result<u64> {
        let slots = if self.is_shared() {
            let (_, slots) = self.nodes().await?;
            integer(slots)
        } else {
            own.into()
        };
        let select = "SELECT CAST(COALESCE(SUM(CASE status WHEN 'queued' THEN ?1 ELSE jobs END), 0) AS BIGINT)
                      FROM totals WHERE status IN ('queued', 'running')";
        let taken: i64 = scalar(select).bind(slots).fetch_one(self.readers()).await?;
        Ok((slots - taken).max(0).unsigned_abs())
    }
}

impl Transaction<'_> {
    /// Ends the shares of a job.
    pub(in crate::jobs::store) async fn bury_shares(&mut self, id: &JobId) -> Result<()> {
        let any: bool = scalar("SELECT EXISTS (SELECT 1 FROM shares WHERE job_id = ?1)")
            .bind(id.as_str())
            .fetch_one(&mut self.db)
            .await?;
        if !any {
            return Ok(());
        }
        let statements = [
            "INSERT INTO graves (key) SELECT object FROM shares WHERE job_id = ?1",
            "DELETE FROM shares WHERE job_id = ?1",
        ];
        self.run_each(&statements, id.as_str()).await
    }

    async fn bury_object(&mut self, key: &str) -> Result<()> {
        self.run_each(&["INSERT INTO graves (key) VALUES (?1)"], key)
            .await
    }
}
