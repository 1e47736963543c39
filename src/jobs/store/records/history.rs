//! What jobs told that ended some time ago: events, series and histograms as one object each. Rows of a
//! job are a hundred times what is kept of it else; the object is a tenth of them, and reading it is the
//! same to whoever asks.
//!
//! A job is archived as a whole, in one transaction that names the object and removes the rows: a reader
//! finds either.

use std::io::{BufReader, Read};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::events::event_of;
use super::metrics::{histogram_of, metrics_of};
use super::row::Columns;
use crate::identity::Tenant;
use crate::jobs::store::content::objects::Kept;
use crate::jobs::store::sql::{Row, query, scalar};
use crate::jobs::store::{Records, Store};
use crate::jobs::{Error, Event, EventKind, JobId, Result};
use crate::reconstruction::training::{GradientHistogram, Metrics};

/// Level of zstd: the series are numbers, of which a higher one makes little more.
const LEVEL: i32 = 3;

/// Most bytes of a history, so that a damaged one takes no more memory.
const MOST_BYTES: u64 = 1 << 30;

/// Histories that are looked at together.
const AT_ONCE: i64 = 32;

/// The form of a history; others are refused.
const FORM: u32 = 1;

/// All that a job told.
#[derive(Debug, Serialize, Deserialize)]
pub(in crate::jobs::store) struct History {
    form: u32,
    events: Vec<Told>,
    pub(super) metrics: Vec<Metrics>,
    pub(super) gradients: Vec<GradientHistogram>,
}

/// An event of a job that is known.
#[derive(Debug, Serialize, Deserialize)]
struct Told {
    seq: i64,
    id: i64,
    kind: String,
    time: i64,
    attempt: i64,
    data: Value,
}

impl History {
    fn encoded(&self) -> Result<Vec<u8>> {
        let mut plain = Vec::new();
        ciborium::into_writer(self, &mut plain).map_err(wrong)?;
        zstd::bulk::compress(&plain, LEVEL).map_err(wrong)
    }

    fn decoded(data: &[u8]) -> Result<Self> {
        let plain = zstd::stream::read::Decoder::new(data).map_err(wrong)?;
        let plain = BufReader::new(plain.take(MOST_BYTES));
        let history: Self = ciborium::from_reader(plain).map_err(wrong)?;
        if history.form == FORM {
            Ok(history)
        } else {
            Err(wrong(format!("it has form {}", history.form)))
        }
    }

    /// Its events.
    fn events(self, tenant: &Tenant, job: &JobId) -> Result<Vec<Event>> {
        let event = |told: Told| {
            let kind = EventKind::from_name(&told.kind);
            Ok(Event {
                seq: told.seq,
                tenant: tenant.clone(),
                job_id: job.clone(),
                id: told.id,
                kind: kind.ok_or_else(|| wrong(format!("there is no {}", told.kind)))?,
                time: told.time,
                attempt: told.attempt,
                data: told.data,
            })
        };
        self.events.into_iter().map(event).collect()
    }
}

#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn wrong(error: impl ToString) -> Error {
    Error::Inconsistent {
        table: "histories",
        column: "object",
        detail: error.to_string(),
    }
}

impl Records<'_> {
    /// What a job told, if that is an object.
    pub(super) async fn history(self, id: &JobId) -> Result<Option<History>> {
        let select = "SELECT object, bytes FROM histories WHERE job_id = ?1 AND tenant = ?2";
        let row = query(select)
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .fetch_optional(self.readers())
            .await?;
        match row {
            Some(row) => self.read(&row).await,
            None => Ok(None),
        }
    }

    /// The history of a row; none if it was erased meanwhile.
    async fn read(self, row: &Row) -> Result<Option<History>> {
        let object = Columns::new("histories", row).object()?;
        let data = self.objects().whole(&object).await?;
        data.map(|data| History::decoded(&data)).transpose()
    }

    /// Events of a job after the given id, from its history; none if it has none.
    pub(super) async fn archived_events(self, id: &JobId, after: i64) -> Result<Vec<Event>> {
        let Some(history) = self.history(id).await? else {
            return Ok(Vec::new());
        };
        let mut events = history.events(self.tenant, id)?;
        events.retain(|event| event.id > after);
        Ok(events)
    }

    /// Adds to a page of events after the given place those that are in histories, in their order. `select`
    /// finds histories of whoever is asked for, `?1` the tenant, `?2` the place, `?3` perhaps a name, by
    /// their first place, at most `?4`.
    pub(super) async fn with_archived(
        self,
        mut events: Vec<Event>,
        (select, name): (&'static str, &str),
        (seq, limit): (i64, u32),
    ) -> Result<Vec<Event>> {
        let mut at_once = AT_ONCE;
        loop {
            let rows = query(select)
                .bind(self.tenant.as_str())
                .bind(seq)
                .bind(name)
                .bind(at_once + 1)
                .fetch_all(self.readers())
                .await?;
            // Where the page ends, and where the first history begins that is not looked at.
            let full = events.len() >= limit as usize;
            let page_end = events
                .last()
                .filter(|_| full)
                .map_or(i64::MAX, |last| last.seq);
            let is_all = rows.len() as i64 <= at_once;
            let unseen = match rows.last().filter(|_| !is_all) {
                Some(row) => Columns::new("histories", row).get("first_seq")?,
                None => i64::MAX,
            };
            let mut found = Vec::new();
            for row in rows.iter().take(at_once as usize) {
                let columns = Columns::new("histories", row);
                if columns.get::<i64>("first_seq")? > page_end {
                    break;
                }
                let job: JobId = columns.parsed("job_id")?;
                if let Some(history) = self.read(row).await? {
                    found.extend(history.events(self.tenant, &job)?);
                }
            }
            found.retain(|event| event.seq > seq);
            if is_all && found.is_empty() {
                return Ok(events);
            }
            found.append(&mut events);
            found.sort_by_key(|event| event.seq);
            found.dedup_by_key(|event| event.seq);
            events = found;
            let known = events.iter().take_while(|event| event.seq < unseen).count();
            if known > 0 || is_all {
                events.truncate(known.min(limit as usize));
                return Ok(events);
            }
            // More jobs ran at the same time than were looked at.
            at_once *= 2;
        }
    }
}

