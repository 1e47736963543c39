//! Settings given as `group.name=value`, as on a command line.

use serde_json::{Map, Value};

use super::{Error, Violation};

/// Turns `network.scheme=hw` assignments into the JSON object that [`Settings::resolve`](super::Settings::resolve) takes.
///
/// A value is read as JSON where it is JSON, otherwise as a string.
///
/// # Errors
/// Every assignment that has no `=` or whose path runs through a value.
pub fn assignments<S: AsRef<str>>(given: &[S]) -> Result<Value, Error> {
    let mut root = Map::new();
    let mut violations = Vec::new();
    for assignment in given {
        let assignment = assignment.as_ref();
        let Some((path, text)) = assignment.split_once('=') else {
            violations.push(Violation {
                pointer: format!("/{}", assignment.replace('.', "/")),
                detail: "needs a value, as in network.scheme=hw".to_owned(),
            });
            continue;
        };
        let value = serde_json::from_str(text).unwrap_or_else(|_| Value::String(text.to_owned()));
        if !insert(&mut root, path, value) {
            violations.push(Violation {
                pointer: format!("/{}", path.replace('.', "/")),
                detail: "is set both as a value and as a group".to_owned(),
            });
        }
    }
    if violations.is_empty() {
        Ok(Value::Object(root))
    } else {
        Err(Error::Invalid(violations))
    }
}

fn insert(object: &mut Map<String, Value>, path: &str, value: Value) -> bool {
    match path.split_once('.') {
        None => {
            object.insert(path.to_owned(), value);
            true
        }
        Some((group, rest)) => object
            .entry(group)
            .or_insert_with(|| Value::Object(Map::new()))
            .as_object_mut()
            .is_some_and(|inner| insert(inner, rest, value)),
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn assignments_become_nested_objects() {
        let value = assignments(&["network.scheme=hw", "training.seed=12"]).unwrap();
        assert_eq!(
            value,
            json!({"network": {"scheme": "hw"}, "training": {"seed": 12}})
        );
        let error = assignments(&["a", "b=1", "b.c=2"]).unwrap_err();
        assert_eq!(error.violations().len(), 2);
    }
}
