//! One text of SQL for two databases: `SQLite`, for which it is written, and Postgres.
//!
//! [`query`] and [`scalar`] look like those of the driver. What they run on is a [`Db`], which is the
//! connection of a transaction, or the [`Readers`]; which database that is, nobody else has to know.
//! A statement has parameters `?1`, `?2`, … and uses what both databases have. Where `SQLite` has no
//! portable form, such as the larger of two numbers, Postgres has a function of the same name
//! (`migrations/postgres`). The few statements that cannot be one text are two: [`either`].

mod db;
mod many;
mod row;
mod text;
mod value;

use sqlx::postgres::{PgArguments, PgConnection, PgPool, Postgres};
use sqlx::sqlite::SqliteArguments;
use sqlx::{Arguments, Connection, Database, Executor, IntoArguments, SqlSafeStr, SqlStr};

pub(in crate::jobs::store) use db::{Db, FLUSH, On, Protocol, Readers, in_time};
pub(in crate::jobs::store) use many::many;
pub(in crate::jobs::store) use row::{Column, Row};
pub(in crate::jobs::store) use text::{Text, either};
pub(in crate::jobs::store) use value::{NO_NUL, Value};

use crate::jobs::{Error, Result};

/// A statement and its values.
#[must_use]
pub(in crate::jobs::store) struct Query<'q> {
    text: Text,
    values: Vec<Value<'q>>,
}

/// A statement, to which values are bound in the order of its parameters.
pub(in crate::jobs::store) fn query<'q>(text: impl Into<Text>) -> Query<'q> {
    Query {
        text: text.into(),
        values: Vec::new(),
    }
}

/// A statement of which the first column is asked.
pub(in crate::jobs::store) fn scalar<'q>(text: impl Into<Text>) -> Scalar<'q> {
    Scalar(query(text))
}

/// What is wanted of a statement.
#[derive(Debug, Clone, Copy)]
enum Wanted {
    Count,
    All,
    First,
}

/// What came of it.
#[derive(Default)]
struct Answer {
    count: u64,
    rows: Vec<Row>,
}

/// What a statement did that has no rows.
pub(in crate::jobs::store) struct Done {
    rows: u64,
}

impl Done {
    /// Number of rows that were inserted, changed or deleted.
    pub(in crate::jobs::store) fn rows_affected(&self) -> u64 {
        self.rows
    }
}

impl<'q> Query<'q> {
    /// The value of the next parameter.
    pub(in crate::jobs::store) fn bind(mut self, value: impl Into<Value<'q>>) -> Self {
        self.values.push(value.into());
        self
    }

