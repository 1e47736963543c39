//! Answers that are given again when a request is repeated with the same key.
//!
//! A request first begins its key; the row without an answer keeps a second one off. The answer to
//! a submitted job is written in the job's own transaction: were it a later one, a crash in between
//! would make the repeated request submit a second job.

use super::row::{Columns, to_json};
use super::tombstones;
use crate::identity::Tenant;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{query, scalar};
use crate::jobs::store::{Acts, Store};
use crate::jobs::{BatchId, CloudId, Error, Job, JobId, Result, Tombstone};

/// Makes [`Acts::submit`] and [`Acts::submit_batch`] keep their answer under a key that was begun.
pub struct Idempotency<T = Job> {
    /// The client's key.
    pub key: String,
    /// Method and route.
    pub scope: String,
    /// Writes the answer; called in the transaction of what is made, and again if that is done again.
    pub respond: Box<dyn Fn(&T) -> StoredResponse + Send + Sync>,
}

/// An answer as it is given again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredResponse {
    /// HTTP status.
    pub status: u16,
    /// Names and values of the headers that belong to the answer.
    pub headers: Vec<(String, String)>,
    /// Body.
    pub body: Vec<u8>,
}

/// What is known about a key.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum IdempotencyState {
    /// Nothing: it is begun now, and must be completed or abandoned.
    New,
    /// The same request was answered so.
    Replay(StoredResponse),
    /// The same request is being worked on.
    InFlight,
    /// Another request has used the key.
    Mismatch,
    /// The same request was answered with a job that was erased since.
    Gone(Tombstone),
    /// The same request was answered with a cloud that was erased since.
    CloudGone(Tombstone),
    /// The same request was answered with a batch that was erased since.
    BatchGone(Tombstone),
}

/// What is known of a key whose answer told of something that was erased.
type Gone = fn(Tombstone) -> IdempotencyState;

/// What an answer tells of: it is emptied when that is erased.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Subject {
    /// A job.
    Job(JobId),
    /// A cloud.
    Cloud(CloudId),
    /// A batch.
    Batch(BatchId),
}

impl Subject {
    fn id(&self) -> &str {
        match self {
            Self::Job(id) => id.as_str(),
            Self::Cloud(id) => id.as_str(),
            Self::Batch(id) => id.as_str(),
        }
    }
}

impl Acts<'_> {
    /// Begins a key for a request with the given hash, or tells what is known about it.
    pub async fn idempotency_begin(
        self,
        key: &str,
        scope: &str,
        request_sha256: &str,
    ) -> Result<IdempotencyState> {
        let (key, scope) = (key.to_owned(), scope.to_owned());
        let (request_sha256, tenant) = (request_sha256.to_owned(), self.caller.tenant.clone());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let begun = query(
                        "INSERT INTO idempotency (key, scope, tenant, request_sha256, created_at,
                         node)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6) ON CONFLICT (tenant, key, scope) DO NOTHING",
                    )
                    .bind(&key)
                    .bind(&scope)
                    .bind(tenant.as_str())
                    .bind(&request_sha256)
                    .bind(tx.now)
                    .bind(&tx.options.node)
                    .execute(&mut tx.db)
                    .await?;
                    if begun.rows_affected() == 1 {
                        return Ok(IdempotencyState::New);
                    }
                    let select = "SELECT * FROM idempotency
                              WHERE key = ?1 AND scope = ?2 AND tenant = ?3";
                    let row = query(select)
                        .bind(&key)
                        .bind(&scope)
                        .bind(tenant.as_str())
                        .fetch_one(&mut tx.db)
                        .await?;
                    let columns = Columns::new("idempotency", &row);
                    if columns.get::<String>("request_sha256")? != request_sha256 {
                        return Ok(IdempotencyState::Mismatch);
                    }
                    let gone: [(_, Gone); 3] = [
                        ("job_id", IdempotencyState::Gone),
                        ("cloud_id", IdempotencyState::CloudGone),
                        ("batch_id", IdempotencyState::BatchGone),
                    ];
                    for (column, state) in gone {
                        if let Some(id) = columns.get::<Option<String>>(column)?
                            && let Some(tombstone) =
                                tombstones::find(&mut tx.db, &tenant, &id).await?
                        {
                            return Ok(state(tombstone));
                        }
                    }
                    let Some(status) = columns.get::<Option<i64>>("status")? else {
                        return Ok(IdempotencyState::InFlight);
                    };
                    Ok(IdempotencyState::Replay(StoredResponse {
                        status: u16::try_from(status)
                            .map_err(Error::inconsistent("idempotency", "status"))?,
                        headers: columns.json("headers")?,
                        body: columns.get("body")?,
                    }))
                })
            })
            .await
    }

    /// Whether a request with this key was answered; takes no lock and writes nothing.
    pub async fn idempotency_answered(self, key: &str, scope: &str) -> Result<bool> {
        scalar(
            "SELECT EXISTS (SELECT 1 FROM idempotency
                            WHERE key = ?1 AND scope = ?2 AND tenant = ?3
                              AND status IS NOT NULL)",
        )
        .bind(key)
        .bind(scope)
        .bind(self.caller.tenant.as_str())
        .fetch_one(self.store.readers())
        .await
    }

    /// Keeps the answer to a request that was begun and submitted no job. One that tells of a job or
    /// a cloud is emptied with it, at once where that was erased meanwhile.
    ///
    /// # Errors
    /// `Stale` if the key is not in flight.
    pub async fn idempotency_complete(
        self,
        key: &str,
        scope: &str,
        subject: Option<Subject>,
        response: StoredResponse,
    ) -> Result<()> {
        let begun = (self.caller.tenant.clone(), key.to_owned(), scope.to_owned());
        self.store
            .write(move |mut tx| {
                Box::pin(async move { tx.complete(&begun, subject, response).await })
            })
            .await
    }

    /// Forgets a request that was begun and came to nothing, so that it can be tried again.
    pub async fn idempotency_abandon(self, key: &str, scope: &str) -> Result<()> {
        let (tenant, key, scope) = (self.caller.tenant.clone(), key.to_owned(), scope.to_owned());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    query(
                        "DELETE FROM idempotency
                     WHERE key = ?1 AND scope = ?2 AND tenant = ?3 AND status IS NULL AND node = ?4",
                    )
                    .bind(key)
                    .bind(scope)
                    .bind(tenant.as_str())
                    .bind(&tx.options.node)
                    .execute(&mut tx.db)
                    .await?;
                    Ok(())
                })
            })
            .await
    }
}

