//! Keys that the API made, and when keys were used last.

use std::collections::HashMap;

use super::act::Act;
use super::row::{Columns, to_json};
use crate::identity::{Key, KeyHash, Scope, file};
use crate::jobs::store::sql::{Row, query};
use crate::jobs::store::{Acts, Store};
use crate::jobs::{Error, Result};

impl Acts<'_> {
    /// Keeps a key of the caller's tenant, with the row of the act. `false` where the tenant has one of
    /// this name already.
    pub async fn create_key(self, key: Key) -> Result<bool> {
        let caller = self.caller.clone();
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let scopes: Vec<_> = key.scopes.iter().map(Scope::name).collect();
                    let networks: Vec<_> = key.networks.iter().map(ToString::to_string).collect();
                    let inserted = query(
                        "INSERT INTO keys (id, hash, name, tenant, scopes, networks, limits, expires,
                             created_at)
                         VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9) ON CONFLICT DO NOTHING",
                    )
                    .bind(key.hash.id())
                    .bind(key.hash.to_string())
                    .bind(&*key.name)
                    .bind(caller.tenant.as_str())
                    .bind(to_json(&scopes))
                    .bind(to_json(&networks))
                    .bind(to_json(&key.limits))
                    .bind(key.expires)
                    .bind(tx.now)
                    .execute(&mut tx.db)
                    .await?;
                    if inserted.rows_affected() == 0 {
                        return Ok(false);
                    }
                    tx.witness(&caller, Act::KeyCreate, &key.hash.id()).await?;
                    Ok(true)
                })
            })
            .await
    }

    /// Removes a key of the caller's tenant, with the row of the act. `false` where there is none.
    pub async fn delete_key(self, id: &str) -> Result<bool> {
        let (caller, id) = (self.caller.clone(), id.to_owned());
        self.store
            .write(move |mut tx| {
                Box::pin(async move {
                    let removed = query("DELETE FROM keys WHERE id = ?1 AND tenant = ?2")
                        .bind(&id)
                        .bind(caller.tenant.as_str())
                        .execute(&mut tx.db)
                        .await?;
                    if removed.rows_affected() == 0 {
                        return Ok(false);
                    }
                    tx.witness(&caller, Act::KeyDelete, &id).await?;
                    Ok(true)
                })
            })
            .await
    }
}

impl Store {
    /// The keys of all tenants that the API made.
    pub async fn keys(&self) -> Result<Vec<Key>> {
        let rows = query("SELECT * FROM keys")
            .fetch_all(self.readers())
            .await?;
        rows.iter().map(key_of).collect()
    }

    /// The key of this hash, if the API made it.
    pub async fn key(&self, hash: &KeyHash) -> Result<Option<Key>> {
        let row = query("SELECT * FROM keys WHERE hash = ?1")
            .bind(hash.to_string())
            .fetch_optional(self.readers())
            .await?;
        row.as_ref().map(key_of).transpose()
    }

    /// Notes that the key of this id is used now.
    pub async fn note_use(&self, key: &str) -> Result<()> {
        let key = key.to_owned();
        self.write(move |mut tx| {
            Box::pin(async move {
                query(
                    "INSERT INTO key_uses (key, used_at) VALUES (?1, ?2)
                     ON CONFLICT (key) DO UPDATE SET used_at = MAX(key_uses.used_at, ?2)",
                )
                .bind(key)
                .bind(tx.now)
                .execute(&mut tx.db)
                .await?;
                Ok(())
            })
        })
        .await
    }

    /// When keys were used last, by their ids, in milliseconds since the epoch.
    pub async fn key_uses(&self) -> Result<HashMap<String, i64>> {
        query("SELECT * FROM key_uses")
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

fn key_of(row: &Row) -> Result<Key> {
    let columns = Columns::new("keys", row);
    let scopes: Vec<String> = columns.json("scopes")?;
    let networks: Vec<String> = columns.json("networks")?;
    Ok(Key {
        name: columns.get::<&str>("name")?.into(),
        tenant: columns.parsed("tenant")?,
        hash: columns.parsed("hash")?,
        scopes: file::scopes(&scopes).map_err(Error::inconsistent("keys", "scopes"))?,
        expires: columns.get("expires")?,
        networks: file::networks(&networks).map_err(Error::inconsistent("keys", "networks"))?,
        limits: columns.json("limits")?,
        in_file: false,
    })
}