    pub(in crate::jobs::store) async fn execute<'e>(self, on: impl Into<On<'e>>) -> Result<Done> {
        use Protocol::{Prepared, Whole};
        let rows = match on.into() {
            On::Sqlite(db) => execute(self.sqlite()?, db).await?.rows_affected(),
            On::SqlitePool(pool) => execute(self.sqlite()?, pool).await?.rows_affected(),
            On::Postgres(db, Prepared) => {
                in_time(Box::pin(self.afresh(db, Wanted::Count)))
                    .await?
                    .count
            }
            On::PostgresPool(pool, Prepared) => {
                in_time(Box::pin(self.pooled(pool, Wanted::Count)))
                    .await?
                    .count
            }
            On::Postgres(db, Whole) => in_time(Box::pin(run(self.whole(), db))).await?,
            On::PostgresPool(pool, Whole) => in_time(Box::pin(run(self.whole(), pool))).await?,
        };
        Ok(Done { rows })
    }

    pub(in crate::jobs::store) async fn fetch_all<'e>(
        self,
        on: impl Into<On<'e>>,
    ) -> Result<Vec<Row>> {
        use Protocol::{Prepared, Whole};
        match on.into() {
            On::Sqlite(db) => all(self.sqlite()?, db).await,
            On::SqlitePool(pool) => all(self.sqlite()?, pool).await,
            On::Postgres(db, Prepared) => {
                Ok(in_time(Box::pin(self.afresh(db, Wanted::All))).await?.rows)
            }
            On::PostgresPool(pool, Prepared) => {
                Ok(in_time(Box::pin(self.pooled(pool, Wanted::All)))
                    .await?
                    .rows)
            }
            On::Postgres(db, Whole) => in_time(Box::pin(rows(self.whole(), db))).await,
            On::PostgresPool(pool, Whole) => in_time(Box::pin(rows(self.whole(), pool))).await,
        }
    }

    /// The rows, once the server's disk has all that they show: they are seen again after whatever happens
    /// to it. `SQLite` shows nothing before.
    pub(in crate::jobs::store) async fn fetch_settled(self, readers: &Readers) -> Result<Vec<Row>> {
        let (pool, protocol) = match readers {
            Readers::Sqlite(_) => return self.fetch_all(readers).await,
            Readers::Postgres(pool, protocol) => (pool, protocol),
        };
        // In one session: a server that started again meanwhile may have lost what was read, and then
        // its disk has nothing to do with it.
        in_time(Box::pin(async {
            match protocol {
                Protocol::Prepared => {
                    let mut db = pool.acquire().await?;
                    let found = self.again(&mut db, Wanted::All).await?.rows;
                    if !found.is_empty() {
                        run(FLUSH.into_sql_str(), &mut *db).await?;
                    }
                    Ok(found)
                }
                Protocol::Whole => {
                    let mut transaction = pool.begin().await?;
                    let found = rows(self.whole(), &mut *transaction).await?;
                    if !found.is_empty() {
                        run(FLUSH.into_sql_str(), &mut *transaction).await?;
                    }
                    transaction.commit().await?;
                    Ok(found)
                }
            }
        }))
        .await
    }

    pub(in crate::jobs::store) async fn fetch_optional<'e>(
        self,
        on: impl Into<On<'e>>,
    ) -> Result<Option<Row>> {
        use Protocol::{Prepared, Whole};
        match on.into() {
            On::Sqlite(db) => optional(self.sqlite()?, db).await,
            On::SqlitePool(pool) => optional(self.sqlite()?, pool).await,
            On::Postgres(db, Prepared) => {
                let found = in_time(Box::pin(self.afresh(db, Wanted::First))).await?;
                Ok(found.rows.into_iter().next())
            }
            On::PostgresPool(pool, Prepared) => {
                let found = in_time(Box::pin(self.pooled(pool, Wanted::First))).await?;
                Ok(found.rows.into_iter().next())
            }
            On::Postgres(db, Whole) => in_time(Box::pin(row(self.whole(), db))).await,
            On::PostgresPool(pool, Whole) => in_time(Box::pin(row(self.whole(), pool))).await,
        }
    }

    /// # Errors
    /// `Database` also where there is no row.
    pub(in crate::jobs::store) async fn fetch_one<'e>(self, on: impl Into<On<'e>>) -> Result<Row> {
        let row = self.fetch_optional(on).await?;
        row.ok_or_else(|| Error::from(sqlx::Error::RowNotFound))
    }

    fn sqlite(self) -> Result<(SqlStr, SqliteArguments)> {
        let mut arguments = SqliteArguments::default();
        for value in self.values {
            value.add_to(&mut arguments)?;
        }
        Ok((self.text.for_sqlite(), arguments))
    }

    fn postgres(&self) -> Result<(SqlStr, PgArguments)> {
        let mut arguments = PgArguments::default();
        arguments.reserve(self.values.len(), 0);
        for value in &self.values {
            value.borrowed().without_nul().add_to(&mut arguments)?;
        }
        Ok((self.text.for_postgres(), arguments))
    }

    /// Runs it on a connection. What that kept prepared of tables that have changed since is forgotten.
    ///
    /// # Errors
    /// `Busy` if the tables have changed; the transaction has failed then.
    async fn afresh(&self, db: &mut PgConnection, wanted: Wanted) -> Result<Answer> {
        match self.on_postgres(db, wanted).await {
            Err(error) if is_outdated(&error) => {
                db.clear_cached_statements().await?;
                Err(Error::Busy)
            }
            result => result,
        }
    }

    /// The same outside of a transaction: it is asked once more.
    async fn again(&self, db: &mut PgConnection, wanted: Wanted) -> Result<Answer> {
        match self.on_postgres(db, wanted).await {
            Err(error) if is_outdated(&error) => {
                db.clear_cached_statements().await?;
                self.on_postgres(db, wanted).await
            }
            result => result,
        }
    }

    /// The same on a connection of a pool.
    async fn pooled(&self, pool: &PgPool, wanted: Wanted) -> Result<Answer> {
        self.again(&mut *pool.acquire().await?, wanted).await
    }

    async fn on_postgres(&self, db: &mut PgConnection, wanted: Wanted) -> Result<Answer> {
        let statement = self.postgres()?;
        let mut answer = Answer::default();
        match wanted {
            Wanted::Count => answer.count = execute(statement, db).await?.rows_affected(),
            Wanted::All => answer.rows = all(statement, db).await?,
            Wanted::First => answer.rows.extend(optional(statement, db).await?),
        }
        Ok(answer)
    }

    /// The statement with its values in it, for Postgres.
    fn whole(self) -> SqlStr {
        let values = self.values.into_iter().map(Value::without_nul);
        let literals: Vec<String> = values.map(|value| value.literal()).collect();
        self.text.with_literals(&literals)
    }
}

