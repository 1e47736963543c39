//! One statement for many rows.

use super::{Db, Query, Row, Text, Value};
use crate::jobs::Result;

/// A statement and the values of each row. On `SQLite`, where a statement costs little, it runs once for each;
/// on Postgres once, and each parameter is the text of an array: of what all rows have there.
pub(in crate::jobs::store) struct Many<'q> {
    text: Text,
    rows: Vec<Vec<Value<'q>>>,
}

/// A statement, to which rows are added: their values in the order of its parameters.
pub(in crate::jobs::store) fn many<'q>(text: Text) -> Many<'q> {
    Many {
        text,
        rows: Vec::new(),
    }
}

impl<'q> Many<'q> {
    /// Adds the values of a row: as many as the others have.
    pub(in crate::jobs::store) fn row<const N: usize>(&mut self, values: [Value<'q>; N]) {
        self.rows.push(values.into());
    }

    /// What comes back of all rows, in any order.
    pub(in crate::jobs::store) async fn fetch_all(self, db: &mut Db<'_>) -> Result<Vec<Row>> {
        let text = self.text;
        if matches!(db, Db::Postgres(..)) {
            let values = arrays(&self.rows).into_iter().map(Value::from).collect();
            return Query { text, values }.fetch_all(db).await;
        }
        let mut answers = Vec::new();
        for values in self.rows {
            answers.extend(Query { text, values }.fetch_all(&mut *db).await?);
        }
        Ok(answers)
    }
}

/// For each parameter what the rows have there, as Postgres reads an array.
fn arrays(rows: &[Vec<Value<'_>>]) -> Vec<String> {
    let parameters = rows.first().map_or(0, Vec::len);
    let array = |parameter: usize| {
        let elements = rows.iter().map(|row| match row.get(parameter) {
            None => "NULL".to_owned(),
            Some(value) => value.element(),
        });
        format!("{{{}}}", elements.collect::<Vec<_>>().join(","))
    };
    (0..parameters).map(array).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_array_holds_what_the_rows_have_whatever_is_in_it() {
        let rows = [
            vec!["a \"b\", {c}\\d".into(), Value::from(-5_i64), 0.1.into()],
            vec!["NULL".into(), None::<i64>.into(), f64::NAN.into()],
            vec![None::<&str>.into(), true.into(), f64::INFINITY.into()],
            vec!["".into(), 7_u32.into(), vec![0, 255].into()],
        ];
        assert_eq!(
            arrays(&rows),
            [
                r#"{"a \"b\", {c}\\d","NULL",NULL,""}"#,
                "{-5,NULL,1,7}",
                r#"{1e-1,NULL,inf,"\\x00ff"}"#,
            ]
        );
        assert!(arrays(&[]).is_empty());
    }
}
