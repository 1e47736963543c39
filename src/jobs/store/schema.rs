//! Migrations, as the driver takes them, and how far a database is.

use sqlx::SqlSafeStr;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// Names and texts of migrations, in their order.
pub(in crate::jobs::store) type Migrations = [(&'static str, &'static str)];

/// How far the tables of a database are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Schema {
    /// Number of the last migration that they went through; 0: there are none.
    pub found: i64,
    /// Number of the last one that this program knows.
    pub known: i64,
}

impl Schema {
    /// Whether nothing is to be done; also of tables that a newer program brought further.
    pub fn is_current(self) -> bool {
        self.found >= self.known
    }
}

/// Who runs them: each in a transaction of its own, unless all are within one of the caller's.
pub(in crate::jobs::store) fn migrator(migrations: &Migrations, within_one: bool) -> Migrator {
    let numbered = (1..).zip(migrations).map(|(version, &(name, sql))| {
        let (name, sql) = (name.into(), sql.into_sql_str());
        Migration::new(version, name, MigrationType::Simple, sql, within_one)
    });
    Migrator::with_migrations(numbered.collect())
}
