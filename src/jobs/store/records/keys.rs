//! When keys were used last.

use std::collections::HashMap;

use super::row::Columns;
use crate::jobs::Result;
use crate::jobs::store::Store;

impl Store {
    /// Notes that the key of this id is used now.
    pub async fn note_use(&self, key: &str) -> Result<()> {
        let key = key.to_owned();
        self.write(move |tx| {
            Box::pin(async move {
                sqlx::query(
                    "INSERT INTO key_uses (key, used_at) VALUES (?1, ?2)
                     ON CONFLICT (key) DO UPDATE SET used_at = MAX(used_at, ?2)",
                )
                .bind(key)
                .bind(tx.now)
                .execute(tx.db)
                .await?;
                Ok(())
            })
        })
        .await
    }

    /// When keys were used last, by their ids, in milliseconds since the epoch.
    pub async fn key_uses(&self) -> Result<HashMap<String, i64>> {
        sqlx::query("SELECT * FROM key_uses")
            .fetch_all(self.readers())
            .await?
            .iter()
            .map(|row| {
                let columns = Columns::new("key_uses", row);
                Ok((columns.get("key")?, columns.get("used_at")?))
            })
            .collect()
    }
}
