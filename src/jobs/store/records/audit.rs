//! Who did what: rows that are written in the transaction of the act and never changed.
//!
//! The hash of a row is the SHA-256 of a JSON array without blanks: the hash of the row before it,
//! then `seq`, `at`, `tenant`, `actor`, `key`, `address`, `action`, `event`, `object`, `outcome` and
//! `request`. The row before the first one counts as 64 zeros. So a row that is changed, removed or
//! moved shows. Who can write the file can also compute all hashes anew, or cut the end off; that
//! shows only against a [`AuditHead`] that was noted elsewhere.

use serde::Serialize;
use serde_json::json;
use sha2::{Digest, Sha256};

use super::act::{Act, Outcome};
use super::row::Columns;
use crate::identity::{Actor, Caller};
use crate::jobs::Result;
use crate::jobs::store::Transaction;
use crate::jobs::store::sql::{Row, either, query, scalar};
use crate::jobs::store::{Acts, Records, Store};

/// The hash before the first row.
const NOTHING: &str = "0000000000000000000000000000000000000000000000000000000000000000";

/// Who does what the service does by itself.
const SERVICE: &str = "meshway";

/// Rows that are read at once.
const PAGE: u32 = 1_000;

/// A row of the trail.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AuditRow {
    /// Its place: 1, 2, 3, … without a gap.
    pub seq: i64,
    /// When, in milliseconds since the epoch.
    pub at: i64,
    /// Whose records; none for a stranger's.
    pub tenant: Option<String>,
    /// Name of the key or of the user; none for a stranger.
    pub actor: Option<String>,
    /// First digits of the key's hash; none for users.
    pub key: Option<String>,
    /// The other end of the connection.
    pub address: Option<String>,
    /// C, R, U, D or E.
    pub action: String,
    /// What was done, as in `mesh.read`.
    pub event: String,
    /// Id of the cloud or the job, or a route.
    pub object: String,
    /// 0 done, 8 refused.
    pub outcome: i64,
    /// Id of the request.
    pub request: String,
    /// Hash of this row and of all before it, in lower-case hexadecimal digits.
    pub hash: String,
}

/// The newest row: noted elsewhere, it shows later whether rows were cut off.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AuditHead {
    /// Place of the newest row; 0 without any.
    pub seq: i64,
    /// Its hash.
    pub hash: String,
}

/// Where the trail is broken.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct AuditFault {
    /// Place of the first row that does not fit.
    pub seq: i64,
    /// What is wrong there.
    pub detail: String,
}

impl AuditRow {
    /// The hash that the row must have after one with the given hash.
    fn expected(&self, before: &str) -> String {
        let parts = json!([
            before,
            self.seq,
            self.at,
            self.tenant,
            self.actor,
            self.key,
            self.address,
            self.action,
            self.event,
            self.object,
            self.outcome,
            self.request
        ]);
        hex::encode(Sha256::digest(parts.to_string()))
    }
}

impl Acts<'_> {
    /// Notes something that writes nothing else, such as a read, before it is answered.
    pub async fn note(self, act: Act, object: &str, outcome: Outcome) -> Result<()> {
        if self.caller.actor == Actor::Anybody {
            return Ok(());
        }
        let (caller, object) = (self.caller.clone(), object.to_owned());
        self.store
            .write(move |mut tx| {
                Box::pin(async move { tx.testify(&caller, (act, outcome), &object).await })
            })
            .await
    }
}

impl Records<'_> {
    /// A page of the tenant's rows, newest first; `before` is the last one of the page before it.
    pub async fn audit(self, before: Option<i64>, limit: u32) -> Result<Vec<AuditRow>> {
        let select = "SELECT * FROM audit WHERE tenant = ?1 AND (?2 IS NULL OR seq < ?2)
                      ORDER BY seq DESC LIMIT ?3";
        let rows = query(select)
            .bind(self.tenant.as_str())
            .bind(before)
            .bind(limit);
        let rows = rows.fetch_all(self.readers()).await?;
        rows.iter().map(row_of).collect()
    }
}

impl Store {
    /// Rows of the whole trail after the given place, in their order; fewer than asked for at its end.
    pub async fn audit_after(&self, seq: i64, limit: u32) -> Result<Vec<AuditRow>> {
        let select = "SELECT * FROM audit WHERE seq > ?1 ORDER BY seq LIMIT ?2";
        let rows = query(select).bind(seq).bind(limit);
        let rows = rows.fetch_all(self.readers()).await?;
        rows.iter().map(row_of).collect()
    }

    /// The newest row.
    pub async fn audit_head(&self) -> Result<AuditHead> {
        let head = query(HEAD).fetch_optional(self.readers()).await?;
        head_of(head)
    }

