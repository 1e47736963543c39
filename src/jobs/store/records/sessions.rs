//! People who have signed in with a password.

use super::row::Columns;
use crate::jobs::Result;
use crate::jobs::store::Store;
use crate::jobs::store::sql::query;

/// A session as its row has it. Times are milliseconds since the epoch.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Session {
    /// Name of the user.
    pub user: String,
    /// What is kept of the password that opened it.
    pub password: String,
    /// When it began.
    pub began_at: i64,
    /// When it was used last.
    pub used_at: i64,
}

impl Store {
    /// Begins a session under the hash of its cookie. Those that were not used since `idle` go, and of the
    /// others the ones that were used least lately, so that there are at most so many.
    pub async fn begin_session(
        &self,
        hash: String,
        session: Session,
        (idle, most): (i64, u32),
    ) -> Result<()> {
        self.write(move |mut tx| {
            Box::pin(async move {
                query("DELETE FROM sessions WHERE used_at < ?1")
                    .bind(idle)
                    .execute(&mut tx.db)
                    .await?;
                query(
                    "DELETE FROM sessions WHERE hash IN
                         (SELECT hash FROM sessions ORDER BY used_at DESC LIMIT 1000000 OFFSET ?1)",
                )
                .bind(i64::from(most) - 1)
                .execute(&mut tx.db)
                .await?;
                query(
                    "INSERT INTO sessions (hash, user_name, password, began_at, used_at)
                     VALUES (?1, ?2, ?3, ?4, ?5)",
                )
                .bind(hash)
                .bind(session.user)
                .bind(session.password)
                .bind(session.began_at)
                .bind(session.used_at)
                .execute(&mut tx.db)
                .await?;
                Ok(())
            })
        })
        .await
    }

    /// The session of this hash.
    pub async fn session(&self, hash: &str) -> Result<Option<Session>> {
        let row = query("SELECT * FROM sessions WHERE hash = ?1")
            .bind(hash)
            .fetch_optional(self.readers())
            .await?;
        let session = row.map(|row| {
            let columns = Columns::new("sessions", &row);
            Ok(Session {
                user: columns.get("user_name")?,
                password: columns.get("password")?,
                began_at: columns.get("began_at")?,
                used_at: columns.get("used_at")?,
            })
        });
        session.transpose()
    }

    /// Notes that a session is used.
    pub async fn use_session(&self, hash: String, now: i64) -> Result<()> {
        self.write(move |mut tx| {
            Box::pin(async move {
                query("UPDATE sessions SET used_at = MAX(used_at, ?2) WHERE hash = ?1")
                    .bind(hash)
                    .bind(now)
                    .execute(&mut tx.db)
                    .await?;
                Ok(())
            })
        })
        .await
    }

    /// Ends a session.
    pub async fn end_session(&self, hash: String) -> Result<()> {
        self.write(move |mut tx| {
            Box::pin(async move {
                query("DELETE FROM sessions WHERE hash = ?1")
                    .bind(hash)
                    .execute(&mut tx.db)
                    .await?;
                Ok(())
            })
        })
        .await
    }
}
