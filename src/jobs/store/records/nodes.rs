//! Processes that share the database, and what one of them does for all.

use std::collections::BTreeMap;

use crate::jobs::store::Store;
use crate::jobs::store::sql::{query, scalar};
use crate::jobs::{Error, Result};

/// How long a process counts that is not seen, in milliseconds: several times the pause between two beats.
const NODE_LASTS_MS: i64 = 60_000;

/// A process as it enters.
#[derive(Debug, Clone)]
pub struct NewNode {
    /// Name of this start, which no other start has.
    pub name: String,
    /// Name of its machine.
    pub host: String,
    /// What it does.
    pub role: Role,
    /// Jobs that it works on at the same time.
    pub slots: u16,
}

/// What a process does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// It answers requests, and may work on jobs.
    Serve,
    /// It works on jobs.
    Worker,
}

impl Role {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Serve, Self::Worker];

    /// Its name in rows and metrics.
    pub fn name(self) -> &'static str {
        match self {
            Self::Serve => "serve",
            Self::Worker => "worker",
        }
    }
}

impl Store {
    /// Whether other processes on other machines may serve and work with the same records: everything
    /// that a record names is where all of them reach it.
    pub fn is_shared(&self) -> bool {
        self.inner.notices.is_some() && !self.keeps_files()
    }

    /// Enters the process among those that share the database, or tells that it is still there.
    pub async fn join(&self, node: &NewNode) -> Result<()> {
        let node = node.clone();
        self.write(move |mut tx| {
            Box::pin(async move {
                query(
                    "INSERT INTO nodes (name, host, role, version, slots, started_at, seen_at)
                     VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?6)
                     ON CONFLICT (name) DO UPDATE SET seen_at = excluded.seen_at",
                )
                .bind(&node.name)
                .bind(&node.host)
                .bind(node.role.name())
                .bind(env!("CARGO_PKG_VERSION"))
                .bind(i64::from(node.slots))
                .bind(tx.now)
                .execute(&mut tx.db)
                .await?;
                query("DELETE FROM nodes WHERE seen_at < ?1 - 60 * ?2")
                    .bind(tx.now)
                    .bind(NODE_LASTS_MS)
                    .execute(&mut tx.db)
                    .await?;
                Ok(())
            })
        })
        .await
    }

    /// Takes the process out; its duties are others' from now on.
    pub async fn leave(&self, name: &str) -> Result<()> {
        let name = name.to_owned();
        self.write(move |mut tx| {
            Box::pin(async move {
                let statements = [
                    "DELETE FROM nodes WHERE name = ?1",
                    "DELETE FROM duties WHERE node = ?1",
                ];
                tx.run_each(&statements, &name).await
            })
        })
        .await
    }

    /// Processes of each role that were seen lately, and the jobs that all of them work on at the same
    /// time.
    pub async fn nodes(&self) -> Result<(BTreeMap<Role, u64>, u64)> {
        let select = "SELECT role, COUNT(*), CAST(SUM(slots) AS BIGINT) FROM nodes
                      WHERE seen_at >= ?1 GROUP BY role";
        let rows = query(select)
            .bind(self.now() - NODE_LASTS_MS)
            .fetch_all(self.readers())
            .await?;
        let (mut nodes, mut slots) = (BTreeMap::new(), 0);
        for row in rows {
            let name: String = row.at(0)?;
            let role = Role::ALL.into_iter().find(|role| role.name() == name);
            let role = role.ok_or_else(|| Error::Inconsistent {
                table: "nodes",
                column: "role",
                detail: name,
            })?;
            nodes.insert(role, row.at::<i64>(1)?.unsigned_abs());
            slots += row.at::<i64>(2)?.unsigned_abs();
        }
        Ok((nodes, slots))
    }

    /// Takes a duty for so long, or takes it for longer. Whether the process has it: one that another
    /// process has is taken over once its time is over. One that is alone has all of them.
    pub async fn take_duty(&self, name: &'static str, ms: i64) -> Result<bool> {
        if !self.is_shared() {
            return Ok(true);
        }
        let node = self.inner.options.node.clone();
        self.write(move |mut tx| {
            Box::pin(async move {
                let taken = query(
                    "INSERT INTO duties (name, node, ends) VALUES (?1, ?2, ?3 + ?4)
                     ON CONFLICT (name) DO UPDATE SET node = excluded.node, ends = excluded.ends
                     WHERE duties.node = excluded.node OR duties.ends < ?3",
                )
                .bind(name)
                .bind(&node)
                .bind(tx.now)
                .bind(ms)
                .execute(&mut tx.db)
                .await?;
                Ok(taken.rows_affected() == 1)
            })
        })
        .await
    }

    /// Forgets requests in flight whose process is not there any more, and tells how many.
    pub async fn forget_lost_requests(&self) -> Result<u64> {
        let lost = "SELECT EXISTS (SELECT 1 FROM idempotency WHERE status IS NULL)";
        if !scalar(lost).fetch_one(self.readers()).await? {
            return Ok(0);
        }
        self.write(|mut tx| {
            Box::pin(async move {
                let deleted = query(
                    "DELETE FROM idempotency WHERE status IS NULL
                       AND node NOT IN (SELECT name FROM nodes WHERE seen_at >= ?1)",
                )
                .bind(tx.now - NODE_LASTS_MS)
                .execute(&mut tx.db)
                .await?;
                Ok(deleted.rows_affected())
            })
        })
        .await
    }
}