impl Store {
    /// Forgets all requests in flight, and tells how many: at a server's start they are those that
    /// died with the last one.
    pub async fn idempotency_abandon_all(&self) -> Result<u64> {
        self.write(|mut tx| {
            Box::pin(async move {
                let deleted = query("DELETE FROM idempotency WHERE status IS NULL")
                    .execute(&mut tx.db)
                    .await?;
                Ok(deleted.rows_affected())
            })
        })
        .await
    }

    /// Forgets all keys begun before the given time (milliseconds since the epoch), and tells how
    /// many.
    pub async fn idempotency_prune(&self, before: i64) -> Result<u64> {
        self.write(move |mut tx| {
            Box::pin(async move {
                let deleted = query("DELETE FROM idempotency WHERE created_at < ?1")
                    .bind(before)
                    .execute(&mut tx.db)
                    .await?;
                Ok(deleted.rows_affected())
            })
        })
        .await
    }
}

impl Transaction<'_> {
    /// Keeps the answer to the submission of what was made for the tenant.
    pub(in crate::jobs::store) async fn keep_answer<T>(
        &mut self,
        asked: &Idempotency<T>,
        (made, subject): (&T, Subject),
        tenant: &Tenant,
    ) -> Result<()> {
        let response = (asked.respond)(made);
        let begun = (tenant.clone(), asked.key.clone(), asked.scope.clone());
        self.complete(&begun, Some(subject), response).await
    }

    /// Empties the answers that tell of what is erased. Their keys stay: a request that comes again
    /// must not be done again.
    pub(in crate::jobs::store) async fn empty_answers(&mut self, erased: &Subject) -> Result<()> {
        let statement = match erased {
            Subject::Job(_) => "UPDATE idempotency SET headers = '[]', body = ?2 WHERE job_id = ?1",
            Subject::Cloud(_) => {
                "UPDATE idempotency SET headers = '[]', body = ?2 WHERE cloud_id = ?1"
            }
            Subject::Batch(_) => {
                "UPDATE idempotency SET headers = '[]', body = ?2 WHERE batch_id = ?1"
            }
        };
        query(statement)
            .bind(erased.id())
            .bind(&[][..])
            .execute(&mut self.db)
            .await?;
        Ok(())
    }

    async fn complete(
        &mut self,
        (tenant, key, scope): &(Tenant, String, String),
        subject: Option<Subject>,
        mut response: StoredResponse,
    ) -> Result<()> {
        if let Some(subject) = &subject
            && tombstones::find(&mut self.db, tenant, subject.id())
                .await?
                .is_some()
        {
            response.headers.clear();
            response.body.clear();
        }
        let [mut job, mut cloud, mut batch] = [None; 3];
        match &subject {
            Some(Subject::Job(id)) => job = Some(id.as_str()),
            Some(Subject::Cloud(id)) => cloud = Some(id.as_str()),
            Some(Subject::Batch(id)) => batch = Some(id.as_str()),
            None => {}
        }
        let completed = query(
            "UPDATE idempotency SET status = ?3, headers = ?4, body = ?5, job_id = ?6,
                 cloud_id = ?7, batch_id = ?9
             WHERE key = ?1 AND scope = ?2 AND tenant = ?8 AND status IS NULL AND node = ?10",
        )
        .bind(key)
        .bind(scope)
        .bind(i64::from(response.status))
        .bind(to_json(&response.headers))
        .bind(response.body.as_slice())
        .bind(job)
        .bind(cloud)
        .bind(tenant.as_str())
        .bind(batch)
        .bind(&self.options.node)
        .execute(&mut self.db)
        .await?;
        if completed.rows_affected() == 1 {
            Ok(())
        } else {
            Err(Error::Stale)
        }
    }
}