/// Whether a statement was prepared before its tables got another column: "cached plan must not change
/// result type", before anything is done.
fn is_outdated(error: &Error) -> bool {
    let Error::Database(error) = error else {
        return false;
    };
    let error = error.as_database_error();
    error.is_some_and(|error| error.code().as_deref() == Some("0A000"))
}

/// A statement with its values in it, as one message.
async fn run<'e>(text: SqlStr, db: impl Executor<'e, Database = Postgres>) -> Result<u64> {
    Ok(sqlx::raw_sql(text).execute(db).await?.rows_affected())
}

async fn rows<'e>(text: SqlStr, db: impl Executor<'e, Database = Postgres>) -> Result<Vec<Row>> {
    let rows = sqlx::raw_sql(text).fetch_all(db).await?;
    Ok(rows.into_iter().map(Into::into).collect())
}

async fn row<'e>(text: SqlStr, db: impl Executor<'e, Database = Postgres>) -> Result<Option<Row>> {
    let row = sqlx::raw_sql(text).fetch_optional(db).await?;
    Ok(row.map(Into::into))
}

/// A statement of which the first column is asked, and its values.
#[must_use]
pub(in crate::jobs::store) struct Scalar<'q>(Query<'q>);

impl<'q> Scalar<'q> {
    /// The value of the next parameter.
    pub(in crate::jobs::store) fn bind(self, value: impl Into<Value<'q>>) -> Self {
        Self(self.0.bind(value))
    }

    pub(in crate::jobs::store) async fn fetch_one<'e, T>(self, on: impl Into<On<'e>>) -> Result<T>
    where
        T: for<'r> Column<'r>,
    {
        self.0.fetch_one(on).await?.at(0)
    }

    pub(in crate::jobs::store) async fn fetch_optional<'e, T>(
        self,
        on: impl Into<On<'e>>,
    ) -> Result<Option<T>>
    where
        T: for<'r> Column<'r>,
    {
        let row = self.0.fetch_optional(on).await?;
        row.map(|row| row.at(0)).transpose()
    }

    pub(in crate::jobs::store) async fn fetch_all<'e, T>(
        self,
        on: impl Into<On<'e>>,
    ) -> Result<Vec<T>>
    where
        T: for<'r> Column<'r>,
    {
        let rows = self.0.fetch_all(on).await?;
        rows.iter().map(|row| row.at(0)).collect()
    }
}

/// A text and the values of its parameters, as a driver takes them.
type Statement<D> = (SqlStr, <D as Database>::Arguments);

async fn execute<'e, D>(
    (text, arguments): Statement<D>,
    db: impl Executor<'e, Database = D>,
) -> Result<D::QueryResult>
where
    D: Database<Arguments: IntoArguments<D>>,
{
    Ok(sqlx::query_with(text, arguments).execute(db).await?)
}

async fn all<'e, D>(
    (text, arguments): Statement<D>,
    db: impl Executor<'e, Database = D>,
) -> Result<Vec<Row>>
where
    D: Database<Arguments: IntoArguments<D>, Row: Into<Row>>,
{
    let rows = sqlx::query_with(text, arguments).fetch_all(db).await?;
    Ok(rows.into_iter().map(Into::into).collect())
}

async fn optional<'e, D>(
    (text, arguments): Statement<D>,
    db: impl Executor<'e, Database = D>,
) -> Result<Option<Row>>
where
    D: Database<Arguments: IntoArguments<D>, Row: Into<Row>>,
{
    let row = sqlx::query_with(text, arguments).fetch_optional(db).await?;
    Ok(row.map(Into::into))
}
