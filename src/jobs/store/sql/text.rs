//! The text of a statement, as each database wants it.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, PoisonError, RwLock};

use sqlx::{AssertSqlSafe, SqlSafeStr, SqlStr};

/// What only `SQLite` understands, up to the name behind it: which index it is to use.
const INDEX: &str = " INDEXED BY ";

/// The text of a statement.
#[derive(Clone, Copy)]
pub(in crate::jobs::store) struct Text {
    sqlite: &'static str,
    postgres: &'static str,
}

/// A statement that is not the same in both databases.
pub(in crate::jobs::store) fn either(sqlite: &'static str, postgres: &'static str) -> Text {
    Text { sqlite, postgres }
}

impl From<&'static str> for Text {
    fn from(text: &'static str) -> Self {
        either(text, text)
    }
}

impl Text {
    pub(super) fn for_sqlite(self) -> SqlStr {
        self.sqlite.into_sql_str()
    }

    /// Written anew once a process: the driver finds a statement that it has prepared by its text.
    pub(super) fn for_postgres(self) -> SqlStr {
        static WRITTEN: LazyLock<RwLock<HashMap<&'static str, Arc<str>>>> =
            LazyLock::new(RwLock::default);
        let known = {
            let written = WRITTEN.read().unwrap_or_else(PoisonError::into_inner);
            written.get(self.postgres).cloned()
        };
        let text = known.unwrap_or_else(|| {
            let text: Arc<str> = for_postgres(self.postgres).into();
            let mut written = WRITTEN.write().unwrap_or_else(PoisonError::into_inner);
            written.insert(self.postgres, Arc::clone(&text));
            text
        });
        // Of a text of ours nothing is changed but what is said above.
        AssertSqlSafe(text).into_sql_str()
    }
}

/// Writes `?1` as `$1`, and leaves out which index is to be used.
fn for_postgres(text: &str) -> String {
    let mut parts = text.split(INDEX);
    let mut written = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let name = part.find(|c: char| !c.is_alphanumeric() && c != '_');
        written.push_str(&part[name.unwrap_or(part.len())..]);
    }
    written.replace('?', "$")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn postgres_gets_its_own_parameters_and_no_indexes() {
        assert_eq!(
            for_postgres("SELECT a FROM b INDEXED BY b_by_a WHERE a = ?1 OR ?12 IS NULL"),
            "SELECT a FROM b WHERE a = $1 OR $12 IS NULL"
        );
        assert_eq!(
            for_postgres("SELECT a FROM b INDEXED BY c"),
            "SELECT a FROM b"
        );
        assert_eq!(for_postgres("(b INDEXED BY c) d"), "(b) d");
    }
}
