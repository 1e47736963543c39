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

    /// With values in it, as [`Value::literal`] writes them.
    ///
    /// [`Value::literal`]: super::Value::literal
    pub(super) fn with_literals(self, literals: &[String]) -> SqlStr {
        let text = with_literals(&without_indexes(self.postgres), literals);
        // The values are literals, whatever is in them.
        AssertSqlSafe(text).into_sql_str()
    }
}

/// Writes each `?N` as the literal of that number.
fn with_literals(text: &str, literals: &[String]) -> String {
    let mut parts = text.split('?');
    let mut written = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| !c.is_ascii_digit());
        let (number, rest) = part.split_at(end.unwrap_or(part.len()));
        let place = number.parse::<usize>().ok().and_then(|n| n.checked_sub(1));
        // A parameter without a value stays as it is, and the server refuses it.
        match place.and_then(|place| literals.get(place)) {
            Some(literal) => written.push_str(literal),
            None => written.extend(["?", number]),
        }
        written.push_str(rest);
    }
    written
}

/// Leaves out which index is to be used.
fn without_indexes(text: &str) -> String {
    let mut parts = text.split(INDEX);
    let mut written = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let name = part.find(|c: char| !c.is_alphanumeric() && c != '_');
        written.push_str(&part[name.unwrap_or(part.len())..]);
    }
    written
}

/// Writes `?1` as `$1`, and leaves out which index is to be used.
fn for_postgres(text: &str) -> String {
    without_indexes(text).replace('?', "$")
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

    #[test]
    fn values_take_the_places_of_their_parameters() {
        let literals: Vec<String> = (1..=12).map(|n| format!("E'?{n}'")).collect();
        assert_eq!(
            with_literals("a = ?1 AND (b = ?12 OR c = ?1)", &literals),
            "a = E'?1' AND (b = E'?12' OR c = E'?1')"
        );
        assert_eq!(with_literals("a = ?13", &literals), "a = ?13");
    }
}
