//! The four kinds of values that both databases have. A missing one has its kind too, without which
//! Postgres does not know what a parameter is.

use std::borrow::Cow;

use sqlx::{Arguments, Database, Encode, Type};

use crate::jobs::{Error, Result};

/// The value of a parameter.
pub(in crate::jobs::store) enum Value<'q> {
    Text(Option<Cow<'q, str>>),
    Integer(Option<i64>),
    Real(Option<f64>),
    Bytes(Option<Cow<'q, [u8]>>),
}

/// What stands for U+0000, which texts of Postgres cannot have: no character either. Texts are found by
/// it, and none of ours is read back that has one.
pub(in crate::jobs::store) const NO_NUL: &str = "\u{fffe}";

impl<'q> Value<'q> {
    /// The same, of which nothing is copied.
    pub(super) fn borrowed(&self) -> Value<'_> {
        match self {
            Self::Text(text) => Value::Text(text.as_deref().map(Cow::Borrowed)),
            Self::Integer(number) => Value::Integer(*number),
            Self::Real(number) => Value::Real(*number),
            Self::Bytes(bytes) => Value::Bytes(bytes.as_deref().map(Cow::Borrowed)),
        }
    }

    pub(super) fn without_nul(self) -> Self {
        match self {
            Self::Text(Some(text)) if text.contains('\0') => {
                Self::Text(Some(Cow::Owned(text.replace('\0', NO_NUL))))
            }
            value => value,
        }
    }

    /// The value as Postgres reads it within a statement, with its type. The text is one that means the same
    /// whatever `standard_conforming_strings` is.
    pub(super) fn literal(&self) -> String {
        match self {
            Self::Text(None) => "CAST(NULL AS TEXT)".to_owned(),
            Self::Text(Some(text)) => {
                let text = text.replace('\\', "\\\\").replace('\'', "''");
                format!("CAST(E'{text}' AS TEXT)")
            }
            Self::Integer(None) => "CAST(NULL AS BIGINT)".to_owned(),
            Self::Integer(Some(number)) => format!("CAST('{number}' AS BIGINT)"),
            Self::Real(Some(number)) if !number.is_nan() => {
                format!("CAST('{number:e}' AS DOUBLE PRECISION)")
            }
            Self::Real(_) => "CAST(NULL AS DOUBLE PRECISION)".to_owned(),
            Self::Bytes(None) => "CAST(NULL AS BYTEA)".to_owned(),
            Self::Bytes(Some(bytes)) => format!("CAST(E'\\\\x{}' AS BYTEA)", hex::encode(bytes)),
        }
    }

    /// The same as an element of the text of an array.
    pub(super) fn element(&self) -> String {
        match self {
            Self::Text(Some(text)) => {
                format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
            }
            Self::Integer(Some(number)) => number.to_string(),
            Self::Real(Some(number)) if !number.is_nan() => format!("{number:e}"),
            Self::Bytes(Some(bytes)) => format!("\"\\\\x{}\"", hex::encode(bytes)),
            Self::Text(None) | Self::Integer(None) | Self::Real(_) | Self::Bytes(None) => {
                "NULL".to_owned()
            }
        }
    }

    pub(super) fn add_to<A>(self, arguments: &mut A) -> Result<()>
    where
        A: Arguments,
        Option<String>: Encode<'q, A::Database> + Type<A::Database>,
        Option<&'q str>: Encode<'q, A::Database> + Type<A::Database>,
        Option<i64>: Encode<'q, A::Database> + Type<A::Database>,
        Option<f64>: Encode<'q, A::Database> + Type<A::Database>,
        Option<Vec<u8>>: Encode<'q, A::Database> + Type<A::Database>,
        Option<&'q [u8]>: Encode<'q, A::Database> + Type<A::Database>,
        A::Database: Database,
    {
        let added = match self {
            Self::Text(Some(Cow::Owned(text))) => arguments.add(Some(text)),
            Self::Text(Some(Cow::Borrowed(text))) => arguments.add(Some(text)),
            Self::Text(None) => arguments.add(None::<&str>),
            Self::Integer(number) => arguments.add(number),
            // As SQLite keeps it: what is not a number is none.
            Self::Real(number) => arguments.add(number.filter(|number| !number.is_nan())),
            Self::Bytes(Some(Cow::Owned(bytes))) => arguments.add(Some(bytes)),
            Self::Bytes(Some(Cow::Borrowed(bytes))) => arguments.add(Some(bytes)),
            Self::Bytes(None) => arguments.add(None::<&[u8]>),
        };
        added.map_err(|error| Error::from(sqlx::Error::Encode(error)))
    }
}

/// Writes how types become values, and how optional ones do.
macro_rules! values {
    ($($from:ty => |$value:ident| $kind:ident($made:expr);)*) => {$(
        impl<'q> From<$from> for Value<'q> {
            fn from($value: $from) -> Self {
                Self::$kind(Some($made))
            }
        }

        impl<'q> From<Option<$from>> for Value<'q> {
            fn from(value: Option<$from>) -> Self {
                Self::$kind(value.map(|$value| $made))
            }
        }
    )*};
}

values! {
    &'q str => |text| Text(Cow::Borrowed(text));
    &'q String => |text| Text(Cow::Borrowed(text.as_str()));
    String => |text| Text(Cow::Owned(text));
    Cow<'q, str> => |text| Text(text);
    i64 => |number| Integer(number);
    u32 => |number| Integer(i64::from(number));
    u16 => |number| Integer(i64::from(number));
    bool => |flag| Integer(i64::from(flag));
    f64 => |number| Real(number);
    &'q [u8] => |bytes| Bytes(Cow::Borrowed(bytes));
    &'q Vec<u8> => |bytes| Bytes(Cow::Borrowed(bytes.as_slice()));
    Vec<u8> => |bytes| Bytes(Cow::Owned(bytes));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_in_a_value_ends_its_literal() {
        for (value, literal) in [
            (Value::from("it's"), "CAST(E'it''s' AS TEXT)"),
            (Value::from("\\'; --"), "CAST(E'\\\\''; --' AS TEXT)"),
            (Value::from(None::<&str>), "CAST(NULL AS TEXT)"),
            (Value::from(-5_i64), "CAST('-5' AS BIGINT)"),
            (Value::from(0.1), "CAST('1e-1' AS DOUBLE PRECISION)"),
            (
                Value::from(f64::NEG_INFINITY),
                "CAST('-inf' AS DOUBLE PRECISION)",
            ),
            (Value::from(f64::NAN), "CAST(NULL AS DOUBLE PRECISION)"),
            (Value::from(vec![0, 255]), "CAST(E'\\\\x00ff' AS BYTEA)"),
        ] {
            assert_eq!(value.literal(), literal);
        }
    }
}
