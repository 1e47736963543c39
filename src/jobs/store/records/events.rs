//! Events: what happened to each job, in order. Those that are read are on the disk of the server: a client
//! that has seen one does not see its number again.

use super::row::{Columns, to_json};
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Row, either, many, query, scalar};
use crate::jobs::store::{Records, Store};
use crate::jobs::{BatchId, Event, EventKind, Job, JobId, NewEvent, Result};

impl Records<'_> {
    /// Events of a job after the given id, oldest first.
    pub async fn events_after(self, id: &JobId, after: i64, limit: u32) -> Result<Vec<Event>> {
        let select = "SELECT * FROM events WHERE job_id = ?1 AND tenant = ?2 AND id > ?3
                      ORDER BY id LIMIT ?4";
        let rows = query(select)
            .bind(id.as_str())
            .bind(self.tenant.as_str())
            .bind(after)
            .bind(limit)
            .fetch_settled(self.readers())
            .await?;
        let events = events_of(&rows)?;
        // Ids have no gap: where the next one is not here, the job may be archived.
        if events.first().is_some_and(|event| event.id == after + 1) {
            return Ok(events);
        }
        let mut archived = self.archived_events(id, after).await?;
        archived.truncate(limit as usize);
        Ok(if archived.is_empty() {
            events
        } else {
            archived
        })
    }

    /// Events of all jobs of the tenant after the given place, oldest first.
    pub async fn all_events_after(self, seq: i64, limit: u32) -> Result<Vec<Event>> {
        let select = "SELECT * FROM events WHERE tenant = ?1 AND seq > ?2 ORDER BY seq LIMIT ?3";
        let rows = query(select)
            .bind(self.tenant.as_str())
            .bind(seq)
            .bind(limit)
            .fetch_settled(self.readers())
            .await?;
        let events = events_of(&rows)?;
        let histories = "SELECT * FROM histories
                         WHERE tenant = ?1 AND last_seq > ?2 AND ?3 = ''
                         ORDER BY first_seq LIMIT ?4";
        let archived = self.with_archived(events, (histories, ""), (seq, limit));
        archived.await
    }

    /// Events of all jobs of a batch after the given place, oldest first.
    pub async fn batch_events_after(
        self,
        id: &BatchId,
        seq: i64,
        limit: u32,
    ) -> Result<Vec<Event>> {
        // With an empty text behind it they are read in their order, not job by job and then sorted.
        let select = "SELECT * FROM events WHERE tenant = ?1 AND seq > ?2
                      AND job_id || '' IN (SELECT id FROM jobs WHERE batch_id = ?3)
                      ORDER BY seq LIMIT ?4";
        let rows = query(select)
            .bind(self.tenant.as_str())
            .bind(seq)
            .bind(id.as_str())
            .bind(limit)
            .fetch_settled(self.readers())
            .await?;
        let events = events_of(&rows)?;
        let histories = "SELECT histories.* FROM histories JOIN jobs ON jobs.id = job_id
                         WHERE histories.tenant = ?1 AND last_seq > ?2 AND batch_id = ?3
                         ORDER BY first_seq LIMIT ?4";
        let archived = self.with_archived(events, (histories, id.as_str()), (seq, limit));
        archived.await
    }

    /// Place of the tenant's newest event that is here; 0 when there is none.
    pub async fn last_seq(self) -> Result<i64> {
        // The larger of two maxima, of which one may be NULL.
        let select = "SELECT COALESCE(MAX(seq), 0) FROM (
                          SELECT MAX(seq) AS seq FROM events WHERE tenant = ?1
                          UNION ALL SELECT MAX(last_seq) FROM histories WHERE tenant = ?1) AS seqs";
        scalar(select)
            .bind(self.tenant.as_str())
            .fetch_one(self.readers())
            .await
    }
}

