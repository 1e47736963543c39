//! From a row to typed values; what cannot be read names its table and column.

use std::collections::BTreeMap;
use std::str::FromStr;

use serde::de::DeserializeOwned;

use crate::jobs::store::content::objects::Kept;
use crate::jobs::store::sql::{Column, Row};
use crate::jobs::{Error, Result};

/// A statement about what belongs to the job `?1`, if that is the tenant's, `?2`.
macro_rules! of_tenant {
    ($condition:literal $(, $rest:literal)?) => {
        concat!(
            $condition,
            " AND EXISTS (SELECT 1 FROM jobs WHERE jobs.id = ?1 AND jobs.tenant = ?2) ",
            $($rest)?
        )
    };
}
pub(in crate::jobs::store) use of_tenant;

/// A statement about the few rows whose id is one of `?1`, as [`ids`] writes them.
macro_rules! of_ids {
    ($before:literal $(, $rest:literal)?) => {
        crate::jobs::store::sql::either(
            concat!($before, " IN (SELECT value FROM json_each(?1))" $(, $rest)?),
            // As an array, of which Postgres knows that it is short.
            concat!($before, " = ANY (ARRAY(SELECT value FROM json_each(?1)))" $(, $rest)?),
        )
    };
}
pub(in crate::jobs::store) use of_ids;

/// The text of ids for a statement about them.
pub(in crate::jobs::store) fn ids<'i>(ids: impl IntoIterator<Item = &'i str>) -> String {
    let numbered: BTreeMap<usize, &str> = (0..).zip(ids).collect();
    to_json(&numbered)
}

/// A row of a known table.
#[derive(Clone, Copy)]
pub(in crate::jobs::store) struct Columns<'r> {
    table: &'static str,
    row: &'r Row,
}

impl<'r> Columns<'r> {
    pub(in crate::jobs::store) fn new(table: &'static str, row: &'r Row) -> Self {
        Self { table, row }
    }

    /// The value as it is.
    pub(in crate::jobs::store) fn get<T>(self, column: &'static str) -> Result<T>
    where
        T: Column<'r>,
    {
        self.row
            .named(column)
            .map_err(Error::inconsistent(self.table, column))
    }

    /// A number that is not negative.
    pub(in crate::jobs::store) fn count(self, column: &'static str) -> Result<u64> {
        u64::try_from(self.get::<i64>(column)?).map_err(Error::inconsistent(self.table, column))
    }

    /// A floating-point number; NULL, which is how one is kept that is not a number, is NaN.
    pub(in crate::jobs::store) fn float(self, column: &'static str) -> Result<f64> {
        Ok(self.get::<Option<f64>>(column)?.unwrap_or(f64::NAN))
    }

    /// A text in a form of its own.
    pub(in crate::jobs::store) fn parsed<T>(self, column: &'static str) -> Result<T>
    where
        T: FromStr<Err: ToString>,
    {
        self.get::<&str>(column)?
            .parse()
            .map_err(Error::inconsistent(self.table, column))
    }

    /// A text of JSON.
    pub(in crate::jobs::store) fn json<T: DeserializeOwned>(
        self,
        column: &'static str,
    ) -> Result<T> {
        serde_json::from_str(self.get(column)?).map_err(Error::inconsistent(self.table, column))
    }

    /// A text of JSON, or NULL.
    pub(in crate::jobs::store) fn optional_json<T: DeserializeOwned>(
        self,
        column: &'static str,
    ) -> Result<Option<T>> {
        self.get::<Option<&str>>(column)?
            .map(serde_json::from_str)
            .transpose()
            .map_err(Error::inconsistent(self.table, column))
    }

    /// A name that is its own JSON string, such as a preset's, or NULL.
    pub(in crate::jobs::store) fn name<T: DeserializeOwned>(
        self,
        column: &'static str,
    ) -> Result<Option<T>> {
        self.get::<Option<String>>(column)?
            .map(|name| serde_json::from_value(name.into()))
            .transpose()
            .map_err(Error::inconsistent(self.table, column))
    }

    /// The object that the row names.
    pub(in crate::jobs::store) fn object(self) -> Result<Kept> {
        Ok(Kept {
            key: self.get("object")?,
            bytes: self.count("bytes")?,
        })
    }

    /// A value that must not be missing.
    pub(in crate::jobs::store) fn required<T>(
        self,
        value: Option<T>,
        column: &'static str,
    ) -> Result<T> {
        value.ok_or_else(|| Error::inconsistent(self.table, column)("is missing"))
    }
}

/// JSON text of a value that has one: our own types, whose keys are strings.
pub(in crate::jobs::store) fn to_json<T: serde::Serialize>(value: &T) -> String {
    serde_json::to_string(value).expect("our own types have string keys only")
}

/// A count as the databases keep it; what is larger than 2⁶³ does not occur and is cut there.
pub(in crate::jobs::store) fn integer(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}
