//! All rows of a folder, copied as they are, and proved to be the same by one reading of both sides.

use futures_util::TryStreamExt;
use sha2::{Digest, Sha256};
use sqlx::postgres::{PgConnection, PgRow, Postgres};
use sqlx::sqlite::SqliteRow;
use sqlx::{AssertSqlSafe, QueryBuilder, Row, SqliteConnection};

use crate::jobs::store::sql::NO_NUL;
use crate::jobs::{Error, Result};

/// The tables that are moved: one that another one refers to comes before that.
pub const TABLES: [&str; 31] = [
    "clouds",
    "batches",
    "jobs",
    "events",
    "metrics",
    "gradients",
    "histories",
    "job_labels",
    "meshes",
    "models",
    "checkpoints",
    "shares",
    "graves",
    "refused",
    "idempotency",
    "tombstones",
    "audit",
    "audit_begins",
    "key_uses",
    "keys",
    "sessions",
    "turns",
    "now_served",
    "waiting",
    "totals",
    "compute",
    "uploads",
    "upload_parts",
    "webhooks",
    "deliveries",
    "meta",
];

/// Tables of either database that have nothing of their own: what the driver knows of migrations and numbers,
/// what a trigger keeps, and who is at work.
pub const DERIVED: [&str; 6] = [
    "_sqlx_migrations",
    "sqlite_sequence",
    "audit_given",
    "nodes",
    "duties",
    "writers",
];

/// Tables whose rows are numbered by the database, and the column of the number.
const NUMBERED: [(&str, &str); 2] = [("events", "seq"), ("meshes", "id")];

/// Columns that have another name on Postgres: table, name here, name there.
const RENAMED: [(&str, &str, &str); 1] = [("now_served", "only", "one")];

/// Rows and bytes of one statement that inserts. Postgres takes 65,535 values.
const ROWS_AT_ONCE: usize = 1_000;
const BYTES_AT_ONCE: usize = 4 << 20;

/// A value of a column.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Text(Option<String>),
    Integer(Option<i64>),
    Real(Option<f64>),
    Bytes(Option<Vec<u8>>),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Text,
    Integer,
    Real,
    Bytes,
}

struct Column {
    /// Here and on Postgres.
    names: [String; 2],
    kind: Kind,
    is_key: bool,
}

/// A table of both databases.
pub(super) struct Table {
    name: &'static str,
    columns: Vec<Column>,
}

/// How many rows a table has, and their SHA-256 in the order of their keys.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sum {
    /// Number of the rows.
    pub rows: u64,
    /// Of all of them.
    pub sha256: String,
}

/// Counts and hashes rows: each value with its kind and its length.
struct Summing {
    rows: u64,
    hash: Sha256,
}

impl Cell {
    fn add_to(&self, hash: &mut Sha256) {
        let number;
        let (kind, bytes): (u8, Option<&[u8]>) = match self {
            Self::Text(text) => (b't', text.as_deref().map(str::as_bytes)),
            Self::Bytes(bytes) => (b'b', bytes.as_deref()),
            Self::Integer(value) => {
                number = value.map(i64::to_be_bytes);
                (b'i', number.as_ref().map(<[u8; 8]>::as_slice))
            }
            Self::Real(value) => {
                number = value.map(f64::to_be_bytes);
                (b'r', number.as_ref().map(<[u8; 8]>::as_slice))
            }
        };
        hash.update([kind, u8::from(bytes.is_some())]);
        let bytes = bytes.unwrap_or_default();
        hash.update((bytes.len() as u64).to_be_bytes());
        hash.update(bytes);
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Text(text) => text.as_ref().map_or(0, String::len),
            Self::Bytes(bytes) => bytes.as_ref().map_or(0, Vec::len),
            Self::Integer(_) | Self::Real(_) => 8,
        }
    }
}

impl Summing {
    fn new() -> Self {
        Self {
            rows: 0,
            hash: Sha256::new(),
        }
    }

