//! Databases as their own clients see them.

use std::path::Path;
use std::time::Duration;

use sqlx::postgres::{PgConnectOptions, PgConnection};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{AssertSqlSafe, ConnectOptions, Connection, SqliteConnection};
use uuid::Uuid;

/// What the rows of a store are in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Engine {
    Sqlite,
    Postgres,
}

/// Address of a Postgres server where databases may be made.
const SERVER: &str = "MESHWAY_TEST_DATABASE";

/// The server to test with; says so where there is none.
#[expect(
    clippy::disallowed_methods,
    reason = "a test is told of its server by the environment"
)]
#[expect(clippy::print_stderr, reason = "what is left out is said aloud")]
pub(crate) fn server() -> Option<String> {
    let server = std::env::var(SERVER).ok();
    if server.is_none() {
        assert!(
            std::env::var_os("CI").is_none(),
            "{SERVER} is not set: run the tests by scripts/postgres.sh"
        );
        eprintln!("Postgres is left out: {SERVER} is not set (scripts/postgres.sh sets it)");
    }
    server
}

/// Makes a database of its own for a test; none where there is no server.
pub(crate) async fn new_database() -> Option<String> {
    let server = server()?;
    let options: PgConnectOptions = server.parse().unwrap();
    let mut db = options.connect().await.unwrap();
    let name = format!("t_{}", Uuid::now_v7().simple());
    let create = format!("CREATE DATABASE {name}");
    sqlx::raw_sql(AssertSqlSafe(create))
        .execute(&mut db)
        .await
        .unwrap();
    db.close().await.unwrap();
    Some(options.database(&name).to_url_lossy().to_string())
}

/// A connection past the store.
pub(crate) enum Bare {
    Sqlite(SqliteConnection),
    Postgres(PgConnection),
}

impl Bare {
    pub(crate) async fn sqlite(file: &Path) -> Self {
        Self::Sqlite(connect(file).await)
    }

    pub(crate) async fn postgres(url: &str) -> Self {
        let options: PgConnectOptions = url.parse().unwrap();
        Self::Postgres(options.connect().await.unwrap())
    }

    /// Runs a statement.
    pub(crate) async fn run(&mut self, statement: &str) -> sqlx::Result<()> {
        let query = sqlx::raw_sql(AssertSqlSafe(statement));
        match self {
            Self::Sqlite(db) => query.execute(db).await.map(|_| ()),
            Self::Postgres(db) => query.execute(db).await.map(|_| ()),
        }
    }

    /// The texts of the first column.
    pub(crate) async fn texts(&mut self, select: &str) -> Vec<String> {
        let select = AssertSqlSafe(select);
        let texts = match self {
            Self::Sqlite(db) => sqlx::query_scalar(select).fetch_all(db).await,
            Self::Postgres(db) => sqlx::query_scalar(select).fetch_all(db).await,
        };
        texts.unwrap()
    }

    /// The number in the only row.
    pub(crate) async fn number(&mut self, select: &str) -> i64 {
        let select = AssertSqlSafe(select);
        let number = match self {
            Self::Sqlite(db) => sqlx::query_scalar(select).fetch_one(db).await,
            Self::Postgres(db) => sqlx::query_scalar(select).fetch_one(db).await,
        };
        number.unwrap()
    }
}

/// A bare connection to a file of `SQLite`.
pub(crate) async fn connect(file: &Path) -> SqliteConnection {
    SqliteConnectOptions::new()
        .filename(file)
        .busy_timeout(Duration::from_secs(5))
        .connect()
        .await
        .unwrap()
}