    /// Walks the whole trail: its head, or the first place where it is broken. `known` are heads that
    /// were noted earlier, which must still be in it.
    pub async fn audit_verify(
        &self,
        known: &[AuditHead],
    ) -> Result<std::result::Result<AuditHead, AuditFault>> {
        let begins = query(BEGINS).fetch_optional(self.readers()).await?;
        let begins = head_of(begins)?;
        let mut head = begins.clone();
        let mut missing: Vec<&AuditHead> = known.iter().collect();
        missing.retain(|known| known.seq > begins.seq);
        let fault = |seq, detail: &str| {
            let detail = detail.to_owned();
            Ok(Err(AuditFault { seq, detail }))
        };
        loop {
            let rows = self.audit_after(head.seq, PAGE).await?;
            for row in &rows {
                if row.seq != head.seq + 1 {
                    return fault(head.seq + 1, "the row is missing");
                }
                if row.hash != row.expected(&head.hash) {
                    return fault(row.seq, "the row, or the one before it, was changed");
                }
                if missing
                    .iter()
                    .any(|known| known.seq == row.seq && known.hash != row.hash)
                {
                    return fault(row.seq, "the row has another hash than was noted");
                }
                missing.retain(|known| known.seq != row.seq);
                head = AuditHead {
                    seq: row.seq,
                    hash: row.hash.clone(),
                };
            }
            if rows.len() < PAGE as usize {
                break;
            }
        }
        // The largest number that was given, which SQLite keeps by itself.
        let last = either(
            "SELECT seq FROM sqlite_sequence WHERE name = 'audit'",
            "SELECT seq FROM audit_given",
        );
        let last: Option<i64> = scalar(last).fetch_optional(self.readers()).await?;
        let noted = missing.iter().map(|known| known.seq).max();
        match last.max(noted) {
            Some(last) if last > head.seq => fault(head.seq + 1, "the end is missing"),
            _ => Ok(Ok(head)),
        }
    }

    /// Removes the oldest rows, up to the first one that is not older than the given time
    /// (milliseconds since the epoch), and tells how many. The trail then begins after them.
    pub async fn audit_prune(&self, before: i64) -> Result<u64> {
        self.write(move |mut tx| {
            Box::pin(async move {
                query(
                    "INSERT INTO audit_begins (seq, hash)
                     SELECT seq, hash FROM audit
                     WHERE seq < COALESCE((SELECT MIN(seq) FROM audit WHERE at >= ?1),
                                          (SELECT MAX(seq) + 1 FROM audit))
                     ORDER BY seq DESC LIMIT 1
                     ON CONFLICT DO NOTHING",
                )
                .bind(before)
                .execute(&mut tx.db)
                .await?;
                let delete = "DELETE FROM audit WHERE seq <= (SELECT MAX(seq) FROM audit_begins)";
                let deleted = query(delete).execute(&mut tx.db).await?;
                Ok(deleted.rows_affected())
            })
        })
        .await
    }
}

const HEAD: &str = "SELECT seq, hash FROM audit ORDER BY seq DESC LIMIT 1";
const BEGINS: &str = "SELECT seq, hash FROM audit_begins ORDER BY seq DESC LIMIT 1";

fn head_of(found: Option<Row>) -> Result<AuditHead> {
    let Some(row) = found else {
        let hash = NOTHING.to_owned();
        return Ok(AuditHead { seq: 0, hash });
    };
    let columns = Columns::new("audit", &row);
    Ok(AuditHead {
        seq: columns.get("seq")?,
        hash: columns.get("hash")?,
    })
}

impl Transaction<'_> {
    /// Tells of what this transaction does. A service without keys cannot say who did it, and tells
    /// nothing.
    pub(in crate::jobs::store) async fn witness(
        &mut self,
        caller: &Caller,
        act: Act,
        object: &str,
    ) -> Result<()> {
        if caller.actor == Actor::Anybody {
            return Ok(());
        }
        self.testify(caller, (act, Outcome::Done), object).await
    }

    async fn testify(
        &mut self,
        caller: &Caller,
        (act, outcome): (Act, Outcome),
        object: &str,
    ) -> Result<()> {
        let mut head = query(HEAD).fetch_optional(&mut self.db).await?;
        if head.is_none() {
            head = query(BEGINS).fetch_optional(&mut self.db).await?;
        }
        let head = head_of(head)?;
        let (tenant, actor, key) = match &caller.actor {
            Actor::Key { name, id } => (Some(&caller.tenant), Some(name.as_ref()), Some(id)),
            Actor::User { name } => (Some(&caller.tenant), Some(name.as_ref()), None),
            Actor::Service => (Some(&caller.tenant), Some(SERVICE), None),
            Actor::Stranger | Actor::Anybody => (None, None, None),
        };
        let mut row = AuditRow {
            seq: head.seq + 1,
            at: self.now,
            tenant: tenant.map(ToString::to_string),
            actor: actor.map(str::to_owned),
            key: key.map(ToString::to_string),
            address: caller
                .address
                .map(|address| address.to_canonical().to_string()),
            action: act.action().to_owned(),
            event: act.name().to_owned(),
            object: object.to_owned(),
            outcome: outcome.number(),
            request: caller.request.to_string(),
            hash: String::new(),
        };
        row.hash = row.expected(&head.hash);
        query(
            "INSERT INTO audit (seq, at, tenant, actor, key, address, action, event, object,
                 outcome, request, hash)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10, ?11, ?12)",
        )
        .bind(row.seq)
        .bind(row.at)
        .bind(row.tenant)
        .bind(row.actor)
        .bind(row.key)
        .bind(row.address)
        .bind(row.action)
        .bind(row.event)
        .bind(row.object)
        .bind(row.outcome)
        .bind(row.request)
        .bind(row.hash)
        .execute(&mut self.db)
        .await?;
        Ok(())
    }
}

fn row_of(row: &Row) -> Result<AuditRow> {
    let columns = Columns::new("audit", row);
    Ok(AuditRow {
        seq: columns.get("seq")?,
        at: columns.get("at")?,
        tenant: columns.get("tenant")?,
        actor: columns.get("actor")?,
        key: columns.get("key")?,
        address: columns.get("address")?,
        action: columns.get("action")?,
        event: columns.get("event")?,
        object: columns.get("object")?,
        outcome: columns.get("outcome")?,
        request: columns.get("request")?,
        hash: columns.get("hash")?,
    })
}
