//! Migrations, as the driver takes them.

use sqlx::SqlSafeStr;
use sqlx::migrate::{Migration, MigrationType, Migrator};

/// Names and texts of migrations, in their order.
pub(in crate::jobs::store) type Migrations = [(&'static str, &'static str)];

/// Who runs them: each in a transaction of its own, unless all are within one of the caller's.
pub(in crate::jobs::store) fn migrator(migrations: &Migrations, within_one: bool) -> Migrator {
    let numbered = (1..).zip(migrations).map(|(version, &(name, sql))| {
        let (name, sql) = (name.into(), sql.into_sql_str());
        Migration::new(version, name, MigrationType::Simple, sql, within_one)
    });
    Migrator::with_migrations(numbered.collect())
}