impl Store {
    /// Events of all jobs of all tenants after the given place, oldest first: for the one reader that
    /// hands them on to those whom they concern.
    pub async fn events_of_all(&self, seq: i64, limit: u32) -> Result<Vec<Event>> {
        let rows = query("SELECT * FROM events WHERE seq > ?1 ORDER BY seq LIMIT ?2")
            .bind(seq)
            .bind(limit)
            .fetch_settled(self.readers())
            .await?;
        events_of(&rows)
    }

    /// Place of the newest event of all; 0 when there is none.
    pub async fn last_seq_of_all(&self) -> Result<i64> {
        let select = "SELECT COALESCE(MAX(seq), 0) FROM (
                          SELECT MAX(seq) AS seq FROM events
                          UNION ALL SELECT MAX(last_seq) FROM histories) AS seqs";
        scalar(select).fetch_one(self.readers()).await
    }
}

impl Transaction<'_> {
    /// Writes the next event of a job that is known to be here.
    pub(in crate::jobs::store) async fn append_event(
        &mut self,
        id: &JobId,
        event: &NewEvent,
    ) -> Result<()> {
        let row = query(
            "UPDATE jobs SET events = events + 1 WHERE id = ?1 RETURNING events, attempt, tenant",
        )
        .bind(id.as_str())
        .fetch_one(&mut self.db)
        .await?;
        let (number, attempt) = (row.at(0)?, row.at(1)?);
        self.insert_event((id, row.at(2)?), (number, attempt), event)
            .await
    }

    /// Writes the first event of each of these jobs, which nobody but their readers is told of.
    pub(in crate::jobs::store) async fn insert_first_events(
        &mut self,
        events: &[(&Job, NewEvent)],
    ) -> Result<()> {
        let insert = either(
            "INSERT INTO events (id, job_id, event, time, attempt, data, tenant)
             VALUES (1, ?1, ?2, ?3, ?4, ?5, ?6)",
            "INSERT INTO events (id, job_id, event, time, attempt, data, tenant)
             SELECT 1, * FROM unnest(CAST(?1 AS TEXT[]), CAST(?2 AS TEXT[]), CAST(?3 AS BIGINT[]),
                 CAST(?4 AS BIGINT[]), CAST(?5 AS TEXT[]), CAST(?6 AS TEXT[]))",
        );
        let mut inserted = many(insert);
        for (job, event) in events {
            inserted.row([
                job.id.as_str().into(),
                event.kind().name().into(),
                self.now.into(),
                job.attempt.into(),
                to_json(event).into(),
                job.tenant.as_str().into(),
            ]);
        }
        inserted.fetch_all(&mut self.db).await?;
        Ok(())
    }

    /// Writes an event whose number is counted already, of a job of this tenant in this attempt.
    pub(in crate::jobs::store) async fn insert_event(
        &mut self,
        (id, tenant): (&JobId, &str),
        (number, attempt): (i64, i64),
        event: &NewEvent,
    ) -> Result<()> {
        query(
            "INSERT INTO events (job_id, id, event, time, attempt, data, tenant)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7)",
        )
        .bind(id.as_str())
        .bind(number)
        .bind(event.kind().name())
        .bind(self.now)
        .bind(attempt)
        .bind(to_json(event))
        .bind(tenant)
        .execute(&mut self.db)
        .await?;
        self.tell_webhooks(tenant, id, event).await
    }
}

fn events_of(rows: &[Row]) -> Result<Vec<Event>> {
    rows.iter().map(event_of).collect()
}

pub(super) fn event_of(row: &Row) -> Result<Event> {
    let columns = Columns::new("events", row);
    Ok(Event {
        seq: columns.get("seq")?,
        tenant: columns.parsed("tenant")?,
        job_id: columns.parsed("job_id")?,
        id: columns.get("id")?,
        kind: columns.required(EventKind::from_name(columns.get("event")?), "event")?,
        time: columns.get("time")?,
        attempt: columns.get("attempt")?,
        data: columns.json("data")?,
    })
}