    fn add(&mut self, cells: &[Cell]) {
        self.rows += 1;
        for cell in cells {
            cell.add_to(&mut self.hash);
        }
    }

    fn sum(self) -> Sum {
        Sum {
            rows: self.rows,
            sha256: hex::encode(self.hash.finalize()),
        }
    }
}

impl Table {
    /// What both databases say of it.
    ///
    /// # Errors
    /// `NotMoved` if they do not say the same.
    pub(super) async fn of(
        name: &'static str,
        here: &mut SqliteConnection,
        there: &mut PgConnection,
    ) -> Result<Self> {
        let unlike = |detail: String| {
            Error::NotMoved(format!(
                "the table {name} is not the same in both databases: {detail}"
            ))
        };
        let select = "SELECT name, pk > 0 FROM pragma_table_info(?1) ORDER BY pk, cid";
        let own: Vec<(String, bool)> = sqlx::query_as(select).bind(name).fetch_all(here).await?;
        let select = "SELECT CAST(attname AS TEXT), format_type(atttypid, NULL) FROM pg_attribute
             WHERE attrelid = CAST($1 AS regclass) AND attnum > 0 AND NOT attisdropped";
        let theirs = sqlx::query_as(select).bind(name).persistent(false);
        let theirs: Vec<(String, String)> = theirs.fetch_all(there).await?;
        if own.len() != theirs.len() {
            return Err(unlike(format!(
                "{} and {} columns",
                own.len(),
                theirs.len()
            )));
        }
        let mut columns = Vec::new();
        for (column, is_key) in own {
            let renamed = RENAMED
                .iter()
                .find(|known| known.0 == name && known.1 == column);
            let other = renamed.map_or_else(|| column.clone(), |known| known.2.to_owned());
            let found = theirs.iter().find(|(theirs, _)| *theirs == other);
            let kind = match found.map(|(_, kind)| kind.as_str()) {
                Some("text") => Kind::Text,
                Some("bigint") => Kind::Integer,
                Some("double precision") => Kind::Real,
                Some("bytea") => Kind::Bytes,
                kind => return Err(unlike(format!("the column {column} is {kind:?} there"))),
            };
            columns.push(Column {
                names: [column, other],
                kind,
                is_key,
            });
        }
        Ok(Self { name, columns })
    }

    /// All rows in the order of their keys. `side`: 0 here, 1 on Postgres.
    fn select(&self, side: usize) -> String {
        let quoted = |column: &Column| format!("\"{}\"", column.names[side]);
        let all: Vec<String> = self.columns.iter().map(quoted).collect();
        let keys: Vec<String> = self
            .columns
            .iter()
            .filter(|c| c.is_key)
            .map(quoted)
            .collect();
        format!(
            "SELECT {} FROM {} ORDER BY {}",
            all.join(", "),
            self.name,
            keys.join(", ")
        )
    }

    /// Copies all rows; `change` may change one on its way.
    pub(super) async fn copy(
        &self,
        here: &mut SqliteConnection,
        there: &mut PgConnection,
        mut change: impl FnMut(&mut [Cell]),
    ) -> Result<Sum> {
        let mut sum = Summing::new();
        let select = self.select(0);
        let mut rows = sqlx::query(AssertSqlSafe(select)).fetch(here);
        let most = ROWS_AT_ONCE.min(60_000 / self.columns.len().max(1));
        let mut page: Vec<Vec<Cell>> = Vec::new();
        let mut bytes = 0;
        while let Some(row) = rows.try_next().await? {
            let mut cells = self.sqlite(&row)?;
            change(&mut cells);
            sum.add(&cells);
            bytes += cells.iter().map(Cell::bytes).sum::<usize>();
            page.push(cells);
            if page.len() == most || bytes > BYTES_AT_ONCE {
                self.insert(std::mem::take(&mut page), &mut *there).await?;
                bytes = 0;
            }
        }
        self.insert(page, there).await?;
        Ok(sum.sum())
    }