impl Store {
    /// Jobs of all tenants that ended before the given time and whose events are rows yet, at most so many.
    pub async fn jobs_to_archive(&self, before: i64, limit: u32) -> Result<Vec<(JobId, Tenant)>> {
        let select = "SELECT id, tenant FROM jobs
                      WHERE archived = 0 AND finished_at IS NOT NULL AND finished_at < ?1
                      ORDER BY finished_at LIMIT ?2";
        let rows = query(select)
            .bind(before)
            .bind(limit)
            .fetch_all(self.readers())
            .await?;
        let named = |row: &Row| {
            let columns = Columns::new("jobs", row);
            Ok((columns.parsed("id")?, columns.parsed("tenant")?))
        };
        rows.iter().map(named).collect()
    }

    /// Makes an object of what a job told that has ended, and removes the rows. Does nothing if it was erased
    /// or archived meanwhile.
    ///
    /// # Errors
    /// `ContentUnavailable` without the object store.
    pub async fn archive(&self, id: &JobId, tenant: &Tenant) -> Result<()> {
        let mut at_once = self.readers().begin().await?;
        let mut all = async |select| {
            let rows = query(select).bind(id.as_str());
            rows.fetch_all(&mut at_once.db()).await
        };
        let events = all("SELECT * FROM events WHERE job_id = ?1 ORDER BY id").await?;
        let metrics = all("SELECT * FROM metrics WHERE job_id = ?1 ORDER BY evaluation").await?;
        let gradients =
            all("SELECT * FROM gradients WHERE job_id = ?1 ORDER BY evaluation").await?;
        let told = |row: &Row| {
            let event = event_of(row)?;
            Ok(Told {
                seq: event.seq,
                id: event.id,
                kind: event.kind.name().to_owned(),
                time: event.time,
                attempt: event.attempt,
                data: event.data,
            })
        };
        let history = History {
            form: FORM,
            events: events.iter().map(told).collect::<Result<_>>()?,
            metrics: metrics.iter().map(metrics_of).collect::<Result<_>>()?,
            gradients: gradients.iter().map(histogram_of).collect::<Result<_>>()?,
        };
        let seqs = || history.events.iter().map(|event| event.seq);
        let (Some(first), Some(last)) = (seqs().min(), seqs().max()) else {
            return Ok(());
        };
        let count = history.events.len() as i64;
        let kept = self.put_object(history.encoded()?.into()).await?;
        self.take_over(id, tenant, kept, (count, first, last)).await
    }

    async fn take_over(
        &self,
        id: &JobId,
        tenant: &Tenant,
        kept: Kept,
        (count, first, last): (i64, i64, i64),
    ) -> Result<()> {
        let (id, tenant, named) = (id.clone(), tenant.clone(), kept.clone());
        let objects = [&kept];
        let taken = self.name(&objects, move |mut tx| {
            Box::pin(async move {
                tx.may_name(&named).await?;
                // An event that came meanwhile is not in the object.
                let fits: bool = scalar(
                    "SELECT EXISTS (SELECT 1 FROM jobs WHERE id = ?1 AND archived = 0 AND events = ?2
                                      AND finished_at IS NOT NULL)",
                )
                .bind(id.as_str())
                .bind(count)
                .fetch_one(&mut tx.db)
                .await?;
                if !fits {
                    return Err(Error::Stale);
                }
                query(
                    "INSERT INTO histories (job_id, tenant, object, bytes, first_seq, last_seq)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
                )
                .bind(id.as_str())
                .bind(tenant.as_str())
                .bind(named.key)
                .bind(named.bytes as i64)
                .bind(first)
                .bind(last)
                .execute(&mut tx.db)
                .await?;
                let statements = [
                    "DELETE FROM events WHERE job_id = ?1",
                    "DELETE FROM metrics WHERE job_id = ?1",
                    "DELETE FROM gradients WHERE job_id = ?1",
                    "UPDATE jobs SET archived = 1 WHERE id = ?1",
                ];
                tx.run_each(&statements, id.as_str()).await
            })
        });
        match taken.await {
            Ok(()) | Err(Error::Stale) => Ok(()),
            Err(error) => Err(error),
        }
    }
}