    async fn insert(&self, page: Vec<Vec<Cell>>, there: &mut PgConnection) -> Result<()> {
        if page.is_empty() {
            return Ok(());
        }
        let quoted = |column: &Column| format!("\"{}\"", column.names[1]);
        let names: Vec<String> = self.columns.iter().map(quoted).collect();
        let insert = format!("INSERT INTO {} ({}) ", self.name, names.join(", "));
        let mut insert = QueryBuilder::<Postgres>::new(insert);
        insert.push_values(page, |mut values, cells| {
            for cell in cells {
                match cell {
                    Cell::Text(text) => values.push_bind(text),
                    Cell::Integer(number) => values.push_bind(number),
                    Cell::Real(number) => values.push_bind(number),
                    Cell::Bytes(bytes) => values.push_bind(bytes),
                };
            }
        });
        insert.build().persistent(false).execute(there).await?;
        Ok(())
    }

    /// What is there.
    pub(super) async fn sum(&self, there: &mut PgConnection) -> Result<Sum> {
        let mut sum = Summing::new();
        let select = sqlx::query(AssertSqlSafe(self.select(1))).persistent(false);
        let mut rows = select.fetch(there);
        while let Some(row) = rows.try_next().await? {
            sum.add(&self.postgres(&row)?);
        }
        Ok(sum.sum())
    }

    fn sqlite(&self, row: &SqliteRow) -> Result<Vec<Cell>> {
        let cell = |(at, column): (usize, &Column)| -> Result<Cell> {
            // A column of this database may hold values of several kinds; what they are there decides.
            Ok(match column.kind {
                Kind::Text => {
                    let text: Option<String> = row.try_get_unchecked(at)?;
                    Cell::Text(text.map(|text| text.replace('\0', NO_NUL)))
                }
                Kind::Integer => Cell::Integer(row.try_get_unchecked(at)?),
                Kind::Real => Cell::Real(row.try_get_unchecked(at)?),
                Kind::Bytes => Cell::Bytes(row.try_get_unchecked(at)?),
            })
        };
        self.columns.iter().enumerate().map(cell).collect()
    }

    fn postgres(&self, row: &PgRow) -> Result<Vec<Cell>> {
        let cell = |(at, column): (usize, &Column)| -> Result<Cell> {
            Ok(match column.kind {
                Kind::Text => Cell::Text(row.try_get(at)?),
                Kind::Integer => Cell::Integer(row.try_get(at)?),
                Kind::Real => Cell::Real(row.try_get(at)?),
                Kind::Bytes => Cell::Bytes(row.try_get(at)?),
            })
        };
        self.columns.iter().enumerate().map(cell).collect()
    }

    /// Where a column is in a row.
    pub(super) fn place(&self, column: &str) -> Option<usize> {
        self.columns.iter().position(|own| own.names[0] == column)
    }
}

/// Has the numbers of new rows go on behind all that were ever given.
pub(super) async fn go_on(here: &mut SqliteConnection, there: &mut PgConnection) -> Result<()> {
    let given = "SELECT COALESCE((SELECT seq FROM sqlite_sequence WHERE name = ?1), 0)";
    for (table, column) in NUMBERED {
        let last: i64 = sqlx::query_scalar(given)
            .bind(table)
            .fetch_one(&mut *here)
            .await?;
        if last > 0 {
            let set = "SELECT setval(pg_get_serial_sequence($1, $2), $3)";
            let set = sqlx::query(set).bind(table).bind(column).bind(last);
            set.persistent(false).execute(&mut *there).await?;
        }
    }
    let last: i64 = sqlx::query_scalar(given)
        .bind("audit")
        .fetch_one(here)
        .await?;
    if last > 0 {
        let insert = "INSERT INTO audit_given (one, seq) VALUES (1, $1)";
        sqlx::query(insert)
            .bind(last)
            .persistent(false)
            .execute(there)
            .await?;
    }
    Ok(())
}
